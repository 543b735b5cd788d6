//! Training on a learning base, and what the weights' file says of it.

use super::BaseRequest;
use super::held_out::{MeasuredJudge, held_out_scores, judge};
use super::sequences::Sequences;
use crate::denoise::Scores;
use crate::error::SkinError;
use crate::progress::Progress;
use crate::skin::Skin;
use crate::stop::StopFlag;
use eit_denoise::{
    Examples, ImageNet, LearningBase, Shard, TrainSettings, TrainStatus, TrainStep, Trainer, Unet,
    UnetShape, Weights,
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
                if stop.is_set() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
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

/// A net to train for a skin.
#[derive(Debug)]
pub struct TrainRequest<'a> {
    /// The learning base, which is completed first.
    pub base: &'a BaseRequest,
    /// Its folder.
    pub folder: &'a Path,
    /// Size of the net.
    pub shape: UnetShape,
    /// Epochs, batches and learning rate.
    pub settings: TrainSettings,
    /// Weights to start from instead of random ones. With no epochs they are kept, and only their judge is measured.
    pub first: Option<Weights>,
    /// Where the net is trained ([`eit_denoise::TrainDevice::open`]).
    pub device: &'a eit_denoise::burn::tensor::Device,
    /// File written after every epoch; if it exists, training resumes from it.
    pub checkpoint: &'a Path,
    /// Name and version of the program, for the weights' file.
    pub made_by: &'a str,
    /// Number of threads; the result does not depend on it.
    pub threads: usize,
    /// Stops the training when set.
    pub stop: &'a StopFlag,
}

/// A trained net.
#[derive(Debug)]
pub struct Trained {
    /// The weights, with the metadata of their file.
    pub weights: Weights,
    /// The training, with its curve; `None` for a request without epochs.
    pub trainer: Option<Trainer<Unet>>,
    /// The learning base.
    pub base: LearningBase,
    /// Number of frames that were learnt from or held out.
    pub frames: usize,
    /// [`parameter_checksum`] of the weights that the training started from; `None` for random ones.
    pub from: Option<String>,
    /// Error on held-out sequences relative to the raw images.
    pub scores: Scores,
    /// Judge of the net's images.
    pub judge: Option<MeasuredJudge>,
}

/// Completes the learning base, and trains a U-net on it or resumes its training.
///
/// # Errors
///
/// Those of [`base`](super::base) and [`learn`]; first weights of another skin without epochs, and a base with too few
/// measurements to measure their judge.
pub fn train(
    skin: &Skin,
    request: TrainRequest<'_>,
    progress: &mut Progress,
) -> Result<Trained, SkinError> {
    let TrainRequest { shape, settings, first, threads, stop, made_by, .. } = request;
    let sequences = &Sequences::new(skin, request.base, progress)?;
    let base = super::base(request.base, sequences, request.folder, None, threads, stop, progress)?;
    let pairs = request.base.pairs;
    let (mut learnt, mut held_out) = progress.stage("read the base", || match pairs {
        // as in the paper, errors are those of the pairs themselves
        Some(count) => super::first_pairs(&base, count).map(|pairs| (pairs.clone(), pairs)),
        None => super::shards(&base),
    })?;
    progress.stage("inputs of the net", || {
        sequences.complete(&mut learnt, shape, threads)?;
        sequences.complete(&mut held_out, shape, threads)
    })?;
    let (checksum, pixels) = (base.checksum()?, base.settings().pixels);
    let from = first.as_ref().map(parameter_checksum);
    let (net, trainer) = match first {
        Some(weights) if settings.epochs == 0 => {
            let checked = weights.check_skin(&skin.fingerprint, pixels);
            checked.map_err(|e| SkinError::argument("epochs", format!("0: {e}")))?;
            (weights, None)
        }
        first => {
            let net = match &first {
                Some(weights) => Unet::from_weights(weights, request.device)?,
                None => Unet::new(shape, settings.seed, request.device)?,
            };
            let started = from.as_ref().map_or_else(String::new, |from| format!(" from {from}"));
            let training = Training {
                settings: &settings,
                base: &format!("{checksum}{started}"),
                checkpoint: request.checkpoint,
                threads,
                stop,
            };
            let trainer = learn(net, &training, sequences, &learnt, &held_out, progress)?;
            let net = trainer.weights(&skin.fingerprint, pixels, &BTreeMap::new())?;
            (net, Some(trainer))
        }
    };
    let (scores, judge) = progress.stage("compare", || {
        let scores = held_out_scores(&net, &held_out)?;
        let judge = match pairs {
            Some(_) => None,
            None => judge(&net, &learnt, &held_out, sequences)?,
        };
        Ok::<_, SkinError>((scores, judge))
    })?;
    let frames = pairs.unwrap_or(base.frames());
    let made = Trained { weights: net, trainer, base, frames, from, scores, judge };
    made.with_metadata(skin, made_by)
}

impl Trained {
    /// Adds to the weights what their file says about their origin. Weights that were not trained here keep theirs.
    fn with_metadata(self, skin: &Skin, program: &str) -> Result<Self, SkinError> {
        let (base, judge) = (self.base.settings(), self.judge.as_ref());
        let checksum = self.base.checksum()?;
        let Some(trainer) = &self.trainer else {
            let Some(judge) = judge else {
                return Err(SkinError::Failure(
                    "the learning base has no measurements, or too few to measure the judge"
                        .to_owned(),
                ));
            };
            let entries = [
                ("judge_base", checksum),
                ("judge_recipe", base.recipe.clone()),
                ("judge_sequences", base.shards.to_string()),
                ("judge_program", program.to_owned()),
            ];
            let mut weights = self.weights;
            weights.about.extend(entries.map(|(key, value)| (key.to_owned(), value)));
            weights.model_error = Some(judge.error.clone());
            return Ok(Self { weights, ..self });
        };
        let (settings, best) = (trainer.settings(), trainer.best());
        let entries = [
            ("scene", skin.name.clone()),
            ("base", checksum),
            ("recipe", base.recipe.clone()),
            ("sequences", base.shards.to_string()),
            ("examples", self.frames.to_string()),
            ("seed", settings.seed.to_string()),
            ("epochs", trainer.curve().len().to_string()),
            ("best_epoch", best.map_or(String::new(), |e| e.epoch.to_string())),
            ("batch", settings.batch.to_string()),
            ("rate", settings.rate.to_string()),
            ("held_out_error", best.map_or(String::new(), |e| e.held_out_error.to_string())),
            ("held_out_net_over_raw", self.scores.net_over_raw.to_string()),
            ("held_out_rule_over_raw", self.scores.rule_over_raw.to_string()),
            ("program", program.to_owned()),
        ];
        let from = self.from.as_ref().map(|from| ("from", from.clone()));
        let about = entries.into_iter().chain(from).map(|(key, value)| (key.to_owned(), value));
        let weights = trainer.weights(&skin.fingerprint, base.pixels, &about.collect())?;
        let model_error = judge.map(|judge| judge.error.clone());
        Ok(Self { weights: Weights { model_error, ..weights }, ..self })
    }
}

/// CRC-32 of the parameters, ignoring the metadata of their file.
pub fn parameter_checksum(weights: &Weights) -> String {
    let mut hasher = crc32fast::Hasher::new();
    weights.parameters.iter().for_each(|value| hasher.update(&value.to_le_bytes()));
    format!("{:08x}", hasher.finalize())
}
