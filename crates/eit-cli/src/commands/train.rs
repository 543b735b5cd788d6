//! `eit train`: a learning base out of simulated touches, then a U-net by burn.

use super::Answer;
use crate::cli::TrainArgs;
use crate::error::CliError;
use crate::{interrupt, progress};
use eit_denoise::{TrainSettings, TrainStatus, Unet, UnetShape, Weights};
use eit_report::curve;
use eit_report::output::OutFile;
use eit_skin::denoise::Scores;
use eit_skin::scene::Scene;
use eit_skin::train::{self, HeldOutResult, MadeBy, MeasuredJudge, Sequences, Training};
use eit_skin::{MeshOverride, Skin};
use serde_json::json;
use std::collections::BTreeMap;

/// Completes the base, trains or resumes, and writes weights and curve. It is long because most
/// stages share what the first ones made.
pub(crate) fn run(args: &TrainArgs) -> Result<Answer, CliError> {
    let scene = Scene::load(&args.scene)?;
    scene.refuse_movement("train")?;
    super::check_ending(&args.out, &["safetensors"])?;
    let first = args.from.as_ref().map(|file| first_weights(file)).transpose()?;
    let (shape, settings) = settings(args, first.as_ref())?;
    let open = args.device.open();
    let device = open.map_err(|e| CliError::input(format!("--device {}: {e}", args.device)))?;
    let request = super::base::request(&args.pairs)?;
    let out = OutFile::new(&args.out)?;
    let threads = super::base::threads(&args.pairs)?;
    let mut progress = progress::terminal();
    let skin = Skin::set_up(&scene, &MeshOverride::default(), &mut progress)?;
    let sequences = Sequences::new(&skin, &request, &mut progress)?;
    let folder = args.base.clone().unwrap_or_else(|| args.out.with_extension("base"));
    let stop = interrupt::listen()?;
    let base = train::base(&request, &sequences, &folder, None, threads, &stop, &mut progress)?;
    let (mut learnt, mut held_out) = progress.stage("read the base", || train::shards(&base))?;
    progress.stage("inputs of the net", || {
        sequences.complete(&mut learnt, shape, threads)?;
        sequences.complete(&mut held_out, shape, threads)
    })?;
    let name = base.checksum()?;
    let from = first.as_ref().map(train::parameter_checksum);
    let made_by = MadeBy {
        program: &format!("eit {}", env!("CARGO_PKG_VERSION")),
        commit: env!("EIT_COMMIT"),
        from: from.as_deref(),
    };
    let (net, trainer) = match first {
        Some(weights) if args.epochs == 0 => {
            let checked = weights.check_skin(&skin.fingerprint, base.settings().pixels);
            checked.map_err(|e| CliError::input(format!("--epochs 0: {e}")))?;
            (weights, None)
        }
        first => {
            let source = match &from {
                Some(from) => format!("{name} from {from}"),
                None => name.clone(),
            };
            let training = Training {
                settings: &settings,
                base: &source,
                checkpoint: &args.out.with_extension("checkpoint"),
                threads,
                stop: &stop,
            };
            let net = match &first {
                Some(weights) => Unet::from_weights(weights, &device)?,
                None => Unet::new(shape, args.pairs.seed, &device)?,
            };
            let made = train::learn(net, &training, &sequences, &learnt, &held_out, &mut progress)?;
            let pixels = base.settings().pixels;
            (made.weights(&skin.fingerprint, pixels, &BTreeMap::new())?, Some(made))
        }
    };
    let worth = progress.stage("compare", || {
        let scores = train::held_out_scores(&net, &held_out)?;
        let judge = train::judge(&net, &learnt, &held_out, &sequences)?;
        Ok::<_, CliError>(HeldOutResult { scores, judge })
    })?;
    let weights = match &trainer {
        Some(trainer) => {
            curve::write(trainer.curve(), footnote(shape, args.pairs.seed), &args.out)?;
            train::weights(&skin, &base, trainer, &worth, &made_by)?
        }
        None => train::judged_weights(net, &base, &worth, &made_by)?,
    };
    let HeldOutResult { scores, judge } = worth;
    refuse_worse(&scores, args)?;
    let bytes = weights.to_bytes()?;
    out.write(|w| w.write_all(&bytes).map_err(eit_report::output::io))?;
    let epochs = trainer.as_ref().map_or(0, |trainer| trainer.curve().len());
    let status = trainer.as_ref().map_or("not trained", |trainer| status_words(trainer.status()));
    let held_out_error = trainer.and_then(|trainer| trainer.best().map(|e| e.held_out_error));
    let json = json!({
        "scene": scene.name,
        "skin": skin.fingerprint,
        "base": folder.display().to_string(),
        "base_checksum": name,
        "from": from,
        "examples": base.frames(),
        "parameters": shape.parameters(),
        "multiply_adds": shape.multiply_adds(weights.pixels[0], weights.pixels[1]),
        "device": args.device.name(),
        "epochs": epochs,
        "status": status,
        "held_out_error": held_out_error,
        "held_out": scores,
        "misfit_limit": judge.as_ref().map(|judge| judge.error.limit),
        "judge": judge.as_ref().map(|judge| judge.counts),
        "bytes": bytes.len(),
        "stages": progress.times(),
        "out": args.out.display().to_string(),
    });
    let or_denoise = match shape.images {
        // a net that sees touches needs the measurements
        1 => {
            let out = args.out.display();
            format!(", or eit denoise {} --weights {out} --images F.npy --out DIR", args.scene)
        }
        _ => String::new(),
    };
    let text = format!(
        "{} frames of {} sequences in {}\n{} weights, {} epochs ({}), held-out error {:.4}\n\
         held-out sequences: {}{}\nwritten to {} ({} kB), learning curve beside it\nnext: \
         [denoise] weights = \"{}\" in the scene{}",
        base.frames(),
        args.pairs.sequences,
        folder.display(),
        shape.parameters(),
        epochs,
        status,
        held_out_error.unwrap_or(f64::NAN),
        scores.words(),
        judge_words(judge.as_ref()),
        args.out.display(),
        bytes.len() / 1000,
        args.out.display(),
        or_denoise,
    );
    Ok(Answer { text, json })
}

/// What the judge did, for people.
fn judge_words(judge: Option<&MeasuredJudge>) -> String {
    let Some(judge) = judge else { return String::new() };
    let older = match &judge.older {
        Some(older) => format!("; by the older rule of these weights {}", older.words()),
        None => String::new(),
    };
    format!("\njudge: {}{older}", judge.counts.words())
}

/// Rejects a net that makes images worse; from its file alone nobody could tell.
fn refuse_worse(scores: &Scores, args: &TrainArgs) -> Result<(), CliError> {
    if args.force || scores.net_over_raw < 1.0 {
        return Ok(());
    }
    Err(CliError::Failure(format!(
        "{} is not written: on the held-out sequences the net's squared error is {:.3} of the raw \
         image's (median of {} frames), so that it makes them worse; train with more sequences or \
         epochs, or write it all the same with --force",
        args.out.display(),
        scores.net_over_raw,
        scores.frames
    )))
}

fn footnote(shape: UnetShape, seed: u64) -> String {
    let UnetShape { history, width, depth, images, fold, .. } = shape;
    format!(
        "U-net of {} weights (width {width}, depth {depth}, fold {fold}, {history} frames of {images} \
         images), seed {seed}",
        shape.parameters()
    )
}

/// Weights to start from: a file, or "default" for the shipped ones.
fn first_weights(name: &str) -> Result<Weights, CliError> {
    let weights = match name {
        "default" => Weights::paper_disc_with_touches(),
        file => {
            let bytes =
                std::fs::read(file).map_err(|e| CliError::input(format!("--from {file}: {e}")))?;
            Weights::from_bytes(&bytes)
        }
    };
    weights.map_err(|e| CliError::input(format!("--from {name}: {e}")))
}

/// Returns the size of the net (that of the initial weights, if given) and the training settings.
fn settings(
    args: &TrainArgs,
    first: Option<&Weights>,
) -> Result<(UnetShape, TrainSettings), CliError> {
    let TrainArgs { history, width, depth, images, fold, .. } = *args;
    let conditions = if images > 1 { 2 } else { 0 };
    let asked = UnetShape { history, width, depth, images, conditions, fold };
    let shape = first.map_or(asked, |weights| weights.shape);
    let TrainArgs { epochs, batch, rate, patience, .. } = *args;
    let seed = args.pairs.seed;
    let settings = TrainSettings { seed, epochs, batch, rate, patience };
    if epochs == 0 && first.is_some() {
        return Ok((shape, settings));
    }
    let valid = shape.validate().and_then(|()| settings.validate());
    valid.map_err(|e| CliError::input(format!("--{e}")))?;
    Ok((shape, settings))
}

fn status_words(status: TrainStatus) -> &'static str {
    match status {
        TrainStatus::Running => "interrupted: the same command goes on",
        TrainStatus::Done => "all done",
        TrainStatus::Stopped => "stopped early",
    }
}
