//! Priors: what is expected of an image before any measurement.
//!
//! A prior is a Gaussian of mean zero and covariance `P = R^-1`. Reconstruction in measurement space needs
//! only the product `J P`, so that is all a prior provides; `R` itself is never formed. The overall scale
//! of `P` does not matter (see [`OneStepGaussNewton`](crate::OneStepGaussNewton)).

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
    /// Returns a short name for reports, for example "laplace".
    fn name(&self) -> &'static str;

    /// Returns `W^1/2 J P`, `[measurement, element]`, for the weighted Jacobian `W^1/2 J`,
    /// `[measurement, element]`.
    ///
    /// `P` must be symmetric and positive semi-definite.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`] if the number of columns is not that of the elements of the prior's
    /// mesh.
    fn covariance_times(
        &self,
        weighted_jacobian: ArrayView2<'_, f64>,
    ) -> Result<Array2<f64>, InverseError>;
}
