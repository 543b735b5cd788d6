//! Passes over all unknowns of a repair, and the system that balances the parts.

use super::super::differences::Differences;
use super::super::lanes::{Lane, each, largest, load, splat, store};
use super::super::operators::Operators;
use super::super::problem::Problem;
use pulp::{Simd, WithSimd};

/// Duals of a problem without an anchor, as in [`crate::st_tv::state`].
#[derive(Debug, Clone)]
pub(crate) struct Duals {
    pub(crate) flow: [Vec<f64>; 2],
    pub(super) links: Vec<f64>,
    /// `p`; empty without bounds.
    pub(super) held: Vec<f64>,
    /// `e`, then the potential `z`.
    pub(super) error: Vec<f64>,
}

/// Adds the forces of all duals but `y` to the error.
pub(super) struct Add<'a, D> {
    pub(super) ops: &'a Operators<f64>,
    pub(super) differences: &'a D,
    pub(super) duals: &'a mut Duals,
}

impl<D: Differences<f64>> WithSimd for Add<'_, D> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { ops, differences, duals } = self;
        let Duals { flow, links, held, error, .. } = duals;
        let (cells, groups) = (ops.cells(), ops.groups);
        for frame in 0..error.len() / cells {
            let own = frame * groups..(frame + 1) * groups;
            let q = [&flow[0][own.clone()], &flow[1][own]];
            for (block, &at) in ops.places.blocks.iter().enumerate() {
                let here = frame * cells + at;
                let (divergence, mut e) = (differences.adjoint(q, block, at), load(error, here));
                if !links.is_empty() {
                    let (own, next) = (load(links, here), load(links, here + cells));
                    e = each(|l| e[l] + (own[l] - next[l]));
                }
                if !held.is_empty() {
                    let p = load(held, here);
                    e = each(|l| e[l] + p[l]);
                }
                store(error, here, each(|l| e[l] + divergence[l]));
            }
        }
    }
}

/// Computes `q -= D z` with `z` in the place of the error.
pub(super) struct Subtract<'a, D> {
    pub(super) ops: &'a Operators<f64>,
    pub(super) differences: &'a D,
    pub(super) duals: &'a mut Duals,
}

impl<D: Differences<f64>> WithSimd for Subtract<'_, D> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { ops, differences, duals } = self;
        let [first, second] = &mut duals.flow;
        for (frame, z) in duals.error.chunks_exact(ops.cells()).enumerate() {
            for &at in differences.group_blocks() {
                let ([a, b], here) = (differences.difference(z, at), frame * ops.groups + at);
                let (qa, qb) = (load(first, here), load(second, here));
                store(first, here, each(|l| qa[l] - a[l]));
                store(second, here, each(|l| qb[l] - b[l]));
            }
        }
    }
}

/// Computes the largest ratio of a dual to its radius; infinite if a dual with radius zero is non-zero.
pub(super) struct Excess<'a, D> {
    pub(super) problem: &'a Problem<'a>,
    pub(super) differences: &'a D,
    pub(super) duals: &'a Duals,
}

impl<D: Differences<f64>> WithSimd for Excess<'_, D> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let Self { problem, differences, duals } = self;
        let ops = &problem.skin.operators;
        let Problem { lambda_space, lambda_time, .. } = *problem;
        let mut most: Lane<f64> = splat(0.0);
        for frame in 0..problem.frames() {
            for &at in differences.group_blocks() {
                let here = frame * ops.groups + at;
                let (a, b) = (load(&duals.flow[0], here), load(&duals.flow[1], here));
                let radius = differences.group_radius(at);
                most = each(|l| {
                    let norm = a[l].mul_add(a[l], b[l] * b[l]).sqrt();
                    let ratio = norm / (lambda_space * radius[l]);
                    if norm > 0.0 && ratio > most[l] { ratio } else { most[l] }
                });
            }
        }
        if !duals.links.is_empty() {
            for frame in 1..problem.frames() {
                for &at in &ops.places.blocks {
                    let q = load(&duals.links, frame * ops.cells() + at);
                    let radius = differences.cell_radius(at);
                    most = each(|l| {
                        let ratio = q[l].abs() / (lambda_time * radius[l]);
                        if q[l] != 0.0 && ratio > most[l] { ratio } else { most[l] }
                    });
                }
            }
        }
        largest(&most)
    }
}

/// Solves a semidefinite system `[n][n + 1]` with the right-hand side in the last column, which is
/// replaced by the solution. Uses elimination with diagonal pivots; the solution is zero in null
/// directions.
pub(super) fn solve_semidefinite(rows: &mut [f64], n: usize) {
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
