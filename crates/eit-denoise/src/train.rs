//! Training: batches in a seeded order, Adam, a falling rate, early stop, checkpoints.
//!
//! Everything that the next epoch depends on is in the checkpoint, and every random number comes
//! from the seed and the number of the epoch, so that a training that was interrupted ends with the
//! same bits as one that was not, for any number of threads. (burn's engines keep to that where their
//! device does; one that goes on with another engine ends within rounding.)

mod adam;
mod checkpoint;
mod engine;
mod examples;
mod raster_symmetry;

pub use engine::{Engine, Stepper};
pub use examples::Examples;
pub use raster_symmetry::RasterSymmetry;

use crate::{DenoiseError, UnetShape, Weights};
use adam::Adam;
use rand_distr::{Distribution as _, StandardNormal, StandardUniform};
use rand_pcg::Pcg64;
use std::collections::BTreeMap;
use std::ops::ControlFlow;

/// Steps over which the rate rises from zero, where the first epoch has so many. Without, the first steps at full rate can take every
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
    /// the last (Loshchilov and Hutter, ICLR 2017). Over the first 200 steps, or the
    /// first epoch where that is shorter, it rises from zero.
    pub rate: f64,
    /// Stop after so many epochs without a smaller error on the examples held out; 0: never.
    pub patience: usize,
}

impl Default for TrainSettings {
    fn default() -> Self {
        Self {
            shape: UnetShape::default(),
            seed: 1,
            epochs: 12,
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
    engine: Engine,
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
        let (settings, base, engine) = (settings.clone(), base.to_owned(), Engine::default());
        Ok(Self { settings, parameters, adam, best, curve: Vec::new(), base, engine })
    }

    /// What computes the steps from here on.
    ///
    /// # Errors
    /// Those of [`Engine::check`].
    pub fn set_engine(&mut self, engine: Engine) -> Result<(), DenoiseError> {
        engine.check()?;
        self.engine = engine;
        Ok(())
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
    /// that weights are lost, [`DenoiseError::EngineFailed`].
    pub fn epoch(
        &mut self,
        train: &Examples,
        held_out: &Examples,
        threads: usize,
        progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
    ) -> Result<Option<Epoch>, DenoiseError> {
        if train.is_empty() || held_out.is_empty() {
            let what = "the learning base or its held-out part".to_owned();
            return Err(DenoiseError::NothingToLearn { what });
        }
        let TrainSettings { shape, seed, epochs, batch, rate, .. } = self.settings;
        let mut steps = self.engine.start(shape, train.size(), threads)?;
        steps.check(train)?;
        steps.check(held_out)?;
        let epoch = self.curve.len();
        let part = epoch as f64 / epochs.saturating_sub(1).max(1) as f64;
        let rate = rate * (0.01 + 0.99 * 0.5 * (1.0 + (std::f64::consts::PI * part).cos()));
        let order = shuffled(train, seed, epoch);
        let (mut parameters, mut adam) = (self.parameters.clone(), self.adam.clone());
        let (mut sum, count) = (0.0, order.len().div_ceil(batch));
        let warm_up = WARM_UP.min(count as f64);
        for (step, batch) in order.chunks(batch).enumerate() {
            steps.load(&parameters)?;
            let (errors, gradient) = steps.step(train, batch)?;
            sum += errors;
            let warm = ((adam.steps + 1) as f64 / warm_up).min(1.0);
            adam.step(&mut parameters, gradient, warm * rate);
            if progress(step + 1, count).is_break() {
                return Ok(None);
            }
        }
        if let Some(index) = parameters.iter().position(|w| !w.is_finite()) {
            return Err(DenoiseError::NonFiniteWeight { index, value: parameters[index] });
        }
        steps.load(&parameters)?;
        let all: Vec<usize> = (0..held_out.len()).collect();
        let held_out_error = steps.error(held_out, &all)? / all.len() as f64;
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

/// The order of an epoch (Fisher and Yates), each example in a turn of its own: as
/// [`Examples::get`] counts.
fn shuffled(examples: &Examples, seed: u64, epoch: usize) -> Vec<usize> {
    let (count, turns) = (examples.len(), examples.turns());
    let mut random = Pcg64::new(u128::from(seed), 1 + epoch as u128);
    let mut below = |count: usize| {
        let unit: f64 = StandardUniform.sample(&mut random);
        (count as f64 * unit) as usize
    };
    let mut order: Vec<usize> = (0..count).map(|k| k + count * below(turns)).collect();
    for last in (1..count).rev() {
        order.swap(last, below(last + 1));
    }
    order
}
