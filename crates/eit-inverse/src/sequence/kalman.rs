//! Kalman filter and smoother for images that follow a random walk.

use super::markov::{Belief, Markov, smooth};
use super::modes::{Modes, whiten};
use crate::check::check_length;
use crate::{
    DifferenceFrames, ImageSequence, InverseError, OneStepSettings, Prior, SequenceSolver,
};
use ndarray::ArrayRef2;

/// Smallest ratio of process noise to initial variance. Below it `q` is lost in the rounding of
/// `phi^2 C + q I`, and the random walk would silently stop.
const LEAST_NOISE: f64 = 1e-12;

/// Accepted range of variances. Outside it, one term or the other is lost by rounding in sums with
/// the prior's variance of 1.
const VARIANCES: std::ops::RangeInclusive<f64> = 1e-12..=1e12;

/// Settings of [`KalmanSmoother`] and [`KalmanFilter`].
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct KalmanSettings {
    /// Hyperparameter, data, noise and channels, as for a single frame.
    pub one_step: OneStepSettings,
    /// Process noise `q`: variance added to the image per frame, as a multiple of the prior covariance
    /// `P`; dimensionless. For a rate per second, divide by the frame rate in hertz. Default 0.1:
    /// over ten frames the image can change completely. At least 1e-12 of `initial_variance`.
    pub process_noise: f64,
    /// Initial variance `p0` of the first image, as a multiple of `P`. Default 1: without later frames,
    /// the first image equals that of [`OneStepGaussNewton`](crate::OneStepGaussNewton).
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

/// Maximum a posteriori sequence of images that follow a random walk.
///
/// ```text
/// dsigma_1 ~ N(0, p0 P),   dsigma_t+1 = dsigma_t + N(0, q P),   dv_t = J dsigma_t + N(0, mu W^-1)
/// ```
///
/// with `J`, `W`, `P` and `mu = lambda^2 s` of [`OneStepGaussNewton`](crate::OneStepGaussNewton).
/// The Kalman filter and Rauch-Tung-Striebel smoother work on the eigenvectors of
/// `W^1/2 J P J' W^1/2`: `r` scalar filters of 10 flops per frame each, in addition to `2 r (m + n)`
/// for the image. For the cost of masked channels see [`TimePrior`](crate::sequence::TimePrior). A
/// frame without a good channel is interpolated. Images are `[frame, element]`, siemens (per square).
///
/// Source: Rauch, Tung, Striebel, *AIAA J.* 3 (1965), 1445-1450; Vauhkonen, Karjalainen, Kaipio,
/// *IEEE Trans. Biomed. Eng.* 45 (1998), 486-493.
#[derive(Debug, Clone)]
pub struct KalmanSmoother {
    modes: Modes,
    process: Markov,
}

impl KalmanSmoother {
    /// Sets up the smoother for a Jacobian `[measurement, element]`, volts per siemens.
    ///
    /// Costs the same as [`OneStepGaussNewton::new`](crate::OneStepGaussNewton::new).
    ///
    /// # Errors
    /// The errors of [`OneStepGaussNewton::new`](crate::OneStepGaussNewton::new);
    /// [`InverseError::OutOfRange`] for the variances.
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

/// Causal counterpart of [`KalmanSmoother`]: the maximum a posteriori image given the frames so far.
///
/// A frame costs `2 r (m + n)` flops and does not allocate until a channel is first masked. From then
/// until [`reset`](Self::reset), covariances are `r x r`, and a frame allocates and costs an
/// additional `4 m r^2 + 5 r^3` flops. Exclude a dead electrode with [`OneStepSettings::used`]
/// instead.
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
    /// Sets up the filter; see [`KalmanSmoother::new`].
    ///
    /// # Errors
    /// See [`KalmanSmoother::new`].
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

    /// Returns the number of measurements of the protocol, which is the length of a frame.
    pub fn measurements(&self) -> usize {
        self.modes.channels.count
    }

    /// Returns the number of elements, which is the length of an image.
    pub fn image_len(&self) -> usize {
        self.modes.elements()
    }

    /// Returns the number of frames pushed since set-up or [`reset`](Self::reset).
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Discards all frames and returns to the initial state.
    pub fn reset(&mut self) {
        self.belief = Belief::initial(&self.process, self.modes.rank());
        self.frames = 0;
    }

    /// Processes the difference data `[measurement]` of the next frame and writes its image
    /// `[element]`, siemens (per square). Channels where `good` is false are not read.
    ///
    /// # Errors
    /// Returns an error for wrong lengths and for a non-finite value of a good channel (the frame
    /// index in the error counts from [`reset`](Self::reset)); the filter is then unchanged.
    /// [`InverseError::Factorisation`] on overflow or underflow; call [`reset`](Self::reset) after
    /// it.
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
