//! Small dense row-major matrices for the data steps.

use super::lanes::vectorised;
use crate::InverseError;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::{Col, Mat, Par, Spec};

/// Returns the dot product.
#[inline(always)]
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut parts = [0.0; 8];
    let (whole_a, rest_a) = a.as_chunks::<8>();
    let (whole_b, rest_b) = b.as_chunks::<8>();
    for (a, b) in whole_a.iter().zip(whole_b) {
        for l in 0..8 {
            parts[l] = a[l].mul_add(b[l], parts[l]);
        }
    }
    let mut sum = (parts[0] + parts[4]) + (parts[1] + parts[5]);
    sum += (parts[2] + parts[6]) + (parts[3] + parts[7]);
    for (a, b) in rest_a.iter().zip(rest_b) {
        sum += a * b;
    }
    sum
}

/// Computes `out = matrix x`, by rows, with eight partial sums that the compiler keeps in registers.
#[inline(always)]
pub(crate) fn rows_times(matrix: &[f64], x: &[f64], out: &mut [f64]) {
    if x.is_empty() {
        return out.fill(0.0);
    }
    for (row, out) in matrix.chunks_exact(x.len()).zip(out) {
        *out = dot(row, x);
    }
}

/// [`rows_times`] for callers outside of a vectorised loop.
pub(crate) fn multiply(matrix: &[f64], x: &[f64], out: &mut [f64]) {
    vectorised!(rows_times(matrix, x, out));
}

/// Inverts a symmetric matrix `[n][n]` whose eigenvalues are at least 1, in place, by Gauss-Jordan elimination without
/// pivoting: no pivot is below 1.
#[inline(always)]
pub(crate) fn invert(matrix: &mut [f64], n: usize) {
    for k in 0..n {
        let (before, rest) = matrix.split_at_mut(k * n);
        let (row, after) = rest.split_at_mut(n);
        let inverse = 1.0 / row[k];
        row[k] = 1.0;
        for v in row.iter_mut() {
            *v *= inverse;
        }
        for other in before.chunks_exact_mut(n).chain(after.chunks_exact_mut(n)) {
            let factor = other[k];
            other[k] = 0.0;
            for (o, r) in other.iter_mut().zip(row.iter()) {
                *o = (-factor).mul_add(*r, *o);
            }
        }
    }
}

/// Computes `F' G F` from the rows of `F'`; `half` is scratch memory.
#[inline(always)]
pub(crate) fn congruent(f: &[f64], gram: &[f64], half: &mut [f64], rank: usize, out: &mut [f64]) {
    let rows = f.len() / rank;
    for (row, half) in f.chunks_exact(rank).zip(half.chunks_exact_mut(rank)) {
        rows_times(gram, row, half);
    }
    for i in 0..rows {
        for j in 0..=i {
            let own = dot(&half[i * rank..][..rank], &f[j * rank..][..rank]);
            out[i * rows + j] = own;
            out[j * rows + i] = own;
        }
    }
}

/// Solves a semidefinite system `[n][n + 1]` with the right-hand side in the last column, which is
/// replaced by the solution. Uses elimination with diagonal pivots; the solution is zero in null
/// directions.
pub(crate) fn solve_semidefinite(rows: &mut [f64], n: usize) {
    let width = n + 1;
    let floor = (0..n).map(|k| rows[k * width + k]).fold(0.0, f64::max) * 1e-12;
    // a diagonal entry of -1 marks a row that has been a pivot
    for _ in 0..n {
        let mut pivot = None;
        let mut most = floor;
        for k in 0..n {
            if rows[k * width + k] > most {
                most = rows[k * width + k];
                pivot = Some(k);
            }
        }
        let Some(k) = pivot else { break };
        for c in 0..width {
            if c != k {
                rows[k * width + c] /= most;
            }
        }
        for i in (0..n).filter(|&i| i != k) {
            let factor = rows[i * width + k];
            for c in (0..width).filter(|&c| c != k) {
                rows[i * width + c] -= factor * rows[k * width + c];
            }
            rows[i * width + k] = 0.0;
        }
        rows[k * width + k] = -1.0;
    }
    for k in 0..n {
        if rows[k * width + k] != -1.0 {
            rows[k * width + n] = 0.0;
        }
    }
}

/// Memory for an eigenvalue decomposition, needed only by a constrained data term.
pub(crate) struct Eigen {
    matrix: Mat<f64>,
    vectors: Mat<f64>,
    values: Col<f64>,
    memory: MemBuffer,
}

impl Clone for Eigen {
    /// The memory is scratch, and faer cannot copy it.
    fn clone(&self) -> Self {
        let (matrix, vectors) = (self.matrix.clone(), self.vectors.clone());
        Self { matrix, vectors, values: self.values.clone(), ..Self::new(self.matrix.nrows()) }
    }
}

impl std::fmt::Debug for Eigen {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Eigen").finish_non_exhaustive()
    }
}

impl Eigen {
    pub(crate) fn new(rank: usize) -> Self {
        let yes = ComputeEigenvectors::Yes;
        let scratch = self_adjoint_evd_scratch::<f64>(rank, yes, Par::Seq, Spec::default());
        Self {
            matrix: Mat::zeros(rank, rank),
            vectors: Mat::zeros(rank, rank),
            values: Col::zeros(rank),
            memory: MemBuffer::new(scratch),
        }
    }

    /// Computes the eigenvalues and eigenvectors (as rows) of a symmetric matrix.
    pub(crate) fn set(
        &mut self,
        matrix: &[f64],
        n: usize,
        values: &mut [f64],
        vectors: &mut [f64],
    ) -> Result<(), InverseError> {
        // the matrix may be smaller than the memory; the rest stays zero
        self.matrix.fill(0.0);
        for i in 0..n {
            for j in 0..n {
                self.matrix[(i, j)] = matrix[i * n + j];
            }
        }
        let size = self.matrix.nrows();
        let part = self.matrix.as_ref().get(..n, ..n);
        self_adjoint_evd(
            part,
            self.values.as_mut().get_mut(..n).as_diagonal_mut(),
            Some(self.vectors.as_mut().get_mut(..n, ..n)),
            Par::Seq,
            MemStack::new(&mut self.memory),
            Spec::default(),
        )
        .map_err(|_| InverseError::Factorisation {
            what: "eigenvalues of a constrained frame",
            size,
        })?;
        for i in 0..n {
            values[i] = self.values[i].max(0.0);
            for j in 0..n {
                vectors[i * n + j] = self.vectors[(j, i)];
            }
        }
        Ok(())
    }
}
