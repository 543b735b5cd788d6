//! A learning base out of simulated touches or recordings (feature `base`), then a net (feature
//! `train`).

#[cfg(feature = "train")]
mod held_out;
#[cfg(feature = "train")]
mod learn;
mod motion;
mod recorded;
mod sequences;
mod shared;
mod simulated;

#[cfg(feature = "train")]
pub use held_out::{JudgeCounts, MeasuredJudge};
#[cfg(feature = "train")]
pub use learn::{TrainRequest, Trained, Training, learn, parameter_checksum, train};
pub use sequences::Sequences;

use crate::error::SkinError;
use crate::progress::Progress;
use crate::stop::StopFlag;
use eit_denoise::{BaseSettings, LearningBase, Part, Shard};
#[cfg(feature = "train")]
use ndarray::{ArrayView2, Axis};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;

/// One in this many sequences is held out.
const HELD_OUT: usize = 6;

/// Settings of a learning base.
#[derive(Debug, Clone, Default)]
pub struct BaseRequest {
    /// Method of the raw images; `None` for the scene's.
    pub method: Option<String>,
    /// Number of frames of a simulated sequence.
    pub frames: usize,
    /// Number of fingers in every simulated sequence; `None` for a random number.
    pub fingers: Option<usize>,
    /// Share of simulated sequences, 0 to 1, that certainly have tips of about usual size; the others have tips of
    /// any size.
    pub usual_tips: f64,
    /// Built-in script, simulated on the skin's own fabric; `None` for random touches on random fabrics.
    pub script: Option<String>,
    /// Recordings to learn from instead of simulated touches.
    pub recording: Vec<PathBuf>,
    /// Number of sequences, one in six of which is held out; not used with `pairs`.
    pub sequences: usize,
    /// As in the paper: train on this many pairs of the recordings and, once these have no more, of one turned or
    /// mirrored copy of each. Frames without a touch do not count; nothing is held out or augmented.
    pub pairs: Option<usize>,
    /// Seed of all random quantities.
    pub seed: u64,
}

impl BaseRequest {
    /// Rejects invalid settings, before any work.
    ///
    /// # Errors
    ///
    /// Settings that exclude each other, or fewer than two sequences.
    pub fn validate(&self) -> Result<(), SkinError> {
        if !self.recording.is_empty() && self.fingers.is_some() {
            return Err(SkinError::argument("fingers", "a recording has the fingers that it has"));
        }
        if self.script.is_some() && self.fingers.is_some() {
            return Err(SkinError::argument(
                "fingers",
                "a built-in script has the fingers that it has",
            ));
        }
        if !(0.0..=1.0).contains(&self.usual_tips) {
            return Err(SkinError::argument("usual_tips", format!("{}: 0 to 1", self.usual_tips)));
        }
        if self.usual_tips > 0.0 && (self.script.is_some() || !self.recording.is_empty()) {
            return Err(SkinError::argument(
                "usual_tips",
                "a built-in script and a recording have the tips that they have",
            ));
        }
        if self.pairs.is_some() && self.recording.is_empty() {
            return Err(SkinError::argument("pairs", "only of recordings"));
        }
        if self.sequence_count() < 2 {
            return Err(SkinError::argument("sequences", "at least 2, as one is held out"));
        }
        Ok(())
    }

    /// Number of sequences to make.
    pub fn sequence_count(&self) -> usize {
        match self.pairs {
            Some(_) => 2 * self.recording.len(),
            None => self.sequences,
        }
    }
}

/// Completes the learning base in a folder, or one part of it: makes the missing sequences, on `threads`
/// threads.
///
/// # Errors
///
/// A folder with another base; the errors of making the sequences; an interruption.
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
        shards: request.sequence_count(),
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

/// Returns whether sequence `index` of `count` is held out; of a few, it is the last.
fn is_held_out(index: usize, count: usize) -> bool {
    index % HELD_OUT == HELD_OUT - 1 || (count < HELD_OUT && index == count - 1)
}

/// Number of a sequence among the held-out ones, or among the others.
fn number_within(index: usize, count: usize) -> usize {
    let before = index / HELD_OUT;
    if is_held_out(index, count) { before } else { index - before }
}

/// Reads the shards to train on, and those held out.
///
/// # Errors
///
/// A base that is incomplete or damaged.
pub fn shards(base: &LearningBase) -> Result<(Vec<Shard>, Vec<Shard>), SkinError> {
    let (mut train, mut held_out) = (Vec::new(), Vec::new());
    let count = base.settings().shards;
    for index in 0..count {
        let list = if is_held_out(index, count) { &mut held_out } else { &mut train };
        list.push(base.read(index)?);
    }
    Ok((train, held_out))
}

/// Reads the first `count` pairs of a base with a touch, in order: the wanted image is not empty, and a touch was found
/// where touches were sought.
///
/// # Errors
///
/// A base that is incomplete or damaged, or has fewer pairs.
#[cfg(feature = "train")]
fn first_pairs(base: &LearningBase, count: usize) -> Result<Vec<Shard>, SkinError> {
    let (mut left, mut pairs) = (count, Vec::new());
    for index in 0..base.settings().shards {
        let shard = base.read(index)?;
        let is_any = |values: ArrayView2<'_, f32>| values.iter().any(|v| *v != 0.0 && !v.is_nan());
        let has_touch = |frame: &usize| {
            let found =
                shard.touches.as_ref().map(|found| is_any(found.index_axis(Axis(0), *frame)));
            is_any(shard.wanted.index_axis(Axis(0), *frame)) && found.unwrap_or(true)
        };
        let frames: Vec<usize> = (0..shard.wanted.dim().0).filter(has_touch).take(left).collect();
        left -= frames.len();
        if !frames.is_empty() {
            pairs.push(shard.of_frames(&frames));
        }
    }
    if left > 0 {
        let most = count - left;
        let why = format!("{count}, but the recordings and a turned copy of each have {most}");
        return Err(SkinError::argument("pairs", why));
    }
    Ok(pairs)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Held-out sequences and the others are counted one after the other, so that every recording is used.
    #[test]
    fn sequences_are_counted_within_their_kind() {
        for count in [1, 5, 6, 24, 25] {
            for held_out in [false, true] {
                let own = (0..count).filter(|&index| is_held_out(index, count) == held_out);
                let numbers: Vec<usize> = own.map(|index| number_within(index, count)).collect();
                assert_eq!(numbers, (0..numbers.len()).collect::<Vec<_>>(), "{count}, {held_out}");
            }
        }
    }
}
