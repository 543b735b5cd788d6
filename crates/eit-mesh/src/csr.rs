//! A sparse matrix in compressed-row format, with the operations that the raster needs.

use crate::MeshError;
use ndarray::{Array2, ArrayView2};

/// A sparse matrix [row, column] in compressed sparse rows (CSR).
///
/// Row `r` holds the entries `row_starts[r]..row_starts[r + 1]` of `column_indices` and `values`;
/// columns ascend within a row. Only this crate creates these matrices, and they are always valid:
/// products fail only for vectors of the wrong length.
#[derive(Debug, Clone, PartialEq)]
pub struct CsrMatrix {
    columns: usize,
    row_starts: Vec<usize>,
    column_indices: Vec<u32>,
    values: Vec<f64>,
}

impl CsrMatrix {
    /// Stores rows without checking them. The caller guarantees that `row_starts` ascends from 0 to
    /// the number of entries, that there are as many columns as values, and that every column is
    /// below `columns`.
    pub(crate) fn from_parts(
        columns: usize,
        row_starts: Vec<usize>,
        column_indices: Vec<u32>,
        values: Vec<f64>,
    ) -> Self {
        debug_assert!(row_starts.is_sorted() && row_starts.first() == Some(&0));
        debug_assert_eq!(row_starts.last(), Some(&values.len()));
        debug_assert_eq!(column_indices.len(), values.len());
        debug_assert!(column_indices.iter().all(|&c| (c as usize) < columns));
        Self { columns, row_starts, column_indices, values }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.row_starts.len() - 1
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Start of each row in [`column_indices`](Self::column_indices) and [`values`](Self::values),
    /// followed by the total number of entries: one element more than there are rows.
    pub fn row_starts(&self) -> &[usize] {
        &self.row_starts
    }

    /// Column of each entry, row by row, ascending within a row.
    pub fn column_indices(&self) -> &[u32] {
        &self.column_indices
    }

    /// Value of each entry, row by row.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Returns the columns and values of one row, or empty slices if the row does not exist.
    pub fn row(&self, row: usize) -> (&[u32], &[f64]) {
        match self.row_starts.get(row..=row.saturating_add(1)) {
            Some(&[start, end]) => (&self.column_indices[start..end], &self.values[start..end]),
            _ => (&[], &[]),
        }
    }

    /// Computes `y = A x` without allocating; `x` has one value per column, `y` one per row.
    ///
    /// # Errors
    /// [`MeshError::WrongLength`].
    pub fn apply(&self, x: &[f64], y: &mut [f64]) -> Result<(), MeshError> {
        MeshError::check_length("columns of the sparse matrix", x.len(), self.columns)?;
        MeshError::check_length("rows of the sparse matrix", y.len(), self.rows())?;
        for (row, value) in y.iter_mut().enumerate() {
            let (columns, weights) = self.row(row);
            *value = sparse_dot(columns, weights, x);
        }
        Ok(())
    }

    /// Computes `A B` [row, k] for a dense `B` [column, k], for example to turn a reconstruction
    /// matrix [element, measurement] into one [masked pixel, measurement].
    ///
    /// # Errors
    /// [`MeshError::WrongLength`].
    pub fn multiply_dense(&self, b: ArrayView2<'_, f64>) -> Result<Array2<f64>, MeshError> {
        MeshError::check_length("columns of the sparse matrix", b.nrows(), self.columns)?;
        let mut product = Array2::zeros((self.rows(), b.ncols()));
        for (row, mut sum) in product.rows_mut().into_iter().enumerate() {
            let (columns, weights) = self.row(row);
            for (&c, &w) in columns.iter().zip(weights) {
                sum.scaled_add(w, &b.row(c as usize));
            }
        }
        Ok(product)
    }

    /// Computes `B A` [k, column] for a dense `B` [k, row], for example to turn a Jacobian
    /// [measurement, element] into one [measurement, masked pixel] through `element_from_pixel`.
    ///
    /// # Errors
    /// [`MeshError::WrongLength`].
    pub fn premultiply_dense(&self, b: ArrayView2<'_, f64>) -> Result<Array2<f64>, MeshError> {
        MeshError::check_length("rows of the sparse matrix", b.ncols(), self.rows())?;
        let mut product = Array2::zeros((b.nrows(), self.columns));
        for (left, mut sums) in b.rows().into_iter().zip(product.rows_mut()) {
            for (row, &factor) in left.iter().enumerate() {
                let (columns, weights) = self.row(row);
                for (&c, w) in columns.iter().zip(weights) {
                    sums[c as usize] += factor * w;
                }
            }
        }
        Ok(product)
    }
}

/// Uses four partial sums: a quarter of the rounding error of one running sum, and no slower.
fn sparse_dot(columns: &[u32], weights: &[f64], x: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (column_fours, column_rest) = columns.as_chunks::<4>();
    let (weight_fours, weight_rest) = weights.as_chunks::<4>();
    for (c, w) in column_fours.iter().zip(weight_fours) {
        for k in 0..4 {
            sums[k] += w[k] * x[c[k] as usize];
        }
    }
    for (k, (&c, w)) in column_rest.iter().zip(weight_rest).enumerate() {
        sums[k] += w * x[c as usize];
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}
