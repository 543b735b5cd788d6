//! `eit net train`: a learning base, then a U-net by burn.

use crate::cli::TrainArgs;
use crate::commands::prelude::*;
use eit_denoise::{TrainSettings, TrainStatus, Trainer, UnetShape, Weights};
use eit_report::curve;
use eit_report::output::io;
use eit_skin::train::{TrainRequest, Trained, train};

/// Makes the base where it is not complete, trains or goes on, writes weights and curve.
pub(super) fn run(args: &TrainArgs) -> Result<Answer, CliError> {
    let scene = Scene::load(&args.scene)?;
    scene.refuse_movement("net train")?;
    check_ending(&args.out, &["safetensors"])?;
    let first = args.from.as_deref().map(first_weights).transpose()?;
    let (shape, settings) = settings(args, first.as_ref())?;
    let open = args.device.open();
    let device = open.map_err(|e| CliError::input(format!("--device {}: {e}", args.device)))?;
    let base = args.pairs.request()?;
    let out = OutFile::new(&args.out)?;
    let threads = args.pairs.threads()?;
    let mut progress = progress::terminal();
    let skin = Skin::set_up(&scene, &MeshOverride::default(), &mut progress)?;
    let folder = args.base.clone().unwrap_or_else(|| args.out.with_extension("base"));
    let request = TrainRequest {
        base: &base,
        folder: &folder,
        shape,
        settings,
        first,
        device: &device,
        checkpoint: &args.out.with_extension("checkpoint"),
        made_by: concat!("eit ", env!("CARGO_PKG_VERSION")),
        threads,
        stop: &interrupt::listen()?,
    };
    let trained = train(&skin, request, &mut progress)?;
    if let Some(trainer) = &trained.trainer {
        curve::write(trainer.curve(), footnote(shape, args.pairs.seed), &args.out)?;
    }
    refuse_worse(&trained, args)?;
    let bytes = trained.weights.to_bytes()?;
    out.write(|w| w.write_all(&bytes).map_err(io))?;
    answer(args, &skin, &trained, shape, &folder, bytes.len(), &progress)
}

fn answer(
    args: &TrainArgs,
    skin: &Skin,
    trained: &Trained,
    shape: UnetShape,
    folder: &Path,
    bytes: usize,
    progress: &Progress,
) -> Result<Answer, CliError> {
    let Trained { weights, trainer, base, frames, scores, judge, .. } = trained;
    let (trainer, judge) = (trainer.as_ref(), judge.as_ref());
    let epochs = trainer.map_or(0, |trainer| trainer.curve().len());
    let status = trainer.map_or("not trained", |trainer| match trainer.status() {
        TrainStatus::Running => "interrupted: the same command goes on",
        TrainStatus::Done => "all done",
        TrainStatus::Stopped => "stopped early",
    });
    let error = trainer.and_then(Trainer::best).map(|epoch| epoch.held_out_error);
    let json = json!({
        "scene": skin.name,
        "skin": skin.fingerprint,
        "base": folder.display().to_string(),
        "base_checksum": base.checksum()?,
        "from": trained.from,
        "examples": frames,
        "parameters": shape.parameters(),
        "multiply_adds": shape.multiply_adds(weights.pixels[0], weights.pixels[1]),
        "device": args.device.name(),
        "epochs": epochs,
        "status": status,
        "held_out_error": error,
        "held_out": scores,
        "misfit_limit": judge.map(|judge| judge.error.limit),
        "judge": judge.map(|judge| judge.counts),
        "bytes": bytes,
        "stages": progress.times(),
        "out": args.out.display().to_string(),
    });
    let (out, folder, kilobytes) = (args.out.display(), folder.display(), bytes / 1000);
    let or_apply = match shape.images {
        // a net that sees touches needs the measurements
        1 => format!(", or eit net apply {} --weights {out} --images F.npy --out DIR", args.scene),
        _ => String::new(),
    };
    let judged =
        judge.map_or_else(String::new, |judge| format!("\njudge: {}", judge.counts.description()));
    let tested = if args.pairs.pairs.is_some() { "learnt" } else { "held-out" };
    let text = format!(
        "{frames} frames of {} sequences in {folder}\n{} weights, {epochs} epochs ({status}), {tested} error {:.4}\n\
         {tested} sequences: {}{judged}\nwritten to {out} ({kilobytes} kB), learning curve beside it\nnext: \
         [denoise] weights = \"{out}\" in the scene{or_apply}",
        base.settings().shards,
        shape.parameters(),
        error.unwrap_or(f64::NAN),
        scores.description(),
    );
    Ok(Answer { text, json })
}

/// Rejects a net that makes images worse than it was given: a file of weights does not show it.
fn refuse_worse(Trained { scores, .. }: &Trained, args: &TrainArgs) -> Result<(), CliError> {
    if args.force || scores.net_over_raw < 1.0 {
        return Ok(());
    }
    Err(CliError::failure(format!(
        "{} is not written: on the held-out sequences the net's squared error is {:.3} of the raw image's (median of {} \
         frames), so that it makes them worse; train with more sequences or epochs, or write it all the same with \
         --force",
        args.out.display(),
        scores.net_over_raw,
        scores.frames
    )))
}

fn footnote(shape: UnetShape, seed: u64) -> String {
    let UnetShape { history, width, depth, images, fold, .. } = shape;
    let weights = shape.parameters();
    format!(
        "U-net of {weights} weights (width {width}, depth {depth}, fold {fold}, {history} frames of {images} images), \
         seed {seed}"
    )
}

/// Weights to start from: a file, or "default" for the shipped ones.
fn first_weights(name: &str) -> Result<Weights, CliError> {
    let failed = |error: &dyn std::fmt::Display| CliError::input(format!("--from {name}: {error}"));
    let weights = match name {
        "default" => Weights::paper_disc_with_touches(),
        file => Weights::from_bytes(&std::fs::read(file).map_err(|error| failed(&error))?),
    };
    weights.map_err(|error| failed(&error))
}

/// Size of the net, that of the weights to start from where there are some, and how it is trained.
fn settings(
    args: &TrainArgs,
    first: Option<&Weights>,
) -> Result<(UnetShape, TrainSettings), CliError> {
    let TrainArgs { history, width, depth, images, fold, epochs, batch, rate, patience, .. } =
        *args;
    let conditions = if images > 1 { 2 } else { 0 };
    let asked = UnetShape { history, width, depth, images, conditions, fold };
    let shape = first.map_or(asked, |weights| weights.shape);
    let settings = TrainSettings { seed: args.pairs.seed, epochs, batch, rate, patience };
    if epochs > 0 || first.is_none() {
        let valid = shape.validate().and_then(|()| settings.validate());
        valid.map_err(|e| CliError::input(format!("--{e}")))?;
    }
    Ok((shape, settings))
}
