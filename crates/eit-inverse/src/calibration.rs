//! Absolute calibration: background conductivity and contact impedances from a frame of the untouched skin.

mod fit;
mod settings;

pub use settings::{CalibrationSettings, CalibrationStatus, Contacts};

use ndarray::Array2;

/// A calibrated skin, the starting point of absolute images.
///
/// The frame `v` of a homogeneous skin is explained by one sheet conductivity and contact impedances. All
/// are positive, so their logarithms `x` are fitted:
///
/// ```text
/// x = argmin  |v - V(x)|_W^2 + |(ln z - ln z_start) / contact_spread|^2
/// dV / d ln sigma = -V + sum_l z_l dV/dz_l        (V is homogeneous of degree -1 in sigma, 1/z)
/// ```
///
/// The method is Gauss-Newton with Levenberg-Marquardt damping. Derivatives come from
/// [`Solution::contact_jacobian`](eit_fem::Solution::contact_jacobian) and need no further solve.
///
/// **What the data cannot determine.** Contacts have a strong effect where driven electrodes are measured
/// and hardly any elsewhere. There the weak prior on `ln z` decides: [`Calibration::determined`] is near 0
/// and the standard deviation near that of the prior. A gain of the instrument common to all channels
/// cannot be told from the conductivity: `g V(sigma, z) = V(sigma / g, g z)`. Both results then include
/// that gain, and they explain images and later frames equally well.
///
/// **Noise.** With [`CalibrationSettings::noise_std_v`] the covariance is that of this noise. If
/// [`Calibration::reduced_chi_square`] is far above 1, the model's error exceeds the noise, and the
/// standard deviations are too small by about the root of it. Without given noise, equal noise in all
/// measurements is estimated from the residual by maximum likelihood; it then includes the model's error.
///
/// Source: Vilhunen, Kaipio, Vauhkonen, Savolainen, Vauhkonen, *Meas. Sci. Technol.* 13 (2002), 1848-1854
/// (simultaneous conductivity and contact impedances); damping: Marquardt, *SIAM J. Appl. Math.* 11 (1963),
/// 431-441.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Calibration {
    /// Why the fit stopped.
    pub status: CalibrationStatus,
    /// Number of steps taken.
    pub iterations: usize,
    /// Number of forward solves, including those of rejected steps.
    pub forward_solves: usize,
    /// Background conductivity, siemens (per square).
    pub conductivity_s: f64,
    /// Contact impedance of each electrode: ohm metre (rim), ohm square metre (patch).
    pub contact_impedance: Vec<f64>,
    /// Covariance `[parameter, parameter]` of `ln sigma`, then `ln z` of each electrode or of the common
    /// factor; small values are relative variances.
    pub covariance: Array2<f64>,
    /// Fraction of its prior variance that each parameter has lost through the data, `[parameter]`: 1 if
    /// the data determine it, 0 if the prior does. The conductivity has no prior: always 1.
    pub determined: Vec<f64>,
    /// Relative residual `|v - V|_W / |v|_W` at the start.
    pub residual_before: f64,
    /// Relative residual `|v - V|_W / |v|_W` at the end.
    pub residual_after: f64,
    /// Standard deviation of the noise, given or estimated, volts, `[measurement]` (including unused ones).
    pub noise_std_v: Vec<f64>,
    /// `|v - V|_W^2` divided by measurements minus parameters: about 1 if only noise remains unexplained; 1
    /// if the noise was estimated.
    pub reduced_chi_square: f64,
    /// Voltages of the calibrated model, `[measurement]`.
    pub voltages_v: Vec<f64>,
}

impl Calibration {
    /// Returns the standard deviation of each logarithm, `[parameter]`, which is relative if small.
    pub fn std(&self) -> Vec<f64> {
        self.covariance.diag().iter().map(|v| v.sqrt()).collect()
    }

    /// Returns the parameters (contacts start at 1) that the data determine less than the prior does.
    pub fn undetermined(&self) -> Vec<usize> {
        let weak = self.determined.iter().enumerate().filter(|(_, part)| **part < 0.5);
        weak.map(|(parameter, _)| parameter).collect()
    }
}
