//! Bells fitted to the measurements of a frame on the non-linear forward model.
//!
//! ```text
//! minimise  chi^2 = sum_i ((dv_i - [F(sigma) - F(background)]_i) / noise_std_i)^2
//! sigma = background (1 + sum_k a_k g_k),   g_k = exp(-|x - c_k|^2 / (2 r_k^2))
//! ```
//!
//! by Levenberg and Marquardt's method; derivatives are the adjoint Jacobian times dsigma/dtheta.
//! Errors of the mesh and of contact impedances that are the same with and without touch cancel in
//! the difference of model voltages.

mod problem;
mod select;
mod solve;

use super::bell::Bell;
use crate::check::check_positive;
use crate::{InverseError, OneStepSettings};
use eit_fem::ForwardModel;
use eit_mesh::Surface;
use ndarray::Array2;
pub(super) use problem::{Parameters, Problem, inverse_information};
pub(super) use solve::in_space;

/// Settings of [`TouchFit`].
#[derive(Debug, Clone, PartialEq)]
pub struct FitSettings {
    /// Plain or normalised difference, the noise of each (which must be given, with the reference
    /// frame's share), which measurements count. The hyperparameter is not read.
    pub data: OneStepSettings,
    /// Whether radii are fitted, too; otherwise they stay as they start. Default true. Radius and
    /// amplitude of a touch that is small beside its distance to the electrodes are nearly one
    /// number; its position hardly minds.
    pub fit_radius: bool,
    /// Least and largest radius, metres. Default 2 mm to 0.1 m.
    pub radius_range_m: [f64; 2],
    /// Steps at most. Default 30.
    pub max_iterations: usize,
    /// Stop when a step promises to lower chi^2 by less than this: its root is the distance to the
    /// optimum in standard deviations. Default 1e-4.
    pub tolerance: f64,
    /// A touch is valid up to this standard deviation of its position along any direction, metres.
    /// Default 10 mm.
    pub max_position_std_m: f64,
}

impl FitSettings {
    /// Defaults with the noise of each difference, `[measurement]`, volts.
    pub fn with_noise(noise_std: Vec<f64>) -> Self {
        Self {
            data: OneStepSettings { noise_std: Some(noise_std), ..Default::default() },
            fit_radius: true,
            radius_range_m: [2e-3, 0.1],
            max_iterations: 30,
            tolerance: 1e-4,
            max_position_std_m: 10e-3,
        }
    }

    /// Checks every number but the noise.
    ///
    /// # Errors
    /// [`InverseError::OutOfRange`].
    pub fn validate(&self) -> Result<(), InverseError> {
        let [least, largest] = self.radius_range_m;
        check_positive("radius_range_m", least)?;
        check_positive("radius_range_m", largest)?;
        if least > largest {
            let (quantity, must) = ("radius_range_m", "ascending");
            return Err(InverseError::OutOfRange { quantity, value: largest, must });
        }
        if self.max_iterations == 0 {
            let (quantity, must) = ("max_iterations", "at least 1");
            return Err(InverseError::OutOfRange { quantity, value: 0.0, must });
        }
        check_positive("tolerance", self.tolerance)?;
        check_positive("max_position_std_m", self.max_position_std_m)
    }
}

/// How a fit ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum FitStatus {
    /// The next step promises less than the tolerance.
    Converged,
    /// No shorter step lowers chi^2 any more: rounding, or the edge of the skin.
    Stalled,
    /// As many steps as were allowed.
    IterationLimit,
}

/// A fitted touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FittedTouch {
    /// Its bell.
    pub bell: Bell,
    /// Covariance of the position, square metres: the inverse Fisher information of all
    /// parameters, times chi^2 per degree of freedom where that is above 1. Infinite where the
    /// data does not fix the parameters.
    pub position_covariance_m2: [[f64; 3]; 3],
    /// Standard deviation of the amplitude.
    pub amplitude_std: f64,
    /// Standard deviation of the radius, metres; 0 where it is not fitted.
    pub radius_std_m: f64,
    /// Probability that noise would have made a smaller strength `s = a r^2` here, 0 to 1:
    /// `erf(|s| / (std sqrt 2))`. Near 1 for a touch.
    pub confidence: f64,
    /// Whether it can be acted on: strength above three standard deviations, position known to
    /// the setting, radius inside its range.
    pub valid: bool,
}

impl FittedTouch {
    /// Root of the mean of the position's two variances within the skin, metres.
    pub fn position_std_m(&self) -> f64 {
        (0.5 * (0..3).map(|i| self.position_covariance_m2[i][i]).sum::<f64>()).sqrt()
    }
}

/// What a fit found and what it cost.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct FitResult {
    /// Touches in the order of their starts.
    pub touches: Vec<FittedTouch>,
    /// Covariance of the parameters, scaled as the positions: for each touch its coordinates along
    /// two tangents of the skin (x and y on a flat one), metres, the amplitude and, if fitted, the
    /// logarithm of the radius.
    pub covariance: Array2<f64>,
    /// How it ended.
    pub status: FitStatus,
    /// Steps tried.
    pub iterations: usize,
    /// Forward solves.
    pub forward_solves: usize,
    /// Sum of squared residuals in units of the noise.
    pub chi_square: f64,
    /// Used measurements less parameters.
    pub degrees_of_freedom: usize,
    /// chi^2 of no touch at all.
    pub chi_square_without: f64,
    /// Wall-clock time, seconds.
    pub seconds: f64,
}

impl FitResult {
    /// Near 1 where model and noise are right: within `1 +- 3 sqrt(2 / n)` nearly always.
    pub fn reduced_chi_square(&self) -> f64 {
        self.chi_square / self.degrees_of_freedom.max(1) as f64
    }
}

/// Fits bells to frames; holds the forward model's memory between frames.
///
/// A fit allocates small vectors; the Jacobian and the factor are reused.
#[derive(Debug)]
pub struct TouchFit<'a> {
    pub(super) problem: Problem<'a>,
    pub(super) settings: FitSettings,
}

impl<'a> TouchFit<'a> {
    /// For a forward model of `surface` with `background` conductivity, siemens, `[element]`.
    ///
    /// # Errors
    /// Wrong lengths, noise that is not given or out of range, what the forward model refuses.
    pub fn new(
        model: &'a ForwardModel,
        surface: &'a Surface,
        background_s: &[f64],
        settings: FitSettings,
    ) -> Result<Self, InverseError> {
        settings.validate()?;
        let channels = settings.data.channels(model.protocol().measurements())?;
        let problem = Problem::new(model, surface, background_s, channels)?;
        Ok(Self { problem, settings })
    }

    /// Fits as many bells as are given to start from; none gives chi^2 of no touch.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`], values that are not finite; [`InverseError::OutsideSkin`] for
    /// a start that is more than its radius away from the skin; [`InverseError::OutOfRange`] for
    /// amplitudes not above -1, bells that together leave no conductivity, radii out of range, more
    /// parameters than used measurements.
    pub fn fit(
        &mut self,
        frame: &[f64],
        reference_frame: &[f64],
        starts: &[Bell],
    ) -> Result<FitResult, InverseError> {
        let data = self.problem.whitened(frame, reference_frame)?;
        self.fit_whitened(&data, starts)
    }
}
