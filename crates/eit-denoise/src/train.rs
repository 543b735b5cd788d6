//! Training with burn: its automatic differentiation and Adam on batches in a seeded order, a
//! decreasing learning rate, early stopping, checkpoints.
//!
//! The checkpoint holds everything that the next epoch depends on, and every random number follows from
//! the seed and the number of the epoch. On the processor a batch is split into parts of a fixed
//! size whose gradients are added in order. An interrupted training run therefore ends with the same bits as
//! an uninterrupted one, for any number of threads. (On a graphics processor that holds if its sums are
//! reproducible. Resumed on another device, the results agree to rounding.)

mod checkpoint;
mod step;

pub use step::{TrainStep, weighted_errors};

use crate::{DenoiseError, Epoch, Examples, ImageNet, TrainSettings, TrainStatus, Unet, Weights};
use burn::grad_clipping::GradientClippingConfig;
use burn::module::{ModuleVisitor, Param};
use burn::optim::{AdamConfig, ModuleOptimizer};
use burn::tensor::Tensor;
use eit_core::Random;
use std::collections::BTreeMap;
use std::fmt;
use std::ops::ControlFlow;

/// Steps over which the rate rises from zero (fewer if the first epoch is shorter). Otherwise the first
/// steps at full rate can push every channel of a small net below zero, where its gradient is zero.
const WARM_UP: f64 = 200.0;
/// Largest norm of the gradient of each tensor. Single batches of nearly right images otherwise push
/// channels below zero for good.
const MOST_GRADIENT: f32 = 1.0;
/// Epsilon of Adam, from its paper.
const EPSILON: f32 = 1e-8;

/// Trains any net, epoch by epoch.
#[derive(Clone)]
pub struct Trainer<N> {
    settings: TrainSettings,
    net: N,
    optimiser: ModuleOptimizer,
    /// Net of the best epoch, without automatic differentiation.
    best: N,
    curve: Vec<Epoch>,
    /// Fingerprint of the learning base.
    base: String,
}

impl<N: ImageNet> fmt::Debug for Trainer<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Trainer")
            .field("settings", &self.settings)
            .field("net", &self.net.name())
            .field("curve", &self.curve)
            .field("base", &self.base)
            .finish_non_exhaustive()
    }
}

impl<N: ImageNet> Trainer<N> {
    /// Starts the training of a net on a device with automatic differentiation
    /// ([`crate::TrainDevice::open`]). `base` identifies the learning base: a checkpoint can only be
    /// resumed with the same one.
    ///
    /// # Errors
    /// Those of [`TrainSettings::validate`]; [`DenoiseError::OutOfRange`] for a net whose history or
    /// multiple is 0, [`DenoiseError::Burn`] for one without parameters.
    pub fn new(net: N, settings: &TrainSettings, base: &str) -> Result<Self, DenoiseError> {
        settings.validate()?;
        crate::nets::device_of(&net)?;
        let clipping = Some(GradientClippingConfig::Norm(MOST_GRADIENT));
        let adam = AdamConfig::new().with_epsilon(EPSILON).with_grad_clipping(clipping);
        let (best, optimiser) = (net.valid(), adam.init());
        let (settings, base) = (settings.clone(), base.to_owned());
        Ok(Self { settings, net, optimiser, best, curve: Vec::new(), base })
    }

    /// Returns the learning curve so far.
    pub fn curve(&self) -> &[Epoch] {
        &self.curve
    }

    /// Returns the settings of the training, as given to the constructor.
    pub fn settings(&self) -> &TrainSettings {
        &self.settings
    }

    /// Returns the epoch with the smallest held-out error.
    pub fn best(&self) -> Option<&Epoch> {
        self.curve.iter().min_by(|a, b| a.held_out_error.total_cmp(&b.held_out_error))
    }

    /// Returns the net of the best epoch so far, without automatic differentiation.
    pub fn best_net(&self) -> &N {
        &self.best
    }

    /// Returns whether another epoch follows.
    pub fn status(&self) -> TrainStatus {
        let TrainSettings { epochs, patience, .. } = self.settings;
        let best = self.best().map_or(0, |best| best.epoch);
        match self.curve.len() {
            done if done >= epochs => TrainStatus::Done,
            done if patience > 0 && done > best + patience => TrainStatus::Stopped,
            _ => TrainStatus::Running,
        }
    }

    /// Runs one epoch: one pass over the examples. `progress` is called with the number of steps done
    /// and the number of all steps. If it breaks off, the trainer stays as it was before the epoch and `None` is
    /// returned. More than one thread is used on the processor only.
    ///
    /// # Errors
    /// [`DenoiseError::NothingToLearn`] without examples, [`DenoiseError::WrongLength`] for
    /// examples with other inputs than the net's, [`DenoiseError::OutOfRange`] for 0 threads,
    /// [`DenoiseError::NonFiniteWeight`] or [`DenoiseError::OutOfRange`] if the rate is so large that
    /// the training diverges, [`DenoiseError::NetShape`], [`DenoiseError::Burn`].
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
        let TrainSettings { seed, epochs, batch, rate, .. } = self.settings;
        let epoch = self.curve.len();
        let part = epoch as f64 / epochs.saturating_sub(1).max(1) as f64;
        let rate = rate * (0.01 + 0.99 * 0.5 * (1.0 + (std::f64::consts::PI * part).cos()));
        let order = shuffled(train, seed, epoch);
        let (mut net, mut optimiser) = (self.net.clone(), self.optimiser.clone());
        let (mut sum, count) = (0.0, order.len().div_ceil(batch));
        let warm_up = WARM_UP.min(count as f64);
        for (step, batch) in order.chunks(batch).enumerate() {
            let made = TrainStep::of(&net, train, batch, threads)?;
            sum += made.errors;
            let warm = ((epoch * count + step + 1) as f64 / warm_up).min(1.0);
            net = optimiser.step(warm * rate, net, made.gradients);
            if progress(step + 1, count).is_break() {
                return Ok(None);
            }
        }
        check_finite(&net)?;
        let best = net.valid();
        let held_out_error = step::error(&best, held_out, threads)?;
        let (is_finite, must) = (held_out_error.is_finite(), "finite: take a smaller rate");
        DenoiseError::check_range(is_finite, "the held-out error", held_out_error, must)?;
        let done = Epoch { epoch, train_error: sum / train.len() as f64, held_out_error, rate };
        if self.best().is_none_or(|best| held_out_error < best.held_out_error) {
            self.best = best;
        }
        (self.net, self.optimiser) = (net, optimiser);
        self.curve.push(done);
        Ok(Some(done))
    }
}

impl Trainer<Unet> {
    /// Returns the weights of the best epoch so far, for [`crate::Denoiser`].
    ///
    /// # Errors
    /// Those of [`Unet::to_weights`].
    pub fn weights(
        &self,
        skin: &str,
        pixels: [usize; 2],
        about: &BTreeMap<String, String>,
    ) -> Result<Weights, DenoiseError> {
        self.best.to_weights(skin, pixels, about)
    }
}

/// Rejects a net with weights that are not finite.
fn check_finite<N: ImageNet>(net: &N) -> Result<(), DenoiseError> {
    struct Finite {
        seen: usize,
        result: Result<(), DenoiseError>,
    }
    impl ModuleVisitor for Finite {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            if self.result.is_err() {
                return;
            }
            self.result = crate::nets::read(param.val().reshape([-1])).and_then(|values| {
                let lost = values.iter().position(|w| !w.is_finite());
                let index = self.seen + lost.unwrap_or(0);
                self.seen += values.len();
                lost.map_or(Ok(()), |place| {
                    Err(DenoiseError::NonFiniteWeight { index, value: values[place] })
                })
            });
        }
    }
    let mut finite = Finite { seen: 0, result: Ok(()) };
    net.visit(&mut finite);
    finite.result
}

/// Returns the order of an epoch (Fisher and Yates shuffle), each example with a symmetry drawn for it,
/// as indices of [`Examples::get`].
fn shuffled(examples: &Examples, seed: u64, epoch: usize) -> Vec<usize> {
    let (count, turns) = (examples.len(), examples.turns());
    let mut random = Random::stream(seed, 1 + epoch as u128);
    let mut order: Vec<usize> = (0..count).map(|k| k + count * random.below(turns)).collect();
    for last in (1..count).rev() {
        order.swap(last, random.below(last + 1));
    }
    order
}
