//! A learning base out of simulated touches or recordings (feature `base`), then a net (feature
//! `train`).

mod held_out;
#[cfg(feature = "train")]
mod learn;
mod motion;
mod recorded;
mod sequences;
mod shared;
mod simulated;

pub use held_out::{JudgeCounts, MeasuredJudge, held_out_scores, judge};
#[cfg(feature = "train")]
pub use learn::{MadeBy, Training, Worth, judged_weights, learn, parameter_checksum, weights};
pub use sequences::Sequences;

use crate::error::SkinError;
use crate::progress::Progress;
use crate::stop::StopFlag;
use eit_denoise::{BaseSettings, LearningBase, Part, Shard};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;

/// One sequence of so many is held out.
const HELD_OUT: usize = 6;

/// What the wanted images of a simulated sequence are.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Wanted {
    /// The true change of conductivity.
    #[default]
    Truth,
    /// The raw images after [`eit_denoise::ThresholdRule`], as in the paper of Duan, Taurand and
    /// Soleimani.
    Rule,
}

/// What a learning base is made of.
#[derive(Debug, Clone, Default)]
pub struct BaseRequest {
    /// Method of the raw images; `None`: the scene's.
    pub method: Option<String>,
    /// Frames of a simulated sequence.
    pub frames: usize,
    /// Fingers of every simulated sequence; `None`: drawn.
    pub fingers: Option<usize>,
    /// Built-in script on the skin's own fabric for every simulated sequence; `None`: drawn touches on
    /// drawn fabrics.
    pub script: Option<String>,
    /// Wanted images of simulated sequences.
    pub wanted: Wanted,
    /// Recordings to learn from instead of simulated touches.
    pub recording: Vec<PathBuf>,
    /// Sequences, one in six of them held out.
    pub sequences: usize,
    /// Seed of everything drawn.
    pub seed: u64,
}

impl BaseRequest {
    /// Rejects settings that no base can be made with, before any work.
    ///
    /// # Errors
    ///
    /// Settings that exclude each other, and fewer than two sequences.
    pub fn validate(&self) -> Result<(), SkinError> {
        if !self.recording.is_empty() && self.fingers.is_some() {
            return Err(SkinError::input("--fingers: a recording has the fingers that it has"));
        }
        if self.script.is_some() && self.fingers.is_some() {
            return Err(SkinError::input(
                "--fingers: a built-in script has the fingers that it has",
            ));
        }
        if self.sequences < 2 {
            return Err(SkinError::input("--sequences: at least 2, as one is held out"));
        }
        Ok(())
    }
}

/// The learning base in a folder, complete, or one part of it: makes the sequences that are missing,
/// on so many threads.
///
/// # Errors
///
/// A folder with another base; those of the sequences; an interruption.
pub fn base(
    request: &BaseRequest,
    sequences: &Sequences,
    folder: impl AsRef<Path>,
    part: Option<Part>,
    threads: usize,
    stop: &StopFlag,
    progress: &mut Progress,
) -> Result<LearningBase, SkinError> {
    let folder = folder.as_ref();
    let settings = BaseSettings {
        skin: sequences.skin().fingerprint.clone(),
        pixels: sequences.pixels(),
        seed: request.seed,
        shards: request.sequences,
        recipe: sequences.recipe(),
    };
    let mut base = match part {
        None => LearningBase::create(folder, &settings)?,
        Some(part) => LearningBase::create_part(folder, &settings, part)?,
    };
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
///
/// # Errors
///
/// A base that is not complete, or whose files are damaged.
pub fn shards(base: &LearningBase) -> Result<(Vec<Shard>, Vec<Shard>), SkinError> {
    let (mut train, mut held_out) = (Vec::new(), Vec::new());
    let count = base.settings().shards;
    for index in 0..count {
        let list = if is_held_out(index, count) { &mut held_out } else { &mut train };
        list.push(base.read(index)?);
    }
    Ok((train, held_out))
}
