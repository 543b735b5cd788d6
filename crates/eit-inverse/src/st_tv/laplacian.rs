//! Exact solves with `D' D` for several frames at once, which make nearly feasible dual variables
//! feasible.

use super::differences::ScaledRows;
use super::lanes::vectorised;
use crate::InverseError;
use faer::Par;
use faer::Side;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholeskyRaw, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMat, Triplet};

/// Number of right-hand sides that are solved together.
pub(crate) const SIDES: usize = 8;

/// Cholesky factor `L` of `D' D` with one pinned unknown per part, stored by columns.
///
/// A right-hand side that sums to zero on each part is solved exactly; the pin changes only the
/// additive constant of the solution on a part.
///
/// One solve costs `4 nnz(L)` flops per right-hand side; an entry of `L` and its index are read once for all of them.
#[derive(Debug, Clone)]
pub(crate) struct Laplacian {
    starts: Vec<u32>,
    rows: Vec<u32>,
    values: Vec<f64>,
    /// Unknown at each position of the elimination order.
    order: Vec<u32>,
}

impl Laplacian {
    /// Factorises `D' D`; `part` labels the connected part of each unknown.
    pub(crate) fn new(
        scaled: &ScaledRows,
        part: &[u32],
        parts: usize,
    ) -> Result<Self, InverseError> {
        let unknowns = part.len();
        let failed = InverseError::Factorisation { what: "the gradient's D'D", size: unknowns };
        let mut entries = Vec::new();
        let mut largest = 0.0_f64;
        for row in &scaled.rows {
            for &(p, a) in row {
                largest = largest.max(a * a);
                for &(q, b) in row.iter().filter(|&&(q, _)| q <= p) {
                    entries.push(Triplet::new(p, q, a * b));
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

    /// Solves for [`SIDES`] right-hand sides in place, `x` `[unknown]`; `work` has the same length.
    pub(crate) fn solve(&self, x: &mut [[f64; SIDES]], work: &mut [[f64; SIDES]]) {
        vectorised!(self.substitute(x, work));
    }

    #[inline(always)]
    fn substitute(&self, x: &mut [[f64; SIDES]], work: &mut [[f64; SIDES]]) {
        let Self { starts, rows, values, order } = self;
        for (row, &p) in work.iter_mut().zip(order) {
            *row = x[p as usize];
        }
        // the first entry of a column is its diagonal
        for j in 0..order.len() {
            let [first, end] = [starts[j] as usize, starts[j + 1] as usize];
            let own = scale(1.0 / values[first], work[j]);
            work[j] = own;
            for k in first + 1..end {
                let row = &mut work[rows[k] as usize];
                *row = add(-values[k], own, *row);
            }
        }
        for j in (0..order.len()).rev() {
            let [first, end] = [starts[j] as usize, starts[j + 1] as usize];
            let mut own = work[j];
            for k in first + 1..end {
                own = add(-values[k], work[rows[k] as usize], own);
            }
            work[j] = scale(1.0 / values[first], own);
        }
        for (row, &p) in work.iter().zip(order) {
            x[p as usize] = *row;
        }
    }
}

#[inline(always)]
fn scale(factor: f64, mut row: [f64; SIDES]) -> [f64; SIDES] {
    for x in &mut row {
        *x *= factor;
    }
    row
}

/// Returns `sum + factor * row`.
#[inline(always)]
fn add(factor: f64, row: [f64; SIDES], mut sum: [f64; SIDES]) -> [f64; SIDES] {
    for l in 0..SIDES {
        sum[l] = factor.mul_add(row[l], sum[l]);
    }
    sum
}
