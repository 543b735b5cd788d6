//! Sparse Cholesky factorisation with right-hand sides in the last unknowns only.
//!
//! If the unknowns with right-hand sides come last in the elimination order, the solution of `L y =
//! b` is zero before them, so no forward sweep is needed. The values of these unknowns need no
//! sweep at all: they solve the dense trailing block, `L22 L22^T U = b`. One factorisation gives
//! them, and one backward sweep per right-hand side gives the other unknowns.
//!
//! Factorisation and sweeps are in [`multifrontal`].

mod front;
mod multifrontal;
mod sweep;
mod symbolic;
mod tile;

use super::error::{SparseError, check_length};
use super::pattern::Pattern;
use super::scalar::Scalar;
use faer::linalg::triangular_solve;
use faer::prelude::*;
use faer::{MatMut, Par};
use multifrontal::{Multifrontal, Numbers};
use std::fmt;

/// Symbolic factorisation of one pattern.
///
/// Unknowns are eliminated in their order, which should be one that keeps the factor sparse. A
/// factorisation takes [`Cholesky::factor_flops`], a right-hand side 2 flops per entry of the
/// factor. Both run on one thread, and results are bit-identical in every run.
#[derive(Debug, Clone)]
pub struct Cholesky {
    multifrontal: Multifrontal,
    /// Number of leading unknowns, which have no right-hand sides.
    leading: usize,
    unknowns: usize,
    /// Number of matrix entries.
    entries: usize,
}

/// Numeric factor and scratch memory. Created by [`Cholesky::memory`] and owned by the caller.
#[derive(Clone)]
pub struct Factor<T = f64> {
    numbers: Numbers<T>,
    /// Dense trailing block of the factor.
    trailing: Mat<T>,
}

impl<T> fmt::Debug for Factor<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Factor").finish_non_exhaustive()
    }
}

impl<T: Scalar> Factor<T> {
    /// Number of factor entries and of scratch entries.
    pub(crate) fn sizes(&self) -> (usize, usize) {
        self.numbers.sizes()
    }
}

impl Cholesky {
    /// Analyses a pattern. The unknowns from index `leading` on have right-hand sides.
    ///
    /// # Errors
    /// [`SparseError::NoTrailingUnknowns`] if `leading` is not less than the number of unknowns.
    pub fn new(pattern: &Pattern, leading: usize) -> Result<Self, SparseError> {
        let unknowns = pattern.unknowns();
        if leading >= unknowns {
            return Err(SparseError::NoTrailingUnknowns { leading, unknowns });
        }
        let multifrontal = Multifrontal::new(pattern, leading);
        Ok(Self { multifrontal, leading, unknowns, entries: pattern.entries() })
    }

    /// Number of values in the factor, including zeros within fronts and padding.
    pub fn factor_entries(&self) -> usize {
        self.multifrontal.factor_entries()
    }

    /// Floating-point operations of one factorisation: the sum of the squared column counts.
    pub fn factor_flops(&self) -> f64 {
        self.multifrontal.flops()
    }

    /// Number of scratch values of one factorisation.
    pub(crate) fn scratch_entries(&self) -> usize {
        self.multifrontal.stack_entries()
    }

    /// Allocates memory for the numeric factor.
    ///
    /// # Errors
    /// [`SparseError::OutOfMemory`].
    pub fn memory<T: Scalar>(&self) -> Result<Factor<T>, SparseError> {
        let trailing = self.unknowns - self.leading;
        Ok(Factor {
            numbers: self.multifrontal.numbers()?,
            trailing: Mat::zeros(trailing, trailing),
        })
    }

    /// Factorises the matrix with the given values, one per entry of the pattern.
    ///
    /// Computes `A = L L^T` without conjugation and without pivoting. Every pivot must lie in the
    /// half plane around `direction`; use 1 for a positive definite real matrix.
    ///
    /// # Errors
    /// [`SparseError::BadPivot`]; a wrong number of values; memory of another pattern.
    pub fn factorise<T: Scalar>(
        &self,
        values: &[T],
        factor: &mut Factor<T>,
        direction: T,
    ) -> Result<(), SparseError> {
        check_length("matrix values (one per entry)", values.len(), self.entries)?;
        self.check(factor)?;
        let Factor { numbers, trailing } = factor;
        let unknowns = self.unknowns;
        let factorised = self.multifrontal.factorise(values, numbers, direction);
        factorised.map_err(|unknown| SparseError::BadPivot { unknown, unknowns })?;
        self.multifrontal.trailing(numbers, |i, j, value| trailing[(i, j)] = value);
        Ok(())
    }

    /// Returns the largest `(|L| |L^T|)_ii / |a_ii|`, which is one for positive definite real
    /// matrices. The backward error of a solve without pivoting is bounded by a multiple of this
    /// times the unit roundoff (Higham, "Accuracy and Stability of Numerical Algorithms", 2nd ed.,
    /// theorem 9.3).
    #[cfg(feature = "complex")]
    pub(crate) fn growth<T: Scalar>(&self, values: &[T], factor: &Factor<T>) -> f64 {
        self.multifrontal.growth(values, &factor.numbers)
    }

    /// Solves for the trailing unknowns only, in place; `x` is `[trailing unknown, column]`.
    pub(crate) fn solve_trailing<T: Scalar>(&self, factor: &Factor<T>, mut x: MatMut<'_, T>) {
        let lower = factor.trailing.as_ref();
        triangular_solve::solve_lower_triangular_in_place(lower, x.rb_mut(), Par::Seq);
        triangular_solve::solve_upper_triangular_in_place(lower.transpose(), x.rb_mut(), Par::Seq);
    }

    /// Solves `A x = b` in place after [`Cholesky::factorise`].
    ///
    /// `x` is `[unknown, column]`, row-major with `columns` columns, so that gathering unknowns
    /// copies whole rows. On entry, the rows of the trailing unknowns hold the right-hand sides;
    /// the other rows are not read and their right-hand sides are taken as zero. On exit, all rows
    /// hold the solution. The first call allocates memory for sweeps.
    ///
    /// # Errors
    /// A length other than `unknowns * columns`; memory of another pattern.
    pub fn solve<T: Scalar>(
        &self,
        factor: &mut Factor<T>,
        x: &mut [T],
        columns: usize,
    ) -> Result<(), SparseError> {
        let wanted = self.unknowns.saturating_mul(columns);
        check_length("right-hand sides (unknowns times columns)", x.len(), wanted)?;
        self.check(factor)?;
        self.solve_checked(factor, x, columns);
        Ok(())
    }

    /// [`Cholesky::solve`] without size checks.
    pub(crate) fn solve_checked<T: Scalar>(
        &self,
        factor: &mut Factor<T>,
        x: &mut [T],
        columns: usize,
    ) {
        let count = self.unknowns - self.leading;
        let trailing = &mut x[self.leading * columns..];
        let rows = MatMut::from_row_major_slice_mut(trailing, count, columns);
        let lower = factor.trailing.as_ref();
        triangular_solve::solve_lower_triangular_in_place(lower, rows, Par::Seq);
        self.multifrontal.solve_back(&mut factor.numbers, x, columns);
    }

    /// Checks that the memory has the sizes of this pattern.
    fn check<T: Scalar>(&self, factor: &Factor<T>) -> Result<(), SparseError> {
        let (entries, scratch) = factor.sizes();
        check_length("factor of another pattern: its entries", entries, self.factor_entries())?;
        check_length("factor of another pattern: its scratch", scratch, self.scratch_entries())?;
        let trailing = self.unknowns - self.leading;
        check_length("factor of another pattern: its end", factor.trailing.nrows(), trailing)
    }
}
