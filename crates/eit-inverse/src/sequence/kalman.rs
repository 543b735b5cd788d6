//! Random walk of the image: Kalman filter and smoother.

use super::markov::{Belief, Markov, smooth};
use super::modes::{Modes, whiten};
use crate::check::check_length;
use crate::{
    DifferenceFrames, ImageSequence, InverseError, OneStepSettings, Prior, SequenceSolver,
};
use ndarray::ArrayRef2;

/// Smallest ratio of process noise to initial variance: below, `phi^2 C + q I` loses `q` in the
/// rounding of `C` and the walk would stand still unnoticed.
const LEAST_NOISE: f64 = 1e-12;

/// Least and greatest variance: beyond, one number or the other is lost in the rounding of sums
/// with the prior's 1.
const VARIANCES: std::ops::RangeInclusive<f64> = 1e-12..=1e12;

/// Settings of [`KalmanSmoother`] and [`KalmanFilter`].
#[derive(Debug, Clone, PartialEq)]
pub struct KalmanSettings {
    /// Hyperparameter, data, noise and channels, as for a single frame.
    pub one_step: OneStepSettings,
    /// `q`: variance that the image gains from one frame to the next, as a part of the prior
    /// covariance `P`; dimensionless, per frame (per second divided by the frame rate in hertz).
    /// Default 0.1: in ten frames the image may become another one. At least 1e-12 of
    /// `initial_variance`.
    pub process_noise: f64,
    /// `p0`: variance of the first frame's image, as a part of `P`. Default 1: a first frame looks
    /// as from [`OneStepGaussNewton`](crate::OneStepGaussNewton).
    pub initial_variance: f64,
}

impl Default for KalmanSettings {
    fn default() -> Self {
        let one_step = OneStepSettings::default();
        Self { one_step, process_noise: 0.1, initial_variance: 1.0 }
    }
}

impl KalmanSettings {
    fn process(&self) -> Result<Markov, InverseError> {
        for (quantity, value) in [
            ("initial_variance", self.initial_variance),
            ("process_noise per frame", self.process_noise),
        ] {
            if !VARIANCES.contains(&value) {
                return Err(InverseError::OutOfRange {
                    quantity,
                    value,
                    must: "between 1e-12 and 1e12",
                });
            }
        }
        if self.process_noise < LEAST_NOISE * self.initial_variance {
            return Err(InverseError::OutOfRange {
                quantity: "process_noise per frame",
                value: self.process_noise,
                must: "at least 1e-12 of initial_variance",
            });
        }
        let Self { process_noise, initial_variance, .. } = *self;
        Ok(Markov { decay: 1.0, process_noise, initial_variance })
    }
}

/// The most probable sequence for images that walk at random.
///
/// ```text
/// dsigma_1 ~ N(0, p0 P),   dsigma_t+1 = dsigma_t + N(0, q P),   dv_t = J dsigma_t + N(0, mu W^-1)
/// ```
///
/// with `J`, `W`, `P` and `mu = lambda^2 s` of [`OneStepGaussNewton`](crate::OneStepGaussNewton).
/// Kalman filter and Rauch-Tung-Striebel smoother on the eigenvectors of `W^1/2 J P J' W^1/2`: `r`
/// scalar filters, 10 flops each a frame, beside the `2 r (m + n)` of the image. Masked channels
/// cost as told at [`TimePrior`](crate::sequence::TimePrior); a frame without a good channel is
/// interpolated. Images are `[frame, element]`, siemens (per square).
///
/// Source: Rauch, Tung, Striebel, *AIAA J.* 3 (1965), 1445-1450; Vauhkonen, Karjalainen, Kaipio,
/// *IEEE Trans. Biomed. Eng.* 45 (1998), 486-493.
#[derive(Debug, Clone)]
pub struct KalmanSmoother {
    modes: Modes,
    process: Markov,
}

impl KalmanSmoother {
    /// Set-up for a linearisation; `jacobian` is `[measurement, element]`, volts per siemens.
    ///
    /// Costs what [`OneStepGaussNewton::new`](crate::OneStepGaussNewton::new) does.
    ///
    /// # Errors
    /// As there; [`InverseError::OutOfRange`] for the variances.
    pub fn new(
        jacobian: &ArrayRef2<f64>,
        prior: &dyn Prior,
        settings: &KalmanSettings,
    ) -> Result<Self, InverseError> {
        let process = settings.process()?;
        Ok(Self { modes: Modes::new(jacobian, prior, &settings.one_step)?, process })
    }
}

impl SequenceSolver for KalmanSmoother {
    fn name(&self) -> &'static str {
        "kalman-smoother"
    }

    fn reconstruct_sequence(
        &mut self,
        frames: &DifferenceFrames<'_>,
    ) -> Result<ImageSequence, InverseError> {
        smooth(self.name(), &self.modes, &self.process, frames)
    }
}

/// The causal half of [`KalmanSmoother`]: the most probable image given the frames so far.
///
/// A frame costs `2 r (m + n)` flops and allocates nothing until a channel is first masked; from
/// then on, until [`reset`](Self::reset), covariances are `r x r` and a frame costs
/// `4 m r^2 + 5 r^3` flops more and allocates. Leave out a dead electrode by
/// [`OneStepSettings::used`] instead.
#[derive(Debug, Clone)]
pub struct KalmanFilter {
    modes: Modes,
    process: Markov,
    belief: Belief,
    frames: usize,
    whitened: Vec<f64>,
    masked: Vec<usize>,
    coefficients: Vec<f64>,
}

impl KalmanFilter {
    /// Set-up as [`KalmanSmoother::new`].
    ///
    /// # Errors
    /// As there.
    pub fn new(
        jacobian: &ArrayRef2<f64>,
        prior: &dyn Prior,
        settings: &KalmanSettings,
    ) -> Result<Self, InverseError> {
        let process = settings.process()?;
        let modes = Modes::new(jacobian, prior, &settings.one_step)?;
        let (used, rank) = (modes.channels.used.len(), modes.rank());
        Ok(Self {
            belief: Belief::initial(&process, rank),
            process,
            frames: 0,
            whitened: vec![0.0; used],
            masked: Vec::with_capacity(used),
            coefficients: vec![0.0; rank],
            modes,
        })
    }

    /// Measurements of the protocol: the length of a frame.
    pub fn measurements(&self) -> usize {
        self.modes.channels.count
    }

    /// Elements: the length of an image.
    pub fn image_len(&self) -> usize {
        self.modes.elements()
    }

    /// Frames taken in since set-up or [`reset`](Self::reset).
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Forgets all frames.
    pub fn reset(&mut self) {
        self.belief = Belief::initial(&self.process, self.modes.rank());
        self.frames = 0;
    }

    /// Takes in the next frame's difference data `[measurement]` and writes its image `[element]`,
    /// siemens (per square). Channels where `good` is false are not looked at.
    ///
    /// # Errors
    /// Wrong lengths, a value of a good channel that is not finite (the frame in the error counts
    /// from [`reset`](Self::reset)): the filter is as before the call.
    /// [`InverseError::Factorisation`] where numbers leave the range of doubles:
    /// [`reset`](Self::reset) it then.
    pub fn push(
        &mut self,
        difference: &[f64],
        good: Option<&[bool]>,
        image: &mut [f64],
    ) -> Result<(), InverseError> {
        let measurements = self.measurements();
        check_length("difference", difference.len(), measurements)?;
        check_length("good", good.map_or(measurements, <[bool]>::len), measurements)?;
        check_length("image", image.len(), self.image_len())?;
        let is_good = |i: usize| good.is_none_or(|good| good[i]);
        let value_of = |i: usize| difference[i];
        let Self { modes, whitened, masked, coefficients, belief, .. } = self;
        whiten(&modes.channels, self.frames, value_of, is_good, whitened, masked)?;
        if self.frames > 0 {
            belief.predict(&self.process);
        }
        belief.update(modes, whitened, masked, coefficients)?;
        self.frames += 1;
        coefficients.copy_from_slice(&belief.mean);
        modes.image(coefficients, image);
        Ok(())
    }
}
