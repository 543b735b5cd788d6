//! Symmetric matrices and Cholesky factors of faer, without allocation once grown. Costs for `n` rows: factor `n^3 / 3` flops, a
//! solve `n^2` for each vector.

use faer::dyn_stack::MemStack;
use faer::linalg::cholesky::llt::factor::{self, LltRegularization};
use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::linalg::triangular_solve as triangular;
use faer::{Accum, Mat, MatMut, MatRef, Par};
use std::mem::MaybeUninit;

/// Pivot below which a matrix counts as singular along that row, relative to its least diagonal: rounding of `n^2` sums.
const LEAST_PIVOT: f64 = 1e-13;

/// A symmetric matrix: what is above the diagonal does not count.
#[derive(Debug, Clone)]
pub(super) struct Symmetric {
    lower: Mat<f64>,
}

impl Default for Symmetric {
    fn default() -> Self {
        Self { lower: Mat::new() }
    }
}

impl Symmetric {
    pub(super) fn zeros(n: usize) -> Self {
        Self { lower: Mat::zeros(n, n) }
    }

    /// Number of rows.
    pub(super) fn n(&self) -> usize {
        self.lower.nrows()
    }

    /// Sets the size; all entries become zero.
    pub(super) fn reset(&mut self, n: usize) {
        self.lower.resize_with(n, n, |_, _| 0.0);
        self.lower.as_mut().fill(0.0);
    }

    /// Takes the entries of another matrix.
    pub(super) fn set(&mut self, other: &Self) {
        self.lower.resize_with(other.n(), other.n(), |_, _| 0.0);
        self.lower.copy_from(&other.lower);
    }

    /// The diagonal and what is below it of a column.
    #[inline(always)]
    pub(super) fn column(&self, j: usize) -> &[f64] {
        &self.lower.col_as_slice(j)[j..]
    }

    #[inline(always)]
    pub(super) fn column_mut(&mut self, j: usize) -> &mut [f64] {
        &mut self.lower.col_as_slice_mut(j)[j..]
    }

    #[inline(always)]
    pub(super) fn get(&self, i: usize, j: usize) -> f64 {
        self.lower[(i.max(j), i.min(j))]
    }

    /// Adds a value at `i, j` and `j, i`.
    #[inline(always)]
    pub(super) fn add_at(&mut self, i: usize, j: usize, value: f64) {
        self.lower[(i.max(j), i.min(j))] += value;
    }

    pub(super) fn add_diagonal(&mut self, value: f64) {
        (0..self.n()).for_each(|i| self.lower[(i, i)] += value);
    }

    /// Adds `weight` times another matrix of the same size.
    pub(super) fn add(&mut self, weight: f64, other: &Self) {
        for j in 0..self.n() {
            let column = self.column_mut(j).iter_mut().zip(other.column(j));
            column.for_each(|(a, b)| *a += weight * b);
        }
    }

    pub(super) fn scale(&mut self, factor: f64) {
        (0..self.n()).for_each(|j| self.column_mut(j).iter_mut().for_each(|a| *a *= factor));
    }

    /// Adds `weight v v'`.
    pub(super) fn add_square(&mut self, weight: f64, v: &[f64]) {
        self.add_outer(weight, v, v);
    }

    /// Adds the lower triangle of `weight a b'`.
    pub(super) fn add_outer(&mut self, weight: f64, a: &[f64], b: &[f64]) {
        for (j, bj) in b.iter().enumerate().filter(|(_, bj)| **bj != 0.0) {
            let w = weight * bj;
            self.column_mut(j).iter_mut().zip(&a[j..]).for_each(|(out, ai)| *out += w * ai);
        }
    }

    /// Adds `weight A A'` for the columns of `A`, one after the other; `n^2 k` flops for `k` columns.
    pub(super) fn add_product(&mut self, weight: f64, columns: &[f64]) {
        let (n, k) = (self.n(), columns.len() / self.n().max(1));
        let columns = MatRef::from_column_major_slice(&columns[..n * k], n, k);
        self.multiply(weight, columns, columns.transpose());
    }

    /// Adds `weight A'A` for the columns of `A`, one after the other, of `m` rows; `n^2 m` flops.
    pub(super) fn add_inner_product(&mut self, weight: f64, columns: &[f64], m: usize) {
        let columns = MatRef::from_column_major_slice(columns, m, self.n());
        self.multiply(weight, columns.transpose(), columns);
    }

    fn multiply(&mut self, weight: f64, a: MatRef<'_, f64>, b: MatRef<'_, f64>) {
        let (lower, whole) = (BlockStructure::TriangularLower, BlockStructure::Rectangular);
        matmul(self.lower.as_mut(), lower, Accum::Add, a, whole, b, whole, weight, Par::Seq);
    }
}

/// Cholesky factor `L` of a symmetric matrix `L L'`.
#[derive(Debug, Clone)]
pub(super) struct Factor {
    lower: Mat<f64>,
    memory: Vec<MaybeUninit<u8>>,
}

impl Default for Factor {
    fn default() -> Self {
        Self { lower: Mat::new(), memory: Vec::new() }
    }
}

impl Factor {
    /// Factorises a finite matrix. A pivot that rounding has made too small is raised, so that the factor always exists.
    pub(super) fn of(&mut self, matrix: &Symmetric) {
        let n = matrix.n();
        self.lower.resize_with(n, n, |_, _| 0.0);
        self.lower.copy_from(&matrix.lower);
        let least = (0..n).map(|i| matrix.get(i, i)).fold(f64::INFINITY, f64::min);
        let least = (LEAST_PIVOT * least).max(f64::MIN_POSITIVE);
        let regularization = LltRegularization {
            dynamic_regularization_delta: least,
            dynamic_regularization_epsilon: least,
        };
        let needed = factor::cholesky_in_place_scratch::<f64>(n, Par::Seq, Default::default());
        self.memory.resize(needed.unaligned_bytes_required(), MaybeUninit::uninit());
        let stack = MemStack::new(&mut self.memory);
        let lower = self.lower.as_mut();
        let done =
            factor::cholesky_in_place(lower, regularization, Par::Seq, stack, Default::default());
        if done.is_err() {
            // an entry that is not finite: nothing is known
            self.lower.as_mut().fill(0.0);
            (0..n).for_each(|i| self.lower[(i, i)] = f64::MAX.sqrt());
        }
        // faer divides by the pivot that it has raised, but does not store it
        (0..n).for_each(|i| self.lower[(i, i)] = self.lower[(i, i)].max(least.sqrt()));
    }

    /// Computes `L^-1 x` for vectors one after the other.
    pub(super) fn solve(&self, vectors: &mut [f64]) {
        let n = self.lower.nrows();
        let count = vectors.len() / n.max(1);
        let right = MatMut::from_column_major_slice_mut(vectors, n, count);
        triangular::solve_lower_triangular_in_place(self.lower.as_ref(), right, Par::Seq);
    }

    /// Computes `L'^-1 x` for vectors one after the other.
    pub(super) fn solve_transposed(&self, vectors: &mut [f64]) {
        let n = self.lower.nrows();
        let count = vectors.len() / n.max(1);
        let right = MatMut::from_column_major_slice_mut(vectors, n, count);
        triangular::solve_upper_triangular_in_place(self.lower.transpose(), right, Par::Seq);
    }

    /// Sets `out` to the inverse of `L L'`.
    pub(super) fn invert(&self, out: &mut Symmetric, work: &mut Vec<f64>) {
        let n = self.lower.nrows();
        work.clear();
        work.resize(n * n, 0.0);
        (0..n).for_each(|i| work[i * n + i] = 1.0);
        self.solve(work);
        out.reset(n);
        out.add_inner_product(1.0, work, n);
    }

    /// Computes `L x`.
    pub(super) fn multiply(&self, x: &mut [f64]) {
        for j in (0..x.len()).rev() {
            let value = std::mem::take(&mut x[j]);
            let column = &self.lower.col_as_slice(j)[j..];
            x[j..].iter_mut().zip(column).for_each(|(x, l)| *x += value * l);
        }
    }

    /// Logarithm of the determinant of `L L'`.
    pub(super) fn log_determinant(&self) -> f64 {
        (0..self.lower.nrows()).map(|i| 2.0 * self.lower[(i, i)].ln()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::Mat;
    use fixtures::Random;

    fn random(n: usize) -> (Symmetric, Mat<f64>) {
        let mut random = Random::new(n as u64 + 1);
        let rows: Vec<f64> = (0..n * (n + 3)).map(|_| random.normal()).collect();
        let mut matrix = Symmetric::zeros(n);
        matrix.add_product(1.0, &rows);
        matrix.add_diagonal(0.5);
        let whole = Mat::from_fn(n, n, |i, j| matrix.get(i, j));
        (matrix, whole)
    }

    /// `L^-1 A L'^-1 = I`, `L x` after `L^-1`, and the determinant.
    #[test]
    fn factors_solve() {
        for n in [1, 3, 4, 5, 8, 23] {
            let (matrix, whole) = random(n);
            let mut factor = Factor::default();
            factor.of(&matrix);
            let determinant = whole.determinant().ln();
            assert!((factor.log_determinant() - determinant).abs() < 1e-9);
            let mut vectors: Vec<f64> =
                (0..n).flat_map(|j| (0..n).map(move |i| (i, j))).map(|ij| whole[ij]).collect();
            factor.solve(&mut vectors);
            let mut first: Vec<f64> = vectors[..n].to_vec();
            factor.multiply(&mut first);
            assert!((0..n).all(|i| (first[i] - whole[(i, 0)]).abs() < 1e-9), "{n}");
            for (j, x) in vectors.chunks_exact_mut(n).enumerate() {
                factor.solve_transposed(x);
                for (i, x) in x.iter().enumerate() {
                    assert!((x - f64::from(u8::from(i == j))).abs() < 1e-9, "{n} {i} {j} {x}");
                }
            }
        }
    }

    /// A matrix of rank one has a finite factor.
    #[test]
    fn a_singular_matrix_has_a_factor() {
        let mut matrix = Symmetric::zeros(6);
        matrix.add_square(1.0, &[1.0; 6]);
        let mut factor = Factor::default();
        factor.of(&matrix);
        let mut x = [1.0; 6];
        factor.solve(&mut x);
        assert!(x.iter().all(|x| x.is_finite()) && factor.log_determinant().is_finite());
    }
}
