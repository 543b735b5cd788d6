//! `eit train`: a learning base out of simulated touches, then a U-net.

mod curve;
mod motion;
mod recorded;
mod simulated;
mod workshop;
mod worth;

use super::{Answer, ending};
use crate::cli::TrainArgs;
use crate::denoise::Scores;
use crate::error::CliError;
use crate::interrupt::Interrupt;
use crate::output::OutFile;
use crate::progress::Progress;
use crate::scene::Scene;
use eit_denoise::{
    BaseSettings, Engine, Examples, LearningBase, PixelTurn, Shard, TrainSettings, TrainStatus,
    Trainer, UnetShape, Weights,
};
use serde_json::json;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;
use workshop::Workshop;

/// One sequence of so many is held out.
const HELD_OUT: usize = 6;

/// Makes the base where it is not complete, trains or goes on, writes weights and curve.
pub(crate) fn run(args: &TrainArgs) -> Result<Answer, CliError> {
    let scene = Scene::load(&args.scene)?;
    scene.refuse_movement("train")?;
    super::check_ending(&args.out, &["safetensors"])?;
    let settings = settings(args)?;
    if !args.recording.is_empty() && args.fingers.is_some() {
        return Err(CliError::input("--fingers: a recording has the fingers that it has"));
    }
    if args.sequences < 2 {
        return Err(CliError::input("--sequences: at least 2, as one is held out"));
    }
    let out = OutFile::new(&args.out)?;
    let threads = match args.threads {
        Some(0) => return Err(CliError::input("--threads 0: at least 1")),
        Some(threads) => threads,
        None => std::thread::available_parallelism().map_or(1, usize::from),
    };
    let mut progress = Progress::default();
    let workshop = Workshop::new(&scene, args, &mut progress)?;
    let folder = args.base.clone().unwrap_or_else(|| args.out.with_extension("base"));
    let interrupt = Interrupt::listen()?;
    let how = (threads, &interrupt);
    let base = base(args, &scene, (&workshop, how), &folder, &mut progress)?;
    let (train, held_out) = progress.stage("read the base", || shards(&base))?;
    let name = base.checksum()?;
    let checkpoint = args.out.with_extension("checkpoint");
    let turns = workshop.turns();
    let pairs = (train, &held_out[..], &turns[..]);
    let how = (checkpoint.as_path(), threads, args.engine, &interrupt);
    let trainer = learn(&settings, pairs, &name, how, &mut progress)?;
    let skin = scene.skin_fingerprint()?;
    let bare = trainer.weights(&skin, base.settings().pixels, BTreeMap::new());
    let (scores, limit) = progress.stage("compare", || {
        let scores = worth::held_out_scores(&bare, &held_out)?;
        Ok::<_, CliError>((scores, worth::misfit_limit(&bare, &held_out, &workshop)?))
    })?;
    let about = about(&scene, &base, &name, &trainer, (&scores, limit));
    let weights = Weights { about, ..bare };
    let bytes = weights.to_bytes()?;
    out.write(|w| w.write_all(&bytes).map_err(crate::output::io))?;
    curve::write(&trainer, &args.out)?;
    let json = json!({
        "scene": scene.name,
        "skin": skin,
        "base": folder.display().to_string(),
        "base_checksum": name,
        "examples": base.frames(),
        "parameters": settings.shape.parameters(),
        "multiply_adds": settings.shape.multiply_adds(weights.pixels[0], weights.pixels[1]),
        "engine": args.engine.name(),
        "epochs": trainer.curve().len(),
        "status": status_words(trainer.status()),
        "held_out_error": trainer.best().map(|e| e.held_out_error),
        "held_out": scores.json(),
        "misfit_limit": limit,
        "bytes": bytes.len(),
        "stages": progress.times(),
        "out": args.out.display().to_string(),
    });
    let text = format!(
        "{} frames of {} sequences in {}\n{} weights, {} epochs ({}), held-out error {:.4}\n\
         held-out sequences: {}\nwritten to {} ({} kB), learning curve beside it\nnext: \
         [denoise] weights = \"{}\" in the scene, or eit denoise {} --weights {} --images F.npy --out DIR",
        base.frames(),
        args.sequences,
        folder.display(),
        settings.shape.parameters(),
        trainer.curve().len(),
        status_words(trainer.status()),
        trainer.best().map_or(f64::NAN, |e| e.held_out_error),
        scores.words(),
        args.out.display(),
        bytes.len() / 1000,
        args.out.display(),
        args.scene,
        args.out.display(),
    );
    Ok(Answer { text, json })
}

fn settings(args: &TrainArgs) -> Result<TrainSettings, CliError> {
    let shape = UnetShape { history: args.history, width: args.width, depth: args.depth };
    let TrainArgs { seed, epochs, batch, rate, patience, .. } = *args;
    let settings = TrainSettings { shape, seed, epochs, batch, rate, patience };
    settings.validate().map_err(|e| CliError::input(format!("--{e}")))?;
    args.engine.check().map_err(|e| CliError::input(format!("--engine {}: {e}", args.engine)))?;
    Ok(settings)
}

/// The learning base, complete.
fn base(
    args: &TrainArgs,
    scene: &Scene,
    (workshop, (threads, interrupt)): (&Workshop<'_>, (usize, &Interrupt)),
    folder: &Path,
    progress: &mut Progress,
) -> Result<LearningBase, CliError> {
    let settings = BaseSettings {
        skin: scene.skin_fingerprint()?,
        pixels: workshop.pixels(),
        seed: args.seed,
        shards: args.sequences,
        recipe: workshop.recipe(),
    };
    let mut base = LearningBase::create(folder, &settings)?;
    let missing = base.missing();
    if missing.is_empty() {
        return Ok(base);
    }
    progress.steps("sequences", missing.len(), |bar| {
        let next = AtomicUsize::new(0);
        let (sender, made) = mpsc::channel();
        std::thread::scope(|scope| {
            for _ in 0..threads.min(missing.len()) {
                let (missing, next, sender) = (&missing, &next, sender.clone());
                // ends with the list, or when nobody listens any more
                scope.spawn(move || {
                    while let Some(&index) = missing.get(next.fetch_add(1, Ordering::Relaxed)) {
                        if sender.send((index, workshop.sequence(index))).is_err() {
                            break;
                        }
                    }
                });
            }
            drop(sender);
            for (index, shard) in made {
                base.write(index, &shard.map_err(|e| e.within(&format!("sequence {index}")))?)?;
                bar.inc(1);
                if interrupt.is_set() {
                    return Err(CliError::Failure(format!(
                        "interrupted: {} of {} sequences are in {}; the same command goes on",
                        base.settings().shards - base.missing().len(),
                        base.settings().shards,
                        folder.display()
                    )));
                }
            }
            Ok::<_, CliError>(())
        })?;
        Ok::<_, CliError>(base)
    })
}

/// Whether a sequence of so many is held out; the last one where there are few.
fn is_held_out(index: usize, count: usize) -> bool {
    index % HELD_OUT == HELD_OUT - 1 || (count < HELD_OUT && index == count - 1)
}

/// Shards to learn from, and those held out.
fn shards(base: &LearningBase) -> Result<(Vec<Shard>, Vec<Shard>), CliError> {
    let (mut train, mut held_out) = (Vec::new(), Vec::new());
    let count = base.settings().shards;
    for index in 0..count {
        let list = if is_held_out(index, count) { &mut held_out } else { &mut train };
        list.push(base.read(index)?);
    }
    Ok((train, held_out))
}

/// Trains from the start, or from the checkpoint.
fn learn(
    settings: &TrainSettings,
    (shards, held_out, turns): (Vec<Shard>, &[Shard], &[PixelTurn]),
    base: &str,
    (checkpoint, threads, engine, interrupt): (&Path, usize, Engine, &Interrupt),
    progress: &mut Progress,
) -> Result<Trainer, CliError> {
    let history = settings.shape.history;
    let train = Examples::new(&shards, history)?.turned(turns)?;
    // hundreds of megabytes that are not looked at again
    drop(shards);
    let held_out = Examples::new(held_out, history)?;
    let mut trainer = match checkpoint.exists() {
        true => Trainer::resume(checkpoint, settings, base)?,
        false => Trainer::new(settings, base)?,
    };
    trainer.set_engine(engine)?;
    let steps = train.len().div_ceil(settings.batch);
    progress.steps("training", settings.epochs * steps, |bar| {
        while trainer.status() == TrainStatus::Running {
            let done = trainer.curve().len() * steps;
            let made = trainer.epoch(&train, &held_out, threads, &mut |step, _| {
                bar.set_position((done + step) as u64);
                match interrupt.is_set() {
                    true => ControlFlow::Break(()),
                    false => ControlFlow::Continue(()),
                }
            })?;
            if made.is_none() {
                break;
            }
            trainer.save(checkpoint)?;
        }
        if trainer.curve().is_empty() {
            return Err(CliError::Failure(
                "interrupted in the first epoch: nothing is learnt yet; the learning base stays"
                    .to_owned(),
            ));
        }
        Ok(trainer)
    })
}

fn status_words(status: TrainStatus) -> &'static str {
    match status {
        TrainStatus::Running => "interrupted: the same command goes on",
        TrainStatus::Done => "all done",
        TrainStatus::Stopped => "stopped early",
    }
}

/// What the weights' file says of them.
fn about(
    scene: &Scene,
    base: &LearningBase,
    checksum: &str,
    trainer: &Trainer,
    (scores, limit): (&Scores, Option<f64>),
) -> BTreeMap<String, String> {
    let settings = trainer.settings();
    let best = trainer.best();
    let entries = [
        ("scene", scene.name.clone()),
        ("base", checksum.to_owned()),
        ("recipe", base.settings().recipe.clone()),
        ("sequences", base.settings().shards.to_string()),
        ("examples", base.frames().to_string()),
        ("seed", settings.seed.to_string()),
        ("epochs", trainer.curve().len().to_string()),
        ("best_epoch", best.map_or(String::new(), |e| e.epoch.to_string())),
        ("batch", settings.batch.to_string()),
        ("rate", settings.rate.to_string()),
        ("held_out_error", best.map_or(String::new(), |e| e.held_out_error.to_string())),
        ("held_out_net_over_raw", scores.net_over_raw.to_string()),
        ("held_out_rule_over_raw", scores.rule_over_raw.to_string()),
        ("program", format!("eit {}", env!("CARGO_PKG_VERSION"))),
        ("commit", env!("EIT_COMMIT").to_owned()),
    ];
    let limit = limit.map(|limit| ("misfit_limit", limit.to_string()));
    entries.into_iter().chain(limit).map(|(key, value)| (key.to_owned(), value)).collect()
}

/// A file beside the weights.
fn beside(weights: &Path, extension: &str) -> PathBuf {
    debug_assert_ne!(ending(weights), extension);
    weights.with_extension(extension)
}
