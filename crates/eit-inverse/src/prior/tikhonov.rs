//! Tikhonov prior: white noise.

use super::Prior;
use crate::InverseError;
use crate::check::check_length;
use eit_mesh::Surface;
use ndarray::{Array1, Array2, ArrayView2};

/// White noise on the skin: every point is independent of every other.
///
/// `R = diag(area_e / mean area)`, so `dsigma' R dsigma` is the integral of `dsigma^2` over the skin
/// divided by the mean element area. With the identity instead (the usual form of zeroth-order Tikhonov),
/// smaller elements would get a larger penalty per area, and the image would show the mesh.
///
/// Source: Tikhonov, *Soviet Math. Dokl.* 4 (1963), 1035; area weights as in EIDORS'
/// `prior_tikhonov` on meshes of equal elements.
///
/// ```
/// use eit_inverse::{OneStepGaussNewton, OneStepSettings, Tikhonov};
/// use eit_mesh::Surface;
/// use ndarray::array;
///
/// let nodes_m = vec![[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.1, 0.0], [0.0, 0.1, 0.0]];
/// let surface = Surface::new(nodes_m, vec![[0, 1, 2], [0, 2, 3]])?;
/// // three measurements of two elements; the second element has changed
/// let jacobian = array![[1.0, 0.5], [0.5, 1.0], [0.2, 0.2]];
/// let prior = Tikhonov::new(&surface);
/// let inverse = OneStepGaussNewton::new(
///     &jacobian,
///     &prior,
///     OneStepSettings { hyperparameter: 1e-3, ..Default::default() },
/// )?;
/// let image = inverse.reconstruct(&[0.5, 1.0, 0.2], &[0.0; 3])?;
/// assert!((image[1] - 1.0).abs() < 0.01 && image[0].abs() < 0.01);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Tikhonov {
    variances: Array1<f64>,
}

impl Tikhonov {
    /// Builds the prior of a skin.
    pub fn new(surface: &Surface) -> Self {
        let areas = surface.areas_m2();
        let mean = areas.iter().sum::<f64>() / areas.len() as f64;
        Self { variances: areas.iter().map(|a| mean / a).collect() }
    }
}

impl Prior for Tikhonov {
    fn name(&self) -> &'static str {
        "tikhonov"
    }

    fn covariance_times(
        &self,
        weighted_jacobian: ArrayView2<'_, f64>,
    ) -> Result<Array2<f64>, InverseError> {
        check_length("Jacobian columns", weighted_jacobian.ncols(), self.variances.len())?;
        Ok(&weighted_jacobian * &self.variances)
    }
}
