//! Exact solves with `D' D` for many frames at once, which make nearly feasible dual variables
//! feasible.

use super::kernel::LANES;
use super::operators::Rows;
use crate::InverseError;
use faer::Par;
use faer::Side;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholeskyRaw, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMat, Triplet};
use pulp::{Arch, Simd, WithSimd};

/// Cholesky factor `L` of `D' D` with one pinned unknown per part, stored by columns.
///
/// A right-hand side that sums to zero on each part is solved exactly; the pin changes only the
/// additive constant of the solution on a part.
///
/// One solve costs `4 nnz(L)` flops per frame. The substitutions run along the frames, so that an
/// entry of `L` and its index are read once for all of them.
#[derive(Debug, Clone)]
pub(crate) struct Laplacian {
    starts: Vec<u32>,
    rows: Vec<u32>,
    values: Vec<f64>,
    /// Unknown at each position of the elimination order.
    order: Vec<u32>,
}

impl Laplacian {
    /// Factorises `D' D` for the rows of `D`; `part` labels the connected part of each unknown.
    pub(crate) fn new(
        gradient: &Rows<f64>,
        unknowns: usize,
        part: &[u32],
        parts: usize,
    ) -> Result<Self, InverseError> {
        let failed = InverseError::Factorisation { what: "the gradient's D'D", size: unknowns };
        let mut entries = Vec::new();
        let mut largest = 0.0_f64;
        for row in 0..gradient.count() {
            for (p, a) in gradient.row(row) {
                largest = largest.max(a * a);
                for (q, b) in gradient.row(row).filter(|&(q, _)| q <= p) {
                    entries.push(Triplet::new(p as u32, q as u32, a * b));
                }
            }
        }
        let mut pinned = vec![false; parts];
        let pin = if largest > 0.0 { largest } else { 1.0 };
        for (p, &label) in part.iter().enumerate() {
            let first = !std::mem::replace(&mut pinned[label as usize], true);
            entries.push(Triplet::new(p as u32, p as u32, if first { pin } else { 0.0 }));
        }
        let matrix = SparseColMat::<u32, f64>::try_new_from_triplets(unknowns, unknowns, &entries)
            .map_err(|_| failed.clone())?;
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SIMPLICIAL,
            ..Default::default()
        };
        let ordering = SymmetricOrdering::Amd;
        let symbolic =
            factorize_symbolic_cholesky(matrix.symbolic(), Side::Lower, ordering, params)
                .map_err(|_| failed.clone())?;
        let mut values = vec![0.0; symbolic.len_val()];
        let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default());
        symbolic
            .factorize_numeric_llt(
                &mut values,
                matrix.as_ref(),
                Side::Lower,
                Default::default(),
                Par::Seq,
                MemStack::new(&mut MemBuffer::new(scratch)),
                Default::default(),
            )
            .map_err(|_| failed.clone())?;
        let SymbolicCholeskyRaw::Simplicial(pattern) = symbolic.raw() else { return Err(failed) };
        let order = match symbolic.perm() {
            Some(perm) => perm.arrays().0.to_vec(),
            None => (0..unknowns as u32).collect(),
        };
        let (starts, rows) = (pattern.col_ptr().to_vec(), pattern.row_idx().to_vec());
        Ok(Self { starts, rows, values, order })
    }

    /// Solves for all frames in place, `x` `[unknown][stride]`; `work` has the same length.
    pub(crate) fn solve(&self, arch: Arch, x: &mut [f64], work: &mut [f64], stride: usize) {
        arch.dispatch(Solve { laplacian: self, x, work, stride });
    }
}

struct Solve<'a> {
    laplacian: &'a Laplacian,
    x: &'a mut [f64],
    work: &'a mut [f64],
    stride: usize,
}

impl WithSimd for Solve<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { laplacian, x, work, stride } = self;
        let Laplacian { starts, rows, values, order } = laplacian;
        for (row, &p) in work.chunks_exact_mut(stride).zip(order) {
            row.copy_from_slice(&x[p as usize * stride..][..stride]);
        }
        let column = |j: usize| {
            let range = starts[j] as usize..starts[j + 1] as usize;
            rows[range.clone()].iter().map(|&i| i as usize).zip(&values[range])
        };
        for j in 0..order.len() {
            let (done, below) = work.split_at_mut((j + 1) * stride);
            let own = &mut done[j * stride..];
            for (i, &value) in column(j) {
                if i == j {
                    scale(1.0 / value, own);
                } else {
                    let target = &mut below[(i - j - 1) * stride..][..stride];
                    super::kernel::add_scaled(-value, own, target);
                }
            }
        }
        for j in (0..order.len()).rev() {
            let (done, below) = work.split_at_mut((j + 1) * stride);
            let own = &mut done[j * stride..];
            let mut diagonal = 1.0;
            for (i, &value) in column(j) {
                if i == j {
                    diagonal = value;
                } else {
                    let source = &below[(i - j - 1) * stride..][..stride];
                    super::kernel::add_scaled(-value, source, own);
                }
            }
            scale(1.0 / diagonal, own);
        }
        for (row, &p) in work.chunks_exact(stride).zip(order) {
            x[p as usize * stride..][..stride].copy_from_slice(row);
        }
    }
}

#[inline(always)]
fn scale(factor: f64, row: &mut [f64]) {
    for chunk in row.as_chunks_mut::<LANES>().0 {
        chunk.iter_mut().for_each(|x| *x *= factor);
    }
}
