//! Data term of the good channels of a frame as a function of the coefficients `c = V' x`:
//! `|F' c - t|^2 + rest^2`, exactly.
//!
//! With all channels `F = diag(S)`. With masked channels the remaining rows of `U S` are factored as
//! `Q F'` by Householder reflections, which preserves the accuracy of every singular value; a Gram
//! matrix would square the condition number. The factor is kept until the mask changes.
//!
//! Over 300 lines with its test, because the factorisation, the transformation of data and its inverse
//! share one set of reflections.

use super::Compression;
use crate::st_tv::dense::{dot, multiply};
use crate::st_tv::lanes::vectorised;
use faer::Mat;

/// Data operator `F'` for one set of good channels.
#[derive(Debug, Clone)]
pub(crate) struct Seen {
    /// Used and unmasked channels, `[measurement]`.
    pub(crate) good: Vec<bool>,
    pub(crate) count: usize,
    /// Whether all used channels of the protocol are good.
    pub(crate) is_whole: bool,
    /// Number of rows of `F'`.
    pub(crate) rows: usize,
    /// `F'` `[row][rank]`.
    pub(crate) transposed: Vec<f64>,
    /// Row sums of `|F'| |F|`, `[row]`, and column sums of `|F'|`, `[rank]`.
    squares: Vec<f64>,
    sums: Vec<f64>,
    /// Householder vectors, by columns of `[good channel]`, and their factors.
    reflections: Vec<f64>,
    factors: Vec<f64>,
    /// Good channels in order.
    channels: Vec<usize>,
}

/// Data of a frame in the coordinates of its [`Seen`].
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Target {
    /// `t`, `[row of F']`.
    pub(crate) values: Vec<f64>,
    pub(crate) rest_squared: f64,
    /// The part of the data that no image explains: per measurement for frames without masked
    /// channels, otherwise after the rows of `F'` in the reflected coordinates.
    pub(crate) rest: Vec<f64>,
}

impl Target {
    pub(crate) fn zero(compression: &Compression) -> Self {
        let (rank, measurements) = (compression.rank(), compression.measurements);
        Self { values: vec![0.0; rank], rest_squared: 0.0, rest: vec![0.0; measurements] }
    }

    /// Returns the squared norm of the part of the data that an image can explain.
    pub(crate) fn square(&self) -> f64 {
        self.values.iter().map(|b| b * b).sum()
    }

    /// Rescales the target to a larger or smaller unit.
    pub(crate) fn divide(&mut self, unit: f64) {
        self.values.iter_mut().chain(&mut self.rest).for_each(|b| *b /= unit);
        self.rest_squared /= unit * unit;
    }
}

impl Seen {
    pub(crate) fn new(compression: &Compression) -> Self {
        let (rank, measurements) = (compression.rank(), compression.measurements);
        let mut this = Self {
            good: vec![false; measurements],
            count: 0,
            is_whole: false,
            rows: 0,
            transposed: vec![0.0; rank * rank],
            squares: vec![0.0; rank],
            sums: vec![0.0; rank],
            reflections: vec![0.0; rank * measurements],
            factors: vec![0.0; rank],
            channels: Vec::with_capacity(measurements),
        };
        this.set(compression, |_| true);
        this
    }

    /// Returns whether this is the operator for the given good channels.
    pub(crate) fn fits(&self, compression: &Compression, good: impl Fn(usize) -> bool) -> bool {
        let weights = compression.root_weights.iter().enumerate();
        self.good.iter().zip(weights).all(|(&own, (i, w))| own == (*w > 0.0 && good(i)))
    }

    /// Sets the good channels. Does not allocate.
    pub(crate) fn set(&mut self, compression: &Compression, good: impl Fn(usize) -> bool) {
        let rank = compression.rank();
        self.channels.clear();
        let mut used = 0;
        for (i, &weight) in compression.root_weights.iter().enumerate() {
            self.good[i] = weight > 0.0 && good(i);
            used += usize::from(weight > 0.0);
            if self.good[i] {
                self.channels.push(i);
            }
        }
        self.count = self.channels.len();
        self.is_whole = self.count == used;
        self.transposed.fill(0.0);
        if self.is_whole {
            self.rows = rank;
            for (k, s) in compression.singular.iter().enumerate() {
                self.transposed[k * rank + k] = *s;
            }
        } else {
            self.rows = rank.min(self.count);
            self.factor(compression);
        }
        self.set_squares();
    }

    /// Computes `F' c`, padded with zeros.
    pub(crate) fn apply(&self, c: &[f64], out: &mut [f64]) {
        let rank = c.len();
        if self.is_whole {
            for (k, (out, c)) in out.iter_mut().zip(c).enumerate() {
                *out = self.transposed[k * (rank + 1)] * c;
            }
            return;
        }
        out.fill(0.0);
        multiply(&self.transposed[..self.rows * rank], c, &mut out[..self.rows]);
    }

    /// Computes `F y`.
    pub(crate) fn apply_transposed(&self, y: &[f64], out: &mut [f64]) {
        let rank = out.len();
        if self.is_whole {
            return self.apply(y, out);
        }
        out.fill(0.0);
        for (y, row) in y.iter().zip(self.transposed.chunks_exact(rank)).take(self.rows) {
            out.iter_mut().zip(row).for_each(|(o, f)| *o += y * f);
        }
    }

    /// Computes `D F' c` with a diagonal `D` such that `F D F'` has no eigenvalue above 1, and of almost 1 for
    /// singular values whose square is above `floor`: `D = 1 / (S^2 + floor)` without masked channels.
    pub(crate) fn absorb(&self, c: &[f64], floor: f64, out: &mut [f64]) {
        self.apply(c, out);
        let scales = self.squares.iter().map(|square| 1.0 / (square + floor));
        out.iter_mut().zip(scales).for_each(|(out, scale)| *out *= scale);
    }

    /// Sums `|F'| |F|` over its rows, which bounds its eigenvalues as a diagonal matrix.
    fn set_squares(&mut self) {
        let rank = self.squares.len();
        self.squares.fill(0.0);
        if self.is_whole {
            let diagonal = self.transposed.iter().step_by(rank + 1);
            self.squares.iter_mut().zip(diagonal).for_each(|(square, s)| *square = s * s);
            return;
        }
        self.sums.fill(0.0);
        let rows = || self.transposed.chunks_exact(rank).take(self.rows);
        for row in rows() {
            self.sums.iter_mut().zip(row).for_each(|(sum, f)| *sum += f.abs());
        }
        for (square, row) in self.squares.iter_mut().zip(rows()) {
            *square = row.iter().zip(&self.sums).map(|(f, sum)| f.abs() * sum).sum();
        }
    }

    /// Factorises the remaining rows of `U S` by Householder reflections, column by column.
    fn factor(&mut self, compression: &Compression) {
        let (rank, height) = (compression.rank(), self.count);
        for k in 0..rank {
            let column = &mut self.reflections[k * height..][..height];
            for (value, &i) in column.iter_mut().zip(&self.channels) {
                *value = compression.left[(i, k)] * compression.singular[k];
            }
        }
        for k in 0..rank {
            let (before, rest) = self.reflections.split_at_mut(k * height);
            let column = &mut rest[..height];
            let known = k.min(self.rows);
            for (j, reflection) in before.chunks_exact(height.max(1)).enumerate().take(known) {
                reflect(&reflection[j..], self.factors[j], &mut column[j..]);
            }
            for (row, value) in column.iter().enumerate().take(known) {
                self.transposed[row * rank + k] = *value;
            }
            if k < self.rows {
                let (head, factor) = reflection_of(&mut column[k..]);
                self.transposed[k * rank + k] = head;
                self.factors[k] = factor;
            }
        }
    }

    /// Transforms the whitened data `[measurement]` of a frame, in units of `one`, into a target.
    pub(crate) fn take(
        &self,
        compression: &Compression,
        whitened: &[f64],
        one: f64,
        target: &mut Target,
    ) {
        let Target { values, rest, rest_squared } = target;
        if self.is_whole {
            for (i, (rest, value)) in rest.iter_mut().zip(whitened).enumerate() {
                *rest = if self.good[i] { value / one } else { 0.0 };
            }
            values.fill(0.0);
            let values = &mut values[..self.rows];
            vectorised!(project(&compression.left, values, rest));
            *rest_squared = rest.iter().map(|v| v * v).sum();
            return;
        }
        rest.fill(0.0);
        for (turned, &i) in rest.iter_mut().zip(&self.channels) {
            *turned = whitened[i] / one;
        }
        let turned = &mut rest[..self.count];
        for k in 0..self.rows {
            let reflection = &self.reflections[k * self.count..][..self.count];
            reflect(&reflection[k..], self.factors[k], &mut turned[k..]);
        }
        values.fill(0.0);
        values[..self.rows].copy_from_slice(&turned[..self.rows]);
        turned[..self.rows].fill(0.0);
        *rest_squared = turned.iter().map(|v| v * v).sum();
    }

    /// Transforms a data dual `[row of F']` plus `share` times the unexplained part of the data back to
    /// one value per whitened measurement.
    pub(crate) fn spread(
        &self,
        compression: &Compression,
        dual: &[f64],
        target: &Target,
        share: f64,
        out: &mut [f64],
    ) {
        out.fill(0.0);
        if self.is_whole {
            for (k, y) in dual.iter().enumerate().take(self.rows) {
                let column = compression.left.col(k);
                out.iter_mut().zip(column.iter()).for_each(|(o, u)| *o += y * u);
            }
            out.iter_mut().zip(&target.rest).for_each(|(o, r)| *o += share * r);
            return;
        }
        let mut turned: Vec<f64> = target.rest[..self.count].iter().map(|r| share * r).collect();
        turned[..self.rows].copy_from_slice(&dual[..self.rows]);
        for k in (0..self.rows).rev() {
            let reflection = &self.reflections[k * self.count..][..self.count];
            reflect(&reflection[k..], self.factors[k], &mut turned[k..]);
        }
        for (value, &i) in turned.iter().zip(&self.channels) {
            out[i] = *value;
        }
    }
}

/// Applies a reflection: `column -= factor v (v . column)`.
fn reflect(v: &[f64], factor: f64, column: &mut [f64]) {
    let along = factor * dot(v, column);
    column.iter_mut().zip(v).for_each(|(c, v)| *c -= along * v);
}

/// Replaces a column by its Householder vector `v`; returns the first entry of the reflected column
/// and `2 / |v|^2`.
fn reflection_of(column: &mut [f64]) -> (f64, f64) {
    let largest = column.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    if largest == 0.0 {
        return (0.0, 0.0);
    }
    // scale first, because squares of 1e-200 would underflow
    column.iter_mut().for_each(|v| *v /= largest);
    let norm = column.iter().map(|v| v * v).sum::<f64>().sqrt();
    let head = if column[0] > 0.0 { -norm } else { norm };
    column[0] -= head;
    let square: f64 = column.iter().map(|v| v * v).sum();
    (head * largest, 2.0 / square)
}

/// Computes the coordinates of data along orthonormal columns and the remainder.
#[inline(always)]
fn project(left: &Mat<f64>, values: &mut [f64], rest: &mut [f64]) {
    // the second pass removes the rounding errors of the first
    for _ in 0..2 {
        for (k, t) in values.iter_mut().enumerate() {
            let column = left.col_as_slice(k);
            let along = dot(column, rest);
            *t += along;
            for (v, u) in rest.iter_mut().zip(column) {
                *v = (-along).mul_add(*u, *v);
            }
        }
    }
}

#[cfg(test)]
mod tests;
