//! Laplace prior: neighbouring elements are similar.

use super::Prior;
use crate::InverseError;
use crate::check::{check_length, check_positive};
use crate::geometry::{distance_m, extent_m};
use eit_mesh::Surface;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMat, Triplet};
use faer::{Conj, MatMut, Par, Side, Spec};
use ndarray::{Array1, Array2, ArrayView2};
use std::sync::Arc;

/// Settings of [`Laplace`].
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct LaplaceSettings {
    /// Length beyond which points become independent, metres. `None` (default): the extent of the skin
    /// (longest side of its bounding box). This hardly affects the images: it only fixes the mean, which
    /// the semi-norm leaves free and the measurements determine well.
    pub correlation_length_m: Option<f64>,
}

/// Finite-volume H1 norm: neighbouring elements are expected to be similar.
///
/// ```text
/// dsigma' R dsigma = sum over inner edges  w (dsigma_a - dsigma_b)^2
///                  + 1 / l^2  sum over elements  area dsigma^2
/// w = length of the shared edge / distance of the two centroids
/// ```
///
/// The first sum is the two-point flux form of the integral of `|grad dsigma|^2`, the same on flat and
/// curved skins, since it uses only lengths. It converges to the integral on meshes where the line between
/// centroids crosses the edge at a right angle (near-equilateral triangles, as `eit_mesh` makes). Elsewhere
/// it is an equivalent semi-norm with preferred directions (18 % below to 34 % above the integral on
/// right-angled triangles). The second sum makes `R` invertible.
///
/// `R` is factorised once (sparse Cholesky, approximate minimum degree) and applied to all measurements
/// together.
///
/// Source: Eymard, Gallouet, Herbin, *Finite volume methods*, Handbook of Numerical Analysis VII
/// (2000), section 9 (flux); EIDORS' `prior_laplace` (adjacency with equal weights).
#[derive(Debug, Clone)]
pub struct Laplace {
    precision: SparseColMat<usize, f64>,
    /// Shared: faer cannot copy it.
    symbolic: Arc<SymbolicCholesky<usize>>,
    factor: Vec<f64>,
}

impl Laplace {
    /// Assembles and factorises `R`.
    ///
    /// # Errors
    /// [`InverseError::OutOfRange`] for a length that is not positive, [`InverseError::Factorisation`] if
    /// `R` is singular in double precision.
    pub fn new(surface: &Surface, settings: &LaplaceSettings) -> Result<Self, InverseError> {
        let length_m = settings.correlation_length_m.unwrap_or_else(|| extent_m(surface));
        check_positive("correlation_length_m", length_m)?;
        let size = surface.triangles().len();
        let failed = || InverseError::Factorisation {
            what: "Cholesky of the Laplace prior (correlation_length_m too long)",
            size,
        };
        let entries = lower_triangle(surface, length_m);
        let precision =
            SparseColMat::try_new_from_triplets(size, size, &entries).map_err(|_| failed())?;
        let symbolic = factorize_symbolic_cholesky(
            precision.symbolic(),
            Side::Lower,
            SymmetricOrdering::Amd,
            CholeskySymbolicParams::default(),
        )
        .map_err(|_| failed())?;
        let mut factor = vec![0.0; symbolic.len_val()];
        let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Spec::default());
        symbolic
            .factorize_numeric_llt(
                &mut factor,
                precision.as_ref(),
                Side::Lower,
                Default::default(),
                Par::Seq,
                MemStack::new(&mut MemBuffer::new(scratch)),
                Spec::default(),
            )
            .map_err(|_| failed())?;
        Ok(Self { precision, symbolic: Arc::new(symbolic), factor })
    }

    /// Returns `R dsigma`, `[element]`, for an image `[element]`.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`].
    pub fn precision_times(&self, image: &[f64]) -> Result<Array1<f64>, InverseError> {
        check_length("image", image.len(), self.precision.nrows())?;
        let mut product = Array1::zeros(image.len());
        for triplet in self.precision.triplet_iter() {
            product[triplet.row] += triplet.val * image[triplet.col];
            if triplet.row != triplet.col {
                product[triplet.col] += triplet.val * image[triplet.row];
            }
        }
        Ok(product)
    }
}

impl Prior for Laplace {
    fn name(&self) -> &'static str {
        "laplace"
    }

    fn covariance_times(
        &self,
        weighted_jacobian: ArrayView2<'_, f64>,
    ) -> Result<Array2<f64>, InverseError> {
        let (rows, size) = weighted_jacobian.dim();
        check_length("Jacobian columns", size, self.precision.nrows())?;
        // a row-major [measurement, element] array is a column-major [element, measurement] one
        let mut values: Vec<f64> = weighted_jacobian.iter().copied().collect();
        let scratch = self.symbolic.solve_in_place_scratch::<f64>(rows, Par::Seq);
        LltRef::new(&self.symbolic, &self.factor).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(&mut values, size, rows),
            Par::Seq,
            MemStack::new(&mut MemBuffer::new(scratch)),
        );
        Array2::from_shape_vec((rows, size), values)
            .map_err(|_| InverseError::Factorisation { what: "Laplace solve", size })
    }
}

/// Returns the lower triangle of `R`; entries at the same position are summed.
fn lower_triangle(surface: &Surface, length_m: f64) -> Vec<Triplet<usize, usize, f64>> {
    let centroids = surface.centroids();
    let mut entries: Vec<_> = surface
        .areas_m2()
        .iter()
        .enumerate()
        .map(|(e, area)| Triplet::new(e, e, area / length_m / length_m))
        .collect();
    for (a, (corners, across)) in surface.triangles().iter().zip(surface.neighbours()).enumerate() {
        for (k, b) in across.iter().enumerate() {
            let Some(b) = b.map(|b| b as usize).filter(|&b| b > a) else { continue };
            let [p, q] = [corners[k], corners[(k + 1) % 3]].map(|n| surface.nodes()[n as usize]);
            let weight = distance_m(p, q) / distance_m(centroids[a], centroids[b]);
            entries.push(Triplet::new(a, a, weight));
            entries.push(Triplet::new(b, b, weight));
            entries.push(Triplet::new(b, a, -weight));
        }
    }
    entries
}
