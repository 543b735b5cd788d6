//! Bells fitted to the measurements of a frame on the non-linear forward model.
//!
//! ```text
//! minimise  chi^2 = sum_i ((dv_i - [F(sigma) - F(background)]_i) / noise_std_i)^2
//! sigma = background (1 + sum_k a_k g_k),   g_k = exp(-|x - c_k|^2 / (2 r_k^2))
//! ```
//!
//! Minimised by the Levenberg-Marquardt method; derivatives are the adjoint Jacobian times dsigma/dtheta.
//! Errors of the mesh and of contact impedances that are the same with and without touch cancel in the
//! difference of model voltages.

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
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct FitSettings {
    /// Plain or normalised difference, its noise (which must be given and include the reference frame's
    /// share), and which measurements are used. The hyperparameter is ignored.
    pub data: OneStepSettings,
    /// Whether radii are fitted too; otherwise they stay at their start. Default true. If a touch is small
    /// compared with its distance to the electrodes, radius and amplitude are nearly one parameter; its
    /// position is hardly affected.
    pub fit_radius: bool,
    /// Smallest and largest radius, metres. Default 2 mm to 0.1 m.
    pub radius_range_m: [f64; 2],
    /// Most steps. Default 30.
    pub max_iterations: usize,
    /// The fit stops when a step is predicted to lower chi^2 by less than this; the root of it is the
    /// distance to the optimum in standard deviations. Default 1e-4.
    pub tolerance: f64,
    /// Largest standard deviation of a valid touch's position along any direction, metres. Default 10 mm.
    pub max_position_std_m: f64,
}

impl FitSettings {
    /// Returns the defaults with the noise of each difference, `[measurement]`, volts.
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

    /// Checks every setting but the noise.
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

/// Why a fit stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum FitStatus {
    /// The next step is predicted to gain less than the tolerance.
    Converged,
    /// No shorter step lowers chi^2 further, because of rounding or the edge of the skin.
    Stalled,
    /// The iteration limit was reached.
    IterationLimit,
}

/// A fitted touch.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct FittedTouch {
    /// The fitted bell.
    pub bell: Bell,
    /// Covariance of the position, square metres: the inverse Fisher information of all parameters, scaled
    /// by chi^2 per degree of freedom if that exceeds 1. Infinite if the data do not determine the
    /// parameters.
    pub position_covariance_m2: [[f64; 3]; 3],
    /// Standard deviation of the amplitude.
    pub amplitude_std: f64,
    /// Standard deviation of the radius, metres; 0 if the radius is not fitted.
    pub radius_std_m: f64,
    /// Probability that noise would have produced a smaller strength `s = a r^2` here, 0 to 1:
    /// `erf(|s| / (std sqrt 2))`. Near 1 for a touch.
    pub confidence: f64,
    /// Whether the touch may be acted on: its strength exceeds three standard deviations, its position is
    /// known to within the setting, and its radius is inside its range.
    pub valid: bool,
}

impl FittedTouch {
    /// Root of the mean of the position's two variances within the skin, metres.
    pub fn position_std_m(&self) -> f64 {
        (0.5 * (0..3).map(|i| self.position_covariance_m2[i][i]).sum::<f64>()).sqrt()
    }
}

/// Result of a fit and its cost.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct FitResult {
    /// Touches in the order of their starts.
    pub touches: Vec<FittedTouch>,
    /// Covariance of the parameters, scaled like the positions'. The parameters of each touch are its
    /// coordinates along two tangents of the skin (x and y on a flat one) in metres, the amplitude and, if
    /// fitted, the logarithm of the radius.
    pub covariance: Array2<f64>,
    /// Why the fit stopped.
    pub status: FitStatus,
    /// Number of steps tried.
    pub iterations: usize,
    /// Number of forward solves.
    pub forward_solves: usize,
    /// Sum of squared residuals in units of the noise.
    pub chi_square: f64,
    /// Used measurements minus parameters.
    pub degrees_of_freedom: usize,
    /// chi^2 without any touch.
    pub chi_square_without: f64,
    /// Wall-clock time, seconds.
    pub seconds: f64,
}

impl FitResult {
    /// Returns chi^2 per degree of freedom, near 1 if model and noise are right: nearly always within
    /// `1 +- 3 sqrt(2 / n)`.
    pub fn reduced_chi_square(&self) -> f64 {
        self.chi_square / self.degrees_of_freedom.max(1) as f64
    }
}

/// Fits bells to frames and keeps the forward model's workspace between frames.
///
/// A fit allocates small vectors; Jacobian and factor are reused.
#[derive(Debug, Clone)]
pub struct TouchFit<'a> {
    pub(super) problem: Problem<'a>,
    pub(super) settings: FitSettings,
}

impl<'a> TouchFit<'a> {
    /// Prepares fits for a forward model of `surface` with conductivity `background_s`, siemens, `[element]`.
    ///
    /// # Errors
    /// Wrong lengths, noise that is missing or out of range, or an error of the forward model.
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

    /// Fits as many bells as there are starts; without starts the result holds chi^2 without any touch.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`] and non-finite values; [`InverseError::OutsideSkin`] for a start
    /// farther from the skin than its radius; [`InverseError::OutOfRange`] for amplitudes not above -1,
    /// bells that together leave no conductivity, radii out of range, or more parameters than used
    /// measurements.
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
