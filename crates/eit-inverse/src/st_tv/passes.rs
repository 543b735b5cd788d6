//! Passes over all unknowns that evaluate an iterate, in `f64`, along the frames.

use super::kernel::{LANES, PANEL, add_row, add_scaled, analyse, lanes, row, synthesise};
use super::operators::{BLOCK, Operators};
use super::sweep::differences;
use pulp::{Simd, WithSimd};

/// Computes `V' x`.
pub(super) struct Analyse<'a> {
    pub(super) ops: &'a Operators<f64>,
    pub(super) x: &'a [f64],
    pub(super) stride: usize,
    pub(super) coefficients: &'a mut [f64],
}

impl WithSimd for Analyse<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { ops, x, stride, coefficients } = self;
        coefficients.fill(0.0);
        let rank = ops.padded_rank;
        let blocks = ops.basis.chunks_exact(BLOCK / PANEL * rank);
        for (basis, block) in blocks.zip(x.chunks_exact(BLOCK * stride)) {
            analyse(simd, basis, rank, 0..rank, block, stride, coefficients);
        }
    }
}

/// Computes `lambda_space sum |D x|_2 + lambda_time sum |D_t x|`.
pub(super) struct Variation<'a> {
    pub(super) ops: &'a Operators<f64>,
    pub(super) x: &'a [f64],
    pub(super) stride: usize,
    pub(super) linked: &'a [bool],
    pub(super) lambda_space: f64,
    pub(super) lambda_time: f64,
}

impl WithSimd for Variation<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let Self { ops, x, stride, linked, .. } = self;
        let mut space = [0.0; LANES];
        for (group, radius) in ops.groups.iter().zip(&ops.radius) {
            let [first, second, third] =
                group.unknowns.map(|p| row(x, p as usize * stride, stride));
            for ((first, second), third) in first.iter().zip(second).zip(third) {
                let [a, b] = differences(group, [first, second, third]);
                // padding frames are constant and contribute nothing
                let norm: [f64; LANES] = lanes(|l| a[l].mul_add(a[l], b[l] * b[l]).sqrt());
                space = add_row(*radius, &norm, space);
            }
        }
        let mut time = 0.0;
        if linked.contains(&true) {
            for (p, row) in x.chunks_exact(stride).take(ops.unknowns).enumerate() {
                let changes = row.windows(2).zip(linked).filter(|(_, linked)| **linked);
                let change: f64 = changes.map(|(w, _)| (w[1] - w[0]).abs()).sum();
                time += ops.time_radius[p] * change;
            }
        }
        self.lambda_space * space.iter().sum::<f64>() + self.lambda_time * time
    }
}

/// Computes `A' y + D' q + D_t' q_t + p` from the coefficients of `A' y`.
pub(super) struct Error<'a> {
    pub(super) ops: &'a Operators<f64>,
    pub(super) stride: usize,
    pub(super) coefficients: &'a [f64],
    pub(super) dual: &'a [f64],
    pub(super) time_dual: &'a [f64],
    pub(super) bound_dual: &'a [f64],
    pub(super) error: &'a mut [f64],
}

impl WithSimd for Error<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { ops, stride, error, .. } = self;
        error.fill(0.0);
        let rank = ops.padded_rank;
        synthesise(simd, &ops.basis, rank, 0..rank, self.coefficients, stride, error);
        for (p, row) in error.chunks_exact_mut(stride).take(ops.unknowns).enumerate() {
            for (r, value) in ops.divergence.row(p) {
                add_scaled(value, &self.dual[r * stride..][..stride], row);
            }
            if !self.time_dual.is_empty() {
                let q = &self.time_dual[p * stride..][..stride];
                let mut before = 0.0;
                for (e, q) in row.iter_mut().zip(q) {
                    *e += before - q;
                    before = *q;
                }
            }
            if !self.bound_dual.is_empty() {
                add_scaled(1.0, &self.bound_dual[p * stride..][..stride], row);
            }
        }
    }
}

/// Computes `q -= D z`.
pub(super) struct Subtract<'a> {
    pub(super) ops: &'a Operators<f64>,
    pub(super) stride: usize,
    pub(super) potential: &'a [f64],
    pub(super) dual: &'a mut [f64],
}

impl WithSimd for Subtract<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { ops, stride, potential, dual } = self;
        for (r, row) in dual.chunks_exact_mut(stride).enumerate() {
            for (p, value) in ops.gradient.row(r) {
                add_scaled(-value, &potential[p * stride..][..stride], row);
            }
        }
    }
}

/// Computes the largest ratio of a dual to its radius; infinite if a dual with radius zero is non-zero.
pub(super) struct Excess<'a> {
    pub(super) ops: &'a Operators<f64>,
    pub(super) stride: usize,
    pub(super) frames: usize,
    pub(super) dual: &'a [f64],
    pub(super) time_dual: &'a [f64],
    pub(super) lambda_space: f64,
    pub(super) lambda_time: f64,
}

impl WithSimd for Excess<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let Self { ops, stride, frames, .. } = self;
        let components = ops.components;
        let mut worst = 0.0_f64;
        for (group, rows) in self.dual.chunks_exact(components * stride).enumerate() {
            let mut square = 0.0_f64;
            for t in 0..frames {
                let sum: f64 = (0..components).map(|c| rows[c * stride + t].powi(2)).sum();
                square = square.max(sum);
            }
            worst = worst.max(square.sqrt() / (self.lambda_space * ops.radius[group]));
        }
        for (p, row) in self.time_dual.chunks_exact(stride).take(ops.unknowns).enumerate() {
            let largest = row[..frames].iter().fold(0.0_f64, |m, q| m.max(q.abs()));
            if largest > 0.0 {
                worst = worst.max(largest / (self.lambda_time * ops.time_radius[p]));
            }
        }
        worst
    }
}
