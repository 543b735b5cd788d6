//! Cramer-Rao bound on the position error of any unbiased method.

use super::bell::Bell;
use super::fit::{FitSettings, Parameters, TouchFit};
use crate::InverseError;
use eit_fem::ForwardModel;
use eit_mesh::Surface;
use ndarray::Array2;

/// Which parameters of a touch are unknown besides its position.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Nuisance {
    /// None: amplitude and radius are known.
    Known,
    /// The amplitude.
    Amplitude,
    /// Amplitude and radius.
    AmplitudeAndRadius,
}

impl Nuisance {
    fn parameters(self) -> Parameters {
        Parameters { amplitude: self != Self::Known, radius: self == Self::AmplitudeAndRadius }
    }
}

/// Bound on the covariance of a touch's position.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct BellBound {
    /// Least covariance of the position, square metres; infinite if the data do not determine the parameters.
    pub position_covariance_m2: [[f64; 3]; 3],
    /// Root of the mean of its two variances within the skin, metres: the least root mean square error of
    /// one coordinate. The bound on the distance is `sqrt 2` times as large.
    pub position_std_m: f64,
    /// Least standard deviation of the amplitude; 0 if it is known.
    pub amplitude_std: f64,
    /// Least standard deviation of the radius, metres; 0 if it is known.
    pub radius_std_m: f64,
}

/// Computes the Cramer-Rao bound of the positions of touches, with all unknown parameters of all touches
/// estimated from one frame.
///
/// The bound is the inverse of the Fisher information `A' A`, `A = diag(1 / noise_std) J dsigma/dtheta`,
/// for normal noise.
///
/// `settings` give the noise of the difference data and which measurements are used. Noise of `N` dB means
/// `noise_std = 10^(-N / 20)` times the root mean square of the reference frame's voltages, in each
/// difference, unless the scene says otherwise.
///
/// Source: Kay, *Fundamentals of Statistical Signal Processing: Estimation Theory* (1993), chapter 3.
///
/// # Errors
/// As [`TouchFit::new`] and [`TouchFit::fit`].
pub fn cramer_rao(
    model: &ForwardModel,
    surface: &Surface,
    background_s: &[f64],
    settings: FitSettings,
    touches: &[Bell],
    nuisance: Nuisance,
) -> Result<Vec<BellBound>, InverseError> {
    TouchFit::new(model, surface, background_s, settings)?.bound(touches, nuisance)
}

impl TouchFit<'_> {
    /// Computes [`cramer_rao`] with the model and noise of this fit.
    ///
    /// # Errors
    /// As [`TouchFit::fit`] for its starts.
    pub fn bound(
        &mut self,
        touches: &[Bell],
        nuisance: Nuisance,
    ) -> Result<Vec<BellBound>, InverseError> {
        let bells = self.check_starts(touches)?;
        let parameters = nuisance.parameters();
        let Some(slopes) = self.problem.derivative(&bells, parameters)? else {
            let value = bells.iter().map(|b| b.amplitude).fold(f64::INFINITY, f64::min);
            let (quantity, must) =
                ("amplitude", "large enough that all touches together leave conductivity");
            return Err(InverseError::OutOfRange { quantity, value, must });
        };
        let covariance: Array2<f64> = super::fit::inverse_information(slopes.as_ref());
        let each = parameters.count();
        let std = |k: usize| covariance[(k, k)].sqrt();
        let of = |(k, bell): (usize, &Bell)| {
            let at = k * each;
            let plane = [0, 1].map(|i| [0, 1].map(|j| covariance[(at + i, at + j)]));
            let tangents = self.problem.place(bell.position_m).tangents;
            BellBound {
                position_covariance_m2: super::fit::in_space(plane, tangents),
                position_std_m: (0.5 * (plane[0][0] + plane[1][1])).sqrt(),
                amplitude_std: if parameters.amplitude { std(at + 2) } else { 0.0 },
                radius_std_m: if parameters.radius { bell.radius_m * std(at + 3) } else { 0.0 },
            }
        };
        Ok(bells.iter().enumerate().map(of).collect())
    }

    /// Returns the derivatives of the model's differences in units of the noise,
    /// `[used measurement, parameter]`, with parameters as in
    /// [`FitResult::covariance`](super::FitResult::covariance).
    ///
    /// # Errors
    /// As [`TouchFit::fit`] for its starts.
    pub fn derivatives(&mut self, touches: &[Bell]) -> Result<Array2<f64>, InverseError> {
        let bells = self.check_starts(touches)?;
        let parameters = Parameters { amplitude: true, radius: self.settings.fit_radius };
        let slopes = self.problem.derivative(&bells, parameters)?;
        let slopes = slopes.unwrap_or_else(|| faer::Mat::zeros(0, 0));
        Ok(Array2::from_shape_fn((slopes.nrows(), slopes.ncols()), |(i, j)| slopes[(i, j)]))
    }

    /// Returns the model's differences in units of the noise, `[used measurement]`.
    ///
    /// # Errors
    /// As [`TouchFit::fit`] for its starts.
    pub fn differences(&mut self, touches: &[Bell]) -> Result<Vec<f64>, InverseError> {
        let bells = self.check_starts(touches)?;
        let zero = vec![0.0; self.problem.channels.used.len()];
        let residuals = self.problem.residuals(&zero, &bells).unwrap_or_default();
        Ok(residuals.iter().map(|r| -r).collect())
    }
}
