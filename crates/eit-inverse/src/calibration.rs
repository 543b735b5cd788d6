//! Absolute calibration: background conductivity and contact impedances from a frame of the
//! untouched skin.

mod fit;
mod settings;

pub use settings::{CalibrationSettings, CalibrationStatus, Contacts};

use ndarray::Array2;

/// A calibrated skin: what every absolute image starts from.
///
/// The frame `v` of a homogeneous skin is explained by one sheet conductivity and contact
/// impedances, all above zero and therefore sought as logarithms `x`:
///
/// ```text
/// x = argmin  |v - V(x)|_W^2 + |(ln z - ln z_start) / contact_spread|^2
/// dV / d ln sigma = -V + sum_l z_l dV/dz_l        (V is homogeneous of degree -1 in sigma, 1/z)
/// ```
///
/// by Gauss-Newton with Levenberg and Marquardt's damping; derivatives are those of
/// [`Solution::contact_jacobian`](eit_fem::Solution::contact_jacobian), at no further solve.
///
/// **What data do not tell.** Contacts enter strongly where driven electrodes are measured, and
/// hardly elsewhere: there the weak prior on `ln z` decides, [`Calibration::determined`] is near 0
/// and the standard deviation near that of the prior. A gain of the instrument, common to all
/// channels, cannot be told from the conductivity at all: `g V(sigma, z) = V(sigma / g, g z)`. Both
/// come out in units of that gain, in which images and later frames are explained as well.
///
/// **Noise.** With [`CalibrationSettings::noise_std_v`] the covariance is that of this noise; where
/// [`Calibration::reduced_chi_square`] is far above 1 the model's error is larger than it, and the
/// deviations are too small by about its root. Without, noise equal in all measurements is estimated
/// from what stays unexplained (its likelihood maximised), model error and all.
///
/// Source: Vilhunen, Kaipio, Vauhkonen, Savolainen, Vauhkonen, *Meas. Sci. Technol.* 13 (2002),
/// 1848-1854 (simultaneous conductivity and contact impedances); damping: Marquardt, *SIAM J. Appl.
/// Math.* 11 (1963), 431-441.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Why it stopped.
    pub status: CalibrationStatus,
    /// Steps taken.
    pub iterations: usize,
    /// Forward solutions, those of refused steps included.
    pub forward_solves: usize,
    /// Background conductivity, siemens (per square).
    pub conductivity_s: f64,
    /// Contact impedance of each electrode: ohm metre (rim), ohm square metre (patch).
    pub contact_impedance: Vec<f64>,
    /// Covariance [parameter, parameter] of `ln sigma`, then `ln z` of each electrode, or of the
    /// common factor: small values are relative variances.
    pub covariance: Array2<f64>,
    /// What part of its variance before the data each parameter has lost by them, `[parameter]`: 1 is
    /// determined by the data, 0 by the prior alone. The conductivity has no prior: always 1.
    pub determined: Vec<f64>,
    /// `|v - V|_W / |v|_W` at the start and at the end.
    pub residual_before: f64,
    /// See [`Calibration::residual_before`].
    pub residual_after: f64,
    /// Standard deviation of the noise, volts, `[measurement]` (unused ones too): as given, or as
    /// estimated.
    pub noise_std_v: Vec<f64>,
    /// `|v - V|_W^2` over measurements less parameters: about 1 where noise is all that stays
    /// unexplained; 1 where the noise was estimated.
    pub reduced_chi_square: f64,
    /// Voltages of the calibrated model, `[measurement]`.
    pub voltages_v: Vec<f64>,
}

impl Calibration {
    /// Standard deviation of each parameter, `[parameter]`: of logarithms, so relative where small.
    pub fn std(&self) -> Vec<f64> {
        self.covariance.diag().iter().map(|v| v.sqrt()).collect()
    }

    /// Parameters (from 1: contacts) that the data tell less about than the prior does.
    pub fn undetermined(&self) -> Vec<usize> {
        let weak = self.determined.iter().enumerate().filter(|(_, part)| **part < 0.5);
        weak.map(|(parameter, _)| parameter).collect()
    }
}
