//! Training: batches in a seeded order, Adam, a falling rate, early stop, checkpoints.
//!
//! Everything that the next epoch depends on is in the checkpoint, and every random number comes
//! from the seed and the number of the epoch, so that a training that was interrupted ends with the
//! same bits as one that was not, for any number of threads.

mod adam;
mod checkpoint;
mod examples;
mod turn;

pub use examples::Examples;
pub use turn::PixelTurn;

use crate::unet::{PackedNet, Tape};
use crate::{DenoiseError, UnetShape, Weights};
use adam::Adam;
use examples::Turned;
use rand_distr::{Distribution as _, StandardNormal, StandardUniform};
use rand_pcg::Pcg64;
use std::collections::BTreeMap;
use std::ops::ControlFlow;

/// Steps over which the rate rises from zero. Without, the first steps at full rate can take every
/// channel of a small net below zero, from where no derivative brings it back.
const WARM_UP: f64 = 200.0;

/// Biases before the first step.
const FIRST_BIAS: f32 = 0.05;

/// How to train.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainSettings {
    /// Size of the net.
    pub shape: UnetShape,
    /// First weights and order of the examples come from it.
    pub seed: u64,
    /// Epochs at most, from 1.
    pub epochs: usize,
    /// Examples of a step, from 1.
    pub batch: usize,
    /// Rate of Adam in the first epoch, above zero; it falls along half a cosine to a hundredth in
    /// the last (Loshchilov and Hutter, ICLR 2017). Over the first 200 steps it rises from zero.
    pub rate: f64,
    /// Stop after so many epochs without a smaller error on the examples held out; 0: never.
    pub patience: usize,
}

impl Default for TrainSettings {
    fn default() -> Self {
        Self {
            shape: UnetShape::default(),
            seed: 1,
            epochs: 30,
            batch: 16,
            rate: 2e-3,
            patience: 8,
        }
    }
}

impl TrainSettings {
    /// Refuses settings outside what is documented.
    ///
    /// # Errors
    /// [`DenoiseError::OutOfRange`].
    pub fn validate(&self) -> Result<(), DenoiseError> {
        self.shape.validate()?;
        for (quantity, value) in [("epochs", self.epochs), ("batch", self.batch)] {
            if value == 0 {
                return Err(DenoiseError::OutOfRange { quantity, value: 0.0, must: "at least 1" });
            }
        }
        if !(self.rate.is_finite() && self.rate > 0.0) {
            let (quantity, must) = ("rate", "finite and above zero");
            return Err(DenoiseError::OutOfRange { quantity, value: self.rate, must });
        }
        Ok(())
    }
}

/// One line of the learning curve. Errors are weighted mean squares: parts of the raw images' own,
/// as [`Examples::new`] tells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Epoch {
    /// From 0.
    pub epoch: usize,
    /// Mean over the epoch's steps, each before its own update.
    pub train_error: f64,
    /// On the examples held out, after the epoch.
    pub held_out_error: f64,
    /// Rate of Adam.
    pub rate: f64,
}

/// Whether another epoch follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrainStatus {
    /// It does.
    Running,
    /// All epochs are done.
    Done,
    /// The held-out error has not fallen for [`TrainSettings::patience`] epochs.
    Stopped,
}

/// A training, between two epochs.
#[derive(Debug, Clone)]
pub struct Trainer {
    settings: TrainSettings,
    parameters: Vec<f32>,
    adam: Adam,
    best: Vec<f32>,
    curve: Vec<Epoch>,
    /// Fingerprint of what it learns from.
    base: String,
}

impl Trainer {
    /// A new net; `base` names what it will learn from, so that a checkpoint meets no other.
    ///
    /// # Errors
    /// Those of [`TrainSettings::validate`].
    pub fn new(settings: &TrainSettings, base: &str) -> Result<Self, DenoiseError> {
        settings.validate()?;
        let parameters = first_parameters(settings);
        let (adam, best) = (Adam::new(parameters.len()), parameters.clone());
        let settings = settings.clone();
        Ok(Self { settings, parameters, adam, best, curve: Vec::new(), base: base.to_owned() })
    }

    /// The learning curve so far.
    pub fn curve(&self) -> &[Epoch] {
        &self.curve
    }

    /// How it is trained.
    pub fn settings(&self) -> &TrainSettings {
        &self.settings
    }

    /// The epoch with the smallest held-out error.
    pub fn best(&self) -> Option<&Epoch> {
        self.curve.iter().min_by(|a, b| a.held_out_error.total_cmp(&b.held_out_error))
    }

    /// Whether there is more to do.
    pub fn status(&self) -> TrainStatus {
        let TrainSettings { epochs, patience, .. } = self.settings;
        let best = self.best().map_or(0, |best| best.epoch);
        match self.curve.len() {
            done if done >= epochs => TrainStatus::Done,
            done if patience > 0 && done > best + patience => TrainStatus::Stopped,
            _ => TrainStatus::Running,
        }
    }

    /// The weights of the best epoch so far.
    pub fn weights(
        &self,
        skin: &str,
        pixels: [usize; 2],
        about: BTreeMap<String, String>,
    ) -> Weights {
        let (shape, parameters) = (self.settings.shape, self.best.clone());
        Weights { shape, parameters, skin: skin.to_owned(), pixels, about }
    }

    /// One pass over the examples. `progress` hears the steps done and may break off: the trainer
    /// is then as before the epoch, and `None` comes back.
    ///
    /// # Errors
    /// [`DenoiseError::NothingToLearn`] without examples, [`DenoiseError::WrongLength`] for
    /// examples with another number of frames, [`DenoiseError::OutOfRange`] for no thread,
    /// [`DenoiseError::NonFiniteWeight`] or [`DenoiseError::OutOfRange`] where the rate is so large
    /// that weights are lost.
    pub fn epoch(
        &mut self,
        train: &Examples,
        held_out: &Examples,
        threads: usize,
        progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
    ) -> Result<Option<Epoch>, DenoiseError> {
        self.check(train, held_out, threads)?;
        let TrainSettings { shape, seed, epochs, batch, rate, .. } = self.settings;
        let epoch = self.curve.len();
        let part = epoch as f64 / epochs.saturating_sub(1).max(1) as f64;
        let rate = rate * (0.01 + 0.99 * 0.5 * (1.0 + (std::f64::consts::PI * part).cos()));
        let order = shuffled((train.len(), train.turns()), seed, epoch);
        let mut tapes = vec![Tape::new(shape, train.size()); threads];
        let (mut parameters, mut adam) = (self.parameters.clone(), self.adam.clone());
        let (mut sum, steps) = (0.0, order.len().div_ceil(batch));
        let mut gradients = vec![vec![0.0; parameters.len()]; batch.min(order.len())];
        for (step, batch) in order.chunks(batch).enumerate() {
            let net = PackedNet::new(shape, &parameters);
            let errors = of_batch(&net, train, batch, &mut tapes, &mut gradients);
            sum += errors.iter().sum::<f64>();
            // in the order of the examples, whichever thread had them
            let (total, others) = gradients.split_at_mut(1);
            for other in &others[..batch.len() - 1] {
                for (total, other) in total[0].iter_mut().zip(other) {
                    *total += other;
                }
            }
            let warm = ((adam.steps + 1) as f64 / WARM_UP).min(1.0);
            adam.step(&mut parameters, &total[0], warm * rate);
            if progress(step + 1, steps).is_break() {
                return Ok(None);
            }
        }
        if let Some(index) = parameters.iter().position(|w| !w.is_finite()) {
            return Err(DenoiseError::NonFiniteWeight { index, value: parameters[index] });
        }
        let net = PackedNet::new(shape, &parameters);
        let held_out_error = error(&net, held_out, &mut tapes);
        if !held_out_error.is_finite() {
            let (quantity, must) = ("the held-out error", "finite: take a smaller rate");
            return Err(DenoiseError::OutOfRange { quantity, value: held_out_error, must });
        }
        (self.parameters, self.adam) = (parameters, adam);
        let done = Epoch { epoch, train_error: sum / train.len() as f64, held_out_error, rate };
        if self.best().is_none_or(|best| held_out_error < best.held_out_error) {
            self.best.clone_from(&self.parameters);
        }
        self.curve.push(done);
        Ok(Some(done))
    }

    fn check(
        &self,
        train: &Examples,
        held_out: &Examples,
        threads: usize,
    ) -> Result<(), DenoiseError> {
        for examples in [train, held_out] {
            if examples.is_empty() {
                let what = "the learning base or its held-out part".to_owned();
                return Err(DenoiseError::NothingToLearn { what });
            }
            let (found, wanted) = (examples.history(), self.settings.shape.history);
            if found != wanted {
                return Err(DenoiseError::WrongLength { what: "frames an example", found, wanted });
            }
            if examples.size() != train.size() {
                let (images, mask) = (examples.size(), train.size());
                return Err(DenoiseError::ShapeMismatch { images, mask });
            }
        }
        if threads == 0 {
            let (quantity, must) = ("threads", "at least 1");
            return Err(DenoiseError::OutOfRange { quantity, value: 0.0, must });
        }
        Ok(())
    }
}

/// He's normal weights (He, Zhang, Ren and Sun, ICCV 2015), the weights of each channel less their
/// mean, and small positive biases. Inputs of a channel are positive parts, so that most of what it
/// sees is their mean: a channel that happens to weigh it negatively would be zero on nearly the
/// whole skin, and with few channels soon all of them, from where no derivative leads back.
fn first_parameters(settings: &TrainSettings) -> Vec<f32> {
    let mut random = Pcg64::new(u128::from(settings.seed), 0);
    let mut parameters = Vec::with_capacity(settings.shape.parameters());
    for c in settings.shape.convolutions() {
        let of_channel = c.inputs * c.side * c.side;
        let std = (2.0 / of_channel as f64).sqrt();
        for _ in 0..c.outputs {
            let mut channel: Vec<f64> =
                (0..of_channel).map(|_| StandardNormal.sample(&mut random)).collect();
            let mean = channel.iter().sum::<f64>() / of_channel as f64;
            channel.iter_mut().for_each(|w| *w = std * (*w - mean));
            parameters.extend(channel.iter().map(|w| *w as f32));
        }
        parameters.extend(std::iter::repeat_n(FIRST_BIAS, c.outputs));
    }
    parameters
}

/// The order of an epoch (Fisher and Yates), and the turn of each example.
fn shuffled((count, turns): (usize, usize), seed: u64, epoch: usize) -> Vec<(usize, usize)> {
    let mut random = Pcg64::new(u128::from(seed), 1 + epoch as u128);
    let mut below = |count: usize| {
        let unit: f64 = StandardUniform.sample(&mut random);
        (count as f64 * unit) as usize
    };
    let mut order: Vec<(usize, usize)> = (0..count).map(|k| (k, below(turns))).collect();
    for last in (1..count).rev() {
        order.swap(last, below(last + 1));
    }
    order
}

/// Errors of a batch; each example's derivative of its part of the mean in a slice of its own.
fn of_batch(
    net: &PackedNet,
    examples: &Examples,
    batch: &[(usize, usize)],
    tapes: &mut [Tape],
    gradients: &mut [Vec<f32>],
) -> Vec<f64> {
    let weight = 1.0 / batch.len() as f32;
    let mut errors = vec![0.0; batch.len()];
    let share = batch.len().div_ceil(tapes.len());
    let parts = batch.chunks(share).zip(errors.chunks_mut(share)).zip(gradients.chunks_mut(share));
    std::thread::scope(|scope| {
        for (((batch, errors), gradients), tape) in parts.zip(tapes) {
            scope.spawn(move || {
                let mut turned = Turned::default();
                for ((&(k, turn), error), gradient) in batch.iter().zip(errors).zip(gradients) {
                    gradient.fill(0.0);
                    let example = examples.get_turned(k, turn, &mut turned);
                    *error = tape.run(net, &example, Some((weight, gradient)));
                }
            });
        }
    });
    errors
}

/// Mean error over examples.
fn error(net: &PackedNet, examples: &Examples, tapes: &mut [Tape]) -> f64 {
    let mut errors = vec![0.0; examples.len()];
    let share = examples.len().div_ceil(tapes.len());
    std::thread::scope(|scope| {
        for ((part, errors), tape) in errors.chunks_mut(share).enumerate().zip(tapes) {
            scope.spawn(move || {
                for (k, error) in errors.iter_mut().enumerate() {
                    *error = tape.run(net, &examples.get(part * share + k), None);
                }
            });
        }
    });
    errors.iter().sum::<f64>() / examples.len() as f64
}

/// Mean weighted squared error of parameters over examples, and its derivative: for tests of the derivative.
///
/// # Errors
/// [`DenoiseError::WrongLength`].
pub fn error_and_gradient(
    shape: UnetShape,
    parameters: &[f32],
    examples: &Examples,
) -> Result<(f64, Vec<f32>), DenoiseError> {
    shape.validate()?;
    let (found, wanted) = (parameters.len(), shape.parameters());
    if found != wanted {
        return Err(DenoiseError::WrongLength { what: "weights", found, wanted });
    }
    let net = PackedNet::new(shape, parameters);
    let mut tape = Tape::new(shape, examples.size());
    let mut gradient = vec![0.0; parameters.len()];
    let weight = 1.0 / examples.len() as f32;
    let run = |k: usize| tape.run(&net, &examples.get(k), Some((weight, &mut gradient)));
    let sum: f64 = (0..examples.len()).map(run).sum();
    Ok((sum / examples.len() as f64, gradient))
}
