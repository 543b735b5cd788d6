//! NOSER prior: variance derived from sensitivity.

use super::Prior;
use crate::InverseError;
use crate::check::check_range;
use ndarray::{Array1, Array2, ArrayView2, Axis};

/// Prior that allows larger changes in elements that the measurements sense weakly.
///
/// `R = diag(J' W J)^exponent`, diagonal. With exponent 1 the image does not depend on an element's unit of
/// conductivity; with exponent 0 the prior is the identity. At the default 0.5, `R_e` is proportional to
/// the element's area (as the Jacobian is), so only this exponent makes the prior independent of the mesh.
/// It also limits the shift toward the rim.
///
/// An element that no measurement senses gets variance zero: its image is zero, where `1 / 0 * 0` would be
/// NaN.
///
/// Source: Cheney, Isaacson, Newell, Simske, Goble, NOSER, *Int. J. Imaging Syst. Technol.* 2
/// (1990), 66-75 (exponent 1); exponent 0.5 as in EIDORS' `prior_noser`.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Noser {
    /// Exponent, 0 to 1. Default 0.5.
    pub exponent: f64,
}

impl Default for Noser {
    fn default() -> Self {
        Self { exponent: 0.5 }
    }
}

impl Prior for Noser {
    fn name(&self) -> &'static str {
        "noser"
    }

    fn covariance_times(
        &self,
        weighted_jacobian: ArrayView2<'_, f64>,
    ) -> Result<Array2<f64>, InverseError> {
        let fine = (0.0..=1.0).contains(&self.exponent);
        check_range("NOSER exponent", self.exponent, fine, "between 0 and 1")?;
        // relative to the largest entry: squares of sensitivities in volts per siemens underflow
        let largest = weighted_jacobian.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let unit = if largest > 0.0 { largest } else { 1.0 };
        let diagonal: Array1<f64> = weighted_jacobian
            .axis_iter(Axis(1))
            .map(|column| column.iter().map(|x| (x / unit).powi(2)).sum::<f64>())
            .collect();
        let variance = |d: f64| if d > 0.0 { d.powf(-self.exponent) } else { 0.0 };
        Ok(&weighted_jacobian * &diagonal.mapv(variance))
    }
}
