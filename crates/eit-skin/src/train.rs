//! A learning base out of simulated touches or recordings, then a U-net.

mod held_out;
mod motion;
mod recorded;
mod sequences;
mod shared;
mod simulated;

pub use held_out::{held_out_scores, misfit_limit};
pub use sequences::Sequences;

use crate::denoise::Scores;
use crate::error::SkinError;
use crate::progress::Progress;
use crate::skin::Skin;
use crate::stop::StopFlag;
use eit_denoise::{
    BaseSettings, Engine, Examples, LearningBase, Shard, TrainSettings, TrainStatus, Trainer,
    Weights,
};
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;

/// One sequence of so many is held out.
const HELD_OUT: usize = 6;

/// What a learning base is made of.
#[derive(Debug, Clone, Default)]
pub struct BaseRequest {
    /// Method of the raw images; `None`: the scene's.
    pub method: Option<String>,
    /// Frames of a simulated sequence.
    pub frames: usize,
    /// Fingers of every simulated sequence; `None`: drawn.
    pub fingers: Option<usize>,
    /// Recordings to learn from instead of simulated touches.
    pub recording: Vec<PathBuf>,
    /// Sequences, one in six of them held out.
    pub sequences: usize,
    /// Seed of everything drawn.
    pub seed: u64,
}

impl BaseRequest {
    /// Rejects settings that no base can be made with, before any work.
    pub fn validate(&self) -> Result<(), SkinError> {
        if !self.recording.is_empty() && self.fingers.is_some() {
            return Err(SkinError::input("--fingers: a recording has the fingers that it has"));
        }
        if self.sequences < 2 {
            return Err(SkinError::input("--sequences: at least 2, as one is held out"));
        }
        Ok(())
    }
}

/// The learning base in a folder, complete: sequences that are missing are made, on so many threads.
pub fn base(
    request: &BaseRequest,
    sequences: &Sequences,
    folder: &Path,
    threads: usize,
    stop: &StopFlag,
    progress: &mut Progress,
) -> Result<LearningBase, SkinError> {
    let settings = BaseSettings {
        skin: sequences.skin().fingerprint.clone(),
        pixels: sequences.pixels(),
        seed: request.seed,
        shards: request.sequences,
        recipe: sequences.recipe(),
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
                        if sender.send((index, sequences.sequence(index))).is_err() {
                            break;
                        }
                    }
                });
            }
            drop(sender);
            for (index, shard) in made {
                base.write(index, &shard.map_err(|e| e.within(&format!("sequence {index}")))?)?;
                bar.inc();
                if stop.is_set() {
                    return Err(SkinError::Failure(format!(
                        "interrupted: {} of {} sequences are in {}; the same command goes on",
                        base.settings().shards - base.missing().len(),
                        base.settings().shards,
                        folder.display()
                    )));
                }
            }
            Ok::<_, SkinError>(())
        })?;
        Ok::<_, SkinError>(base)
    })
}

/// Whether a sequence of so many is held out; the last one where there are few.
fn is_held_out(index: usize, count: usize) -> bool {
    index % HELD_OUT == HELD_OUT - 1 || (count < HELD_OUT && index == count - 1)
}

/// Shards to learn from, and those held out.
pub fn shards(base: &LearningBase) -> Result<(Vec<Shard>, Vec<Shard>), SkinError> {
    let (mut train, mut held_out) = (Vec::new(), Vec::new());
    let count = base.settings().shards;
    for index in 0..count {
        let list = if is_held_out(index, count) { &mut held_out } else { &mut train };
        list.push(base.read(index)?);
    }
    Ok((train, held_out))
}

/// How a net is trained.
#[derive(Debug, Clone, Copy)]
pub struct Training<'a> {
    /// Shape of the net, steps and rates.
    pub settings: &'a TrainSettings,
    /// Checksum of the learning base.
    pub base: &'a str,
    /// Written after every epoch; training goes on from it where it is there.
    pub checkpoint: &'a Path,
    /// Threads; the result does not depend on them.
    pub threads: usize,
    /// What computes the steps.
    pub engine: Engine,
    /// Set from outside to end it.
    pub stop: &'a StopFlag,
}

/// Trains from the start, or from the checkpoint.
pub fn learn(
    training: &Training<'_>,
    sequences: &Sequences,
    shards: Vec<Shard>,
    held_out: &[Shard],
    progress: &mut Progress,
) -> Result<Trainer, SkinError> {
    let Training { settings, base, checkpoint, threads, engine, stop } = *training;
    let history = settings.shape.history;
    let train = Examples::new(&shards, history)?.augmented(&sequences.turns())?;
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
                bar.set_position(done + step);
                match stop.is_set() {
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
            return Err(SkinError::Failure(
                "interrupted in the first epoch: nothing is learnt yet; the learning base stays"
                    .to_owned(),
            ));
        }
        Ok(trainer)
    })
}

/// What a trained net is worth on sequences that it did not learn from.
#[derive(Debug, Clone, Copy)]
pub struct Worth {
    /// Error beside that of the raw images.
    pub scores: Scores,
    /// Part of the data's energy that known images leave unexplained.
    pub misfit_limit: Option<f64>,
}

/// Which program wrote a file of weights.
#[derive(Debug, Clone, Copy)]
pub struct MadeBy<'a> {
    /// Name and version.
    pub program: &'a str,
    /// Commit that it was built from.
    pub commit: &'a str,
}

/// The trained weights with what their file says of them; `program` and `commit` made them.
pub fn weights(
    skin: &Skin,
    base: &LearningBase,
    trainer: &Trainer,
    worth: &Worth,
    made_by: &MadeBy<'_>,
) -> Result<Weights, SkinError> {
    let Worth { scores, misfit_limit: limit } = worth;
    let settings = trainer.settings();
    let best = trainer.best();
    let entries = [
        ("scene", skin.name.clone()),
        ("base", base.checksum()?),
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
        ("program", made_by.program.to_owned()),
        ("commit", made_by.commit.to_owned()),
    ];
    let limit = limit.map(|limit| ("misfit_limit", limit.to_string()));
    let about: BTreeMap<String, String> =
        entries.into_iter().chain(limit).map(|(key, value)| (key.to_owned(), value)).collect();
    let bare = trainer.weights(&skin.fingerprint, base.settings().pixels, BTreeMap::new());
    Ok(Weights { about, ..bare })
}
