//! Dense symmetric matrices of `ndarray`, decomposed by `faer`.

use crate::InverseError;
use faer::linalg::solvers::DenseSolveCore;
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Mat, Par, Side};
use ndarray::Array2;

fn matrix(of: &Array2<f64>) -> Mat<f64> {
    Mat::from_fn(of.nrows(), of.ncols(), |i, j| of[[i, j]])
}

fn failed(what: &'static str, of: &Array2<f64>) -> InverseError {
    InverseError::Factorisation { what, size: of.nrows() }
}

/// Returns the eigenvalues of a symmetric matrix, ascending, and its eigenvectors in columns.
///
/// # Errors
/// [`InverseError::Factorisation`] for values that are not finite.
pub(crate) fn eigen(
    of: &Array2<f64>,
    what: &'static str,
) -> Result<(Vec<f64>, Array2<f64>), InverseError> {
    let found = matrix(of).self_adjoint_eigen(Side::Lower).map_err(|_| failed(what, of))?;
    let (values, vectors) = (found.S().column_vector(), found.U());
    let values = (0..of.nrows()).map(|i| values[i]).collect();
    Ok((values, Array2::from_shape_fn(of.dim(), |(i, j)| vectors[(i, j)])))
}

/// Returns a product; several times faster than `dot` for thousands of rows.
pub(super) fn product(a: &Array2<f64>, b: &Array2<f64>) -> Array2<f64> {
    let made = matrix(a) * matrix(b);
    Array2::from_shape_fn((a.nrows(), b.ncols()), |(i, j)| made[(i, j)])
}

/// Returns the inverse of a symmetric positive definite matrix.
///
/// # Errors
/// [`InverseError::Factorisation`] for any other matrix.
pub(super) fn inverse(of: &Array2<f64>, what: &'static str) -> Result<Array2<f64>, InverseError> {
    let factor = matrix(of).llt(Side::Lower).map_err(|_| failed(what, of))?;
    let inverse = factor.inverse();
    Ok(Array2::from_shape_fn(of.dim(), |(i, j)| inverse[(i, j)]))
}

/// Returns the inverse of the lower Cholesky factor of a symmetric positive definite matrix.
///
/// # Errors
/// [`InverseError::Factorisation`] for any other matrix.
pub(crate) fn inverse_of_factor(
    of: &Array2<f64>,
    what: &'static str,
) -> Result<Array2<f64>, InverseError> {
    let size = of.nrows();
    let factor = matrix(of).llt(Side::Lower).map_err(|_| failed(what, of))?;
    let mut inverse = Mat::<f64>::identity(size, size);
    solve_lower_triangular_in_place(factor.L(), inverse.as_mut(), Par::Seq);
    Ok(Array2::from_shape_fn(of.dim(), |(i, j)| inverse[(i, j)]))
}
