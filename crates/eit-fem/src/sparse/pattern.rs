//! Sparsity pattern of a symmetric matrix.

use super::scalar::Scalar;

/// Sparsity pattern of a symmetric matrix: its lower triangle by columns, including the diagonal.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Pattern {
    column_starts: Vec<u32>,
    rows: Vec<u32>,
}

impl Pattern {
    /// Builds a pattern from pairs of unknowns less than `unknowns`, in any order; pairs may be
    /// repeated. The diagonal is added.
    pub(crate) fn new(unknowns: usize, pairs: impl Iterator<Item = [u32; 2]>) -> Self {
        let diagonal = (0..unknowns as u32).map(|k| [k, k]);
        let mut places: Vec<(u32, u32)> = diagonal.chain(pairs).map(lower).collect();
        places.sort_unstable();
        places.dedup();
        let mut column_starts = vec![0u32; unknowns + 1];
        for &(column, _) in &places {
            column_starts[column as usize + 1] += 1;
        }
        for k in 0..unknowns {
            column_starts[k + 1] += column_starts[k];
        }
        Self { column_starts, rows: places.into_iter().map(|p| p.1).collect() }
    }

    /// Number of unknowns.
    pub fn unknowns(&self) -> usize {
        self.column_starts.len() - 1
    }

    /// Number of stored entries.
    pub fn entries(&self) -> usize {
        self.rows.len()
    }

    /// Start of each column in the entries, and the end of the last.
    pub fn column_starts(&self) -> &[u32] {
        &self.column_starts
    }

    /// Row of each entry; within a column, rows ascend from the diagonal.
    pub fn rows(&self) -> &[u32] {
        &self.rows
    }

    /// Entry index of each diagonal element.
    pub fn diagonal(&self) -> impl Iterator<Item = usize> {
        // rows ascend within a column of the lower triangle, so its first entry is the diagonal
        self.column_starts[..self.unknowns()].iter().map(|&entry| entry as usize)
    }

    /// Entry index of a pair of unknowns, which must be in the pattern.
    pub(crate) fn entry(&self, pair: [u32; 2]) -> u32 {
        let (column, row) = lower(pair);
        let from = self.column_starts[column as usize];
        let to = self.column_starts[column as usize + 1];
        let rows = &self.rows[from as usize..to as usize];
        from + rows.partition_point(|r| *r < row) as u32
    }

    /// Computes `y = A x` and `z = |A| |x|` with the full symmetric matrix.
    pub(crate) fn multiply<T: Scalar>(&self, values: &[T], x: &[T], y: &mut [T], z: &mut [f64]) {
        y.fill(T::from(0.0));
        z.fill(0.0);
        for column in 0..self.unknowns() {
            let from = self.column_starts[column] as usize;
            let to = self.column_starts[column + 1] as usize;
            for (&row, &value) in self.rows[from..to].iter().zip(&values[from..to]) {
                let row = row as usize;
                y[row] += value * x[column];
                z[row] += (value * x[column]).modulus();
                if row != column {
                    y[column] += value * x[row];
                    z[column] += (value * x[row]).modulus();
                }
            }
        }
    }
}

/// Returns a pair as (column, row) in the lower triangle.
fn lower([i, j]: [u32; 2]) -> (u32, u32) {
    (i.min(j), i.max(j))
}
