//! Multifrontal Cholesky factorisation of matrices with one pattern, in memory that the caller
//! owns.
//!
//! Columns with the same pattern are eliminated together in a dense front (Duff and Reid 1983; Liu
//! 1992). Matrix entries and the children's update matrices are added up, the front's columns are
//! eliminated, and its update matrix is put on a stack for the parent. All positions follow from
//! the pattern ([`symbolic`]), so a factorisation consists of additions at known positions and
//! dense tiles ([`front`]), and does not allocate. Planar meshes have small fronts (540 at 2 000
//! nodes, on average four columns with eleven rows below), too little arithmetic per front for a
//! general dense library.
//!
//! Speed: at 20 000 nodes (80 MFLOP) a factorisation reaches 13 of the 42 GFLOP/s of a dense
//! product on the same core; at 2 000 nodes (2.5 MFLOP) it reaches 8, including assembly. The lower
//! limit is one fused operation per two flops. Further costs, not measured separately, are
//! scattered additions (one per value of a child's update matrix: 1.3 million at 20 000 nodes),
//! zeros in panels, and short tiles.
//!
//! The unknowns from `leading` on form the last front; its factor is the trailing block.
//!
//! Numbers are real or complex. Complex matrices are symmetric, not Hermitian: nothing is
//! conjugated. A complex product is four real ones, so at the same rate a complex factorisation
//! would take four times as long. It takes 2.7 times as long at 2 000 nodes and 3.3 times at 20 000
//! (`docs/performance/forward.md`): the index work is the same, and each value moved carries twice the
//! arithmetic.
//!
//! The rounding error bound is that of Cholesky's method for any order of summation. The result
//! does not depend on the number of threads. It may differ in the last bits between machines with
//! and without fused multiply-add.

#[cfg(test)]
mod tests;

use super::front;
use super::sweep;
use super::symbolic::{Front, Symbolic};
use super::tile::LANES;
use crate::sparse::error::SparseError;
use crate::sparse::pattern::Pattern;
use crate::sparse::scalar::Scalar;
use pulp::{Arch, Simd, WithSimd};
use std::marker::PhantomData;

/// Symbolic factorisation of one pattern.
#[derive(Debug, Clone)]
pub(super) struct Multifrontal {
    symbolic: Symbolic,
    starts: Vec<u32>,
    leading: usize,
    arch: Arch,
}

/// Numeric factor and scratch memory, owned by the caller. Complex numbers are stored in planes
/// ([`crate::sparse::arithmetic`]).
#[derive(Clone)]
pub(super) struct Numbers<T = f64> {
    factor: Vec<f64>,
    stack: Vec<f64>,
    /// Local rows of one front during a sweep.
    rows: Vec<f64>,
    kind: PhantomData<T>,
}

impl<T: Scalar> Numbers<T> {
    /// Number of values in the factor and on the stack.
    pub(crate) fn sizes(&self) -> (usize, usize) {
        (self.factor.len() / T::PLANES, self.stack.len() / T::PLANES)
    }
}

impl Multifrontal {
    /// Analyses a pattern.
    pub(crate) fn new(pattern: &Pattern, leading: usize) -> Self {
        let symbolic = Symbolic::new(pattern, leading);
        Self { symbolic, starts: pattern.column_starts().to_vec(), leading, arch: Arch::new() }
    }

    /// Number of values in the factor, including zeros within fronts and padding.
    pub(crate) fn factor_entries(&self) -> usize {
        self.symbolic.factor_length
    }

    /// Floating-point operations of one factorisation.
    pub(crate) fn flops(&self) -> f64 {
        self.symbolic.flops()
    }

    /// Largest number of values on the stack during a factorisation.
    pub(crate) fn stack_entries(&self) -> usize {
        self.symbolic.stack_length
    }

    /// Allocates memory for the numbers.
    ///
    /// # Errors
    /// [`SparseError::OutOfMemory`].
    pub(crate) fn numbers<T: Scalar>(&self) -> Result<Numbers<T>, SparseError> {
        let unknowns = self.starts.len() - 1;
        let zeros = |length: usize| -> Result<Vec<f64>, SparseError> {
            let (mut values, length) = (Vec::new(), T::PLANES * length);
            let reserved = values.try_reserve_exact(length);
            reserved.map_err(|_| SparseError::OutOfMemory { unknowns })?;
            values.resize(length, 0.0);
            Ok(values)
        };
        Ok(Numbers {
            factor: zeros(self.symbolic.factor_length)?,
            stack: zeros(self.symbolic.stack_length)?,
            rows: Vec::new(),
            kind: PhantomData,
        })
    }

    /// Factorises the matrix with the given values: `A = L L^T` without conjugation and without
    /// pivoting. The error is the unknown whose pivot is not finite or not in the half plane around
    /// `direction` (for real numbers: not above zero).
    pub(crate) fn factorise<T: Scalar>(
        &self,
        values: &[T],
        numbers: &mut Numbers<T>,
        direction: T,
    ) -> Result<(), usize> {
        self.arch.dispatch(Factorise { multifrontal: self, values, numbers, direction })
    }

    /// Computes the largest `(|L| |L^T|)_ii / |a_ii|`.
    #[cfg(feature = "complex")]
    pub(crate) fn growth<T: Scalar>(&self, values: &[T], numbers: &Numbers<T>) -> f64 {
        let mut sums = vec![0.0; self.starts.len() - 1];
        for front in &self.symbolic.fronts {
            let below = &self.symbolic.below[front.below_at..][..front.below];
            for (j, column) in
                front.panel_of(numbers).chunks_exact(T::PLANES * front.stride).enumerate()
            {
                let square = |row: usize| T::read(column, row, front.stride).modulus().powi(2);
                for i in j..front.columns {
                    sums[front.first + i] += square(i);
                }
                for (&row, local) in below.iter().zip(front.padded..) {
                    sums[row as usize] += square(local);
                }
            }
        }
        // rows ascend within a column of the lower triangle, so its first entry is the diagonal
        let diagonal = self.starts.iter().map(|&k| k as usize);
        let ratios = sums.iter().zip(diagonal).map(|(sum, k)| sum / values[k].modulus());
        ratios.fold(0.0, f64::max)
    }

    /// Calls `take` with (row, column, value) of the trailing block of the factor; indices count
    /// from `leading`.
    pub(crate) fn trailing<T: Scalar>(
        &self,
        numbers: &Numbers<T>,
        mut take: impl FnMut(usize, usize, T),
    ) {
        let Some(front) = self.symbolic.fronts.last() else { return };
        let columns = front.panel_of(numbers).chunks_exact(T::PLANES * front.stride);
        for (j, column) in columns.enumerate() {
            (j..front.columns).for_each(|i| take(i, j, T::read(column, i, front.stride)));
        }
    }

    /// Solves `L^T x = y` in place, `x` [unknown, right-hand side] with `count` columns, where `y`
    /// is zero for the unknowns before `leading`. The first call allocates memory for rows.
    pub(crate) fn solve_back<T: Scalar>(
        &self,
        numbers: &mut Numbers<T>,
        x: &mut [T],
        count: usize,
    ) {
        let lanes = count.next_multiple_of(LANES);
        let length = T::PLANES * self.symbolic.longest * lanes;
        if numbers.rows.len() < length {
            numbers.rows.resize(length, 0.0);
        }
        x[..self.leading * count].fill(T::from(0.0));
        self.arch.dispatch(SolveBack { multifrontal: self, numbers, x, count, lanes });
    }
}

impl Front {
    /// Returns the front's columns of the factor, `[column, plane, row]`.
    fn panel_of<'a, T: Scalar>(&self, numbers: &'a Numbers<T>) -> &'a [f64] {
        &numbers.factor[T::PLANES * self.panel..][..T::PLANES * self.columns * self.stride]
    }
}

struct Factorise<'a, T> {
    multifrontal: &'a Multifrontal,
    values: &'a [T],
    numbers: &'a mut Numbers<T>,
    direction: T,
}

impl<T: Scalar> WithSimd for Factorise<'_, T> {
    type Output = Result<(), usize>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        let Self {
            multifrontal: Multifrontal { symbolic, starts, .. },
            values,
            numbers,
            direction,
        } = self;
        let Numbers { factor, stack, .. } = numbers;
        let mut top = 0;
        for &f in &symbolic.sequence {
            let node = &symbolic.fronts[f as usize];
            let stride = node.stride;
            let panel = &mut factor[T::PLANES * node.panel..][..T::PLANES * node.columns * stride];
            panel.fill(0.0);
            let starts = &starts[node.first..=node.first + node.columns];
            front::enter(panel, stride, starts, &symbolic.places, values);
            let (waiting, free) = stack.split_at_mut(top);
            let side = node.rest();
            let size = T::PLANES * side * side;
            let rest = &mut free[..size];
            let mut base = top;
            let children = &symbolic.children[node.children.0..node.children.1];
            if !children.is_empty() {
                front::clear::<T>(rest, side);
            }
            for &child in children.iter().rev() {
                let child = &symbolic.fronts[child as usize];
                let child_side = child.rest();
                let child_size = T::PLANES * child_side * child_side;
                base -= child_size;
                let places = &symbolic.relative[child.below_at..][..child.below];
                let left = &waiting[base..][..child_size];
                front::add_child::<T>(left, child_side, places, panel, stride, rest, node.padded);
            }
            front::eliminate(panel, node.columns, stride, direction)
                .map_err(|column| node.first + column)?;
            if children.is_empty() {
                front::subtract::<T, true>(panel, node.padded, stride, rest);
            } else {
                front::subtract::<T, false>(panel, node.padded, stride, rest);
            }
            if base < top {
                stack.copy_within(top..top + size, base);
            }
            top = base + size;
        }
        Ok(())
    }
}

struct SolveBack<'a, T> {
    multifrontal: &'a Multifrontal,
    numbers: &'a mut Numbers<T>,
    x: &'a mut [T],
    count: usize,
    lanes: usize,
}

impl<T: Scalar> WithSimd for SolveBack<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { multifrontal: Multifrontal { symbolic, .. }, numbers, x, count, lanes } = self;
        let Numbers { factor, rows, .. } = numbers;
        for node in symbolic.fronts.iter().rev() {
            let (columns, stride) = (node.columns, node.stride);
            let width = T::PLANES * lanes;
            let rows = &mut rows[..stride * width];
            let own = &x[node.first * count..][..columns * count];
            for (row, own) in rows.chunks_exact_mut(width).zip(own.chunks_exact(count)) {
                T::spread(own, row, lanes);
            }
            let below = &symbolic.below[node.below_at..][..node.below];
            // clear the padding: a NaN or infinity left by an earlier solve would survive the
            // product with zero
            rows[columns * width..node.padded * width].fill(0.0);
            rows[(node.padded + node.below) * width..].fill(0.0);
            let local = rows[node.padded * width..].chunks_exact_mut(width);
            for (row, &unknown) in local.zip(below) {
                T::spread(&x[unknown as usize * count..][..count], row, lanes);
            }
            let panel = &factor[T::PLANES * node.panel..][..T::PLANES * columns * stride];
            sweep::sweep_back::<T>(panel, columns, stride, rows, lanes);
            let own = &mut x[node.first * count..][..columns * count];
            for (row, own) in rows.chunks_exact(width).zip(own.chunks_exact_mut(count)) {
                T::gather(row, lanes, own);
            }
        }
    }
}
