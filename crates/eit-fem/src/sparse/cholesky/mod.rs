//! Sparse Cholesky factorisation whose right-hand sides live in the last unknowns.
//!
//! Where the unknowns with right-hand sides stand at the end of the elimination order, `L y = b` is
//! zero before them and needs no forward sweep. What is wanted of these unknowns alone needs no sweep
//! at all: they solve the dense trailing block, `L22 L22^T U = b`. So one factorisation gives them, and
//! one backward sweep for each right-hand side the rest.
//!
//! Factorisation and sweeps: [`multifrontal`].

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

/// The symbolic factorisation of one pattern.
///
/// The order of the unknowns is the order of elimination: it has to be one that keeps the factor
/// sparse. Cost of a factorisation: [`Cholesky::factor_flops`]; of a right-hand side 2 flops per entry
/// of the factor. Both are sequential, and the same bits in every run.
#[derive(Debug)]
pub struct Cholesky {
    multifrontal: Multifrontal,
    /// Unknowns without right-hand side: they come first.
    leading: usize,
    unknowns: usize,
    /// Entries of the matrix.
    entries: usize,
}

/// Numbers of a factorisation: factor and scratch memory, made by [`Cholesky::memory`] and owned by
/// the caller.
pub struct Factor<T = f64> {
    numbers: Numbers<T>,
    /// Trailing block of the factor.
    trailing: Mat<T>,
}

impl<T> fmt::Debug for Factor<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Factor").finish_non_exhaustive()
    }
}

impl<T: Scalar> Factor<T> {
    /// Numbers of factor entries and entries of scratch memory.
    pub(crate) fn sizes(&self) -> (usize, usize) {
        self.numbers.sizes()
    }
}

impl Cholesky {
    /// Analyses a pattern; the unknowns from `leading` on carry right-hand sides.
    ///
    /// # Errors
    /// [`SparseError::NoTrailingUnknowns`] where `leading` leaves none.
    pub fn new(pattern: &Pattern, leading: usize) -> Result<Self, SparseError> {
        let unknowns = pattern.unknowns();
        if leading >= unknowns {
            return Err(SparseError::NoTrailingUnknowns { leading, unknowns });
        }
        let multifrontal = Multifrontal::new(pattern, leading);
        Ok(Self { multifrontal, leading, unknowns, entries: pattern.entries() })
    }

    /// Values of the factor, zeros inside fronts and padding included.
    pub fn factor_entries(&self) -> usize {
        self.multifrontal.factor_entries()
    }

    /// Floating point operations of one factorisation: the sum over columns of the squared count.
    pub fn factor_flops(&self) -> f64 {
        self.multifrontal.flops()
    }

    /// Values of scratch memory of one factorisation.
    pub(crate) fn scratch_entries(&self) -> usize {
        self.multifrontal.stack_entries()
    }

    /// Memory for the numbers.
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

    /// Factorises the matrix with these values, one for each entry of the pattern: `A = L L^T` without
    /// conjugates and without pivoting. Every pivot has to lie in the half plane around `direction`:
    /// 1 for a positive definite real matrix.
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

    /// Largest `(|L| |L^T|)_ii / |a_ii|`: one for positive definite real matrices. The backward
    /// error of a solve without pivoting is at most this, times roundings (Higham, "Accuracy and
    /// Stability of Numerical Algorithms", 2nd ed., theorem 9.3).
    #[cfg(feature = "complex")]
    pub(crate) fn growth<T: Scalar>(&self, values: &[T], factor: &Factor<T>) -> f64 {
        self.multifrontal.growth(values, &factor.numbers)
    }

    /// The trailing unknowns alone, in place: right-hand sides `[trailing unknown, column]`.
    pub(crate) fn solve_trailing<T: Scalar>(&self, factor: &Factor<T>, mut x: MatMut<'_, T>) {
        let lower = factor.trailing.as_ref();
        triangular_solve::solve_lower_triangular_in_place(lower, x.rb_mut(), Par::Seq);
        triangular_solve::solve_upper_triangular_in_place(lower.transpose(), x.rb_mut(), Par::Seq);
    }

    /// Solves `A x = b` in place after [`Cholesky::factorise`].
    ///
    /// `x` is `[unknown, column]`, row-major with `columns` columns, so that a gather of unknowns
    /// copies whole rows. On entry the rows of the trailing unknowns hold the right-hand sides (those
    /// of the others are not read: they are zero), on exit all rows hold the solution. Memory for
    /// sweeps grows at the first call.
    ///
    /// # Errors
    /// A length that is not `unknowns * columns`; memory of another pattern.
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

    /// [`Cholesky::solve`] with sizes that are known to fit.
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

    /// That memory has the sizes of this pattern.
    fn check<T: Scalar>(&self, factor: &Factor<T>) -> Result<(), SparseError> {
        let (entries, scratch) = factor.sizes();
        check_length("factor of another pattern: its entries", entries, self.factor_entries())?;
        check_length("factor of another pattern: its scratch", scratch, self.scratch_entries())?;
        let trailing = self.unknowns - self.leading;
        check_length("factor of another pattern: its end", factor.trailing.nrows(), trailing)
    }
}
