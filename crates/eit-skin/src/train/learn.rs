//! Training on a learning base, and what the weights' file says of it.

use super::held_out::MeasuredJudge;
use super::sequences::Sequences;
use crate::denoise::Scores;
use crate::error::SkinError;
use crate::progress::Progress;
use crate::skin::Skin;
use crate::stop::StopFlag;
use eit_denoise::{
    Examples, ImageNet, LearningBase, Shard, TrainSettings, TrainStatus, TrainStep, Trainer, Unet,
    Weights,
};
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

/// Settings for training an [`eit_denoise::Unet`] or a net of your own.
#[derive(Debug, Clone, Copy)]
pub struct Training<'a> {
    /// Epochs, batches and learning rate.
    pub settings: &'a TrainSettings,
    /// Checksum of the learning base.
    pub base: &'a str,
    /// File written after every epoch; if it exists, training resumes from it.
    pub checkpoint: &'a Path,
    /// Number of threads; the result does not depend on it.
    pub threads: usize,
    /// Stops the training when set.
    pub stop: &'a StopFlag,
}

/// Trains a net from the start, or resumes from the checkpoint, on the net's own device
/// ([`eit_denoise::TrainDevice::open`]).
///
/// # Errors
///
/// A checkpoint of another training, a learning rate at which the training diverges, or a stop during the first
/// epoch.
pub fn learn<N: ImageNet>(
    net: N,
    training: &Training<'_>,
    sequences: &Sequences,
    shards: &[Shard],
    held_out: &[Shard],
    progress: &mut Progress,
) -> Result<Trainer<N>, SkinError> {
    let Training { settings, base, checkpoint, threads, stop } = *training;
    let (history, first) = (net.history(), net.clone());
    let train = Examples::new(shards, history)?.augmented(&sequences.turns())?;
    let held_out = Examples::new(held_out, history)?;
    let mut trainer = match checkpoint.exists() {
        true => Trainer::resume(checkpoint, net, settings, base)?,
        false => Trainer::new(net, settings, base)?,
    };
    let steps = train.len().div_ceil(settings.batch);
    let left = settings.epochs.saturating_sub(trainer.curve().len());
    progress.steps("training", settings.epochs * steps, |bar| {
        if left > 0 {
            let step_s = step_s(&first, &train, settings.batch, threads)?;
            bar.set_message(&format!(
                "training: {} examples of {} sequences, about {:.0} minutes",
                train.len(),
                shards.len(),
                (left * steps) as f64 * step_s / 60.0
            ));
        }
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

/// Time of a step, seconds: the second of two, since the first also sets up the device.
fn step_s<N: ImageNet>(
    net: &N,
    examples: &Examples,
    batch: usize,
    threads: usize,
) -> Result<f64, SkinError> {
    let batch: Vec<usize> = (0..examples.len().min(batch)).collect();
    TrainStep::of(net, examples, &batch, threads)?;
    let start = Instant::now();
    TrainStep::of(net, examples, &batch, threads)?;
    Ok(start.elapsed().as_secs_f64())
}

/// Quality of a trained net on held-out sequences.
#[derive(Debug, Clone)]
pub struct HeldOutResult {
    /// Error relative to the raw images.
    pub scores: Scores,
    /// Judge of the net's images.
    pub judge: Option<MeasuredJudge>,
}

/// The program that wrote a weights file.
#[derive(Debug, Clone, Copy)]
pub struct MadeBy<'a> {
    /// Name and version.
    pub program: &'a str,
    /// Commit that it was built from.
    pub commit: &'a str,
    /// [`parameter_checksum`] of the weights that the training started from; `None` for random ones.
    pub from: Option<&'a str>,
}

/// CRC-32 of the parameters, ignoring the metadata of their file.
pub fn parameter_checksum(weights: &Weights) -> String {
    let mut hasher = crc32fast::Hasher::new();
    weights.parameters.iter().for_each(|value| hasher.update(&value.to_le_bytes()));
    format!("{:08x}", hasher.finalize())
}

/// Returns the trained weights with the metadata of their file.
///
/// # Errors
///
/// A net with parameters that are not finite, or a base whose manifest cannot be read.
pub fn weights(
    skin: &Skin,
    base: &LearningBase,
    trainer: &Trainer<Unet>,
    result: &HeldOutResult,
    made_by: &MadeBy<'_>,
) -> Result<Weights, SkinError> {
    let HeldOutResult { scores, judge } = result;
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
    let from = made_by.from.map(|from| ("from", from.to_owned()));
    let about: BTreeMap<String, String> =
        entries.into_iter().chain(from).map(|(key, value)| (key.to_owned(), value)).collect();
    let weights = trainer.weights(&skin.fingerprint, base.settings().pixels, &about)?;
    Ok(Weights { model_error: judge.as_ref().map(|judge| judge.error.clone()), ..weights })
}

/// Returns existing weights with a judge measured on this base. Their metadata are kept, and the base of the
/// judge is added.
///
/// # Errors
///
/// A base without measurements, or with too few of them to measure a judge.
pub fn judged_weights(
    weights: Weights,
    base: &LearningBase,
    result: &HeldOutResult,
    made_by: &MadeBy<'_>,
) -> Result<Weights, SkinError> {
    let Some(judge) = &result.judge else {
        return Err(SkinError::Failure(
            "the learning base has no measurements, or too few to measure the judge".to_owned(),
        ));
    };
    let entries = [
        ("judge_base", base.checksum()?),
        ("judge_recipe", base.settings().recipe.clone()),
        ("judge_sequences", base.settings().shards.to_string()),
        ("judge_program", made_by.program.to_owned()),
        ("judge_commit", made_by.commit.to_owned()),
    ];
    let entries = entries.into_iter().map(|(key, value)| (key.to_owned(), value));
    let about = weights.about.iter().map(|(key, value)| (key.clone(), value.clone()));
    let about = about.chain(entries).collect();
    Ok(Weights { about, model_error: Some(judge.error.clone()), ..weights })
}
