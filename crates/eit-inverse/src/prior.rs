//! Priors: what images are expected before any measurement.
//!
//! A prior is a Gaussian with mean zero and covariance `P = R^-1`. Reconstruction in measurement
//! space needs nothing of it but the product `J P`, so that is all a prior provides; `R` itself is
//! never formed. The overall size of `P` does not matter (see
//! [`OneStepGaussNewton`](crate::OneStepGaussNewton)).

mod gaussian;
mod laplace;
mod noser;
mod tikhonov;

pub use gaussian::{Gaussian, GaussianSettings};
pub use laplace::{Laplace, LaplaceSettings};
pub use noser::Noser;
pub use tikhonov::Tikhonov;

use crate::InverseError;
use ndarray::{Array2, ArrayView2};

/// A Gaussian prior on the conductivity change of each element.
pub trait Prior {
    /// Short name for reports, for example "laplace".
    fn name(&self) -> &'static str;

    /// `W^1/2 J P`, `[measurement, element]`, from the weighted Jacobian `W^1/2 J`,
    /// `[measurement, element]`. `P` must be symmetric and positive semi-definite.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`] when the Jacobian has not one column per element of the
    /// prior's mesh.
    fn covariance_times(
        &self,
        weighted_jacobian: ArrayView2<'_, f64>,
    ) -> Result<Array2<f64>, InverseError>;
}
