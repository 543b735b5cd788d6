//! Inner loops of the step map.

use super::super::differences::Differences;
use super::super::fields::{Fields, Setting};
use super::super::lanes::{LANES, Lane, Project, each, largest, load, splat, store};
use super::{FLOOR, STEP, Weights};
pub(super) use crate::st_tv::dense::{Congruent, Invert};
use crate::st_tv::kernel::{CHUNK, TILE};
use pulp::{Simd, WithSimd};

/// Computes the largest differences of an image, dilated by two groups.
pub(super) struct Dilate<'a, T: Project, D> {
    pub(super) setting: &'a Setting<T>,
    pub(super) differences: &'a D,
    pub(super) image: &'a [T],
    pub(super) scale: &'a mut [T],
    pub(super) spread: &'a mut [T],
    pub(super) groups: &'a mut [T],
}

impl<T: Project, D: Differences<T>> WithSimd for Dilate<'_, T, D> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { setting, differences, image, scale, spread, groups } = self;
        for &at in differences.group_blocks() {
            let [a, b] = differences.difference(image, at);
            store(groups, at, each(|l| a[l].abs().max(b[l].abs())));
        }
        for round in 0..3 {
            for (block, &at) in setting.places.blocks.iter().enumerate() {
                store(spread, at, differences.cell_largest(groups, block, at));
            }
            if round < 2 {
                for &at in differences.group_blocks() {
                    store(groups, at, differences.group_largest(spread, at));
                }
            }
        }
        for &at in &setting.places.blocks {
            let (old, new) = (load(scale, at), load(spread, at));
            store(scale, at, each(|l| old[l].max(new[l])));
        }
    }
}

/// Computes the step sizes; returns the largest `tau`.
pub(super) struct Sizes<'a, T: Project, D> {
    pub(super) setting: &'a Setting<T>,
    pub(super) differences: &'a D,
    pub(super) fields: &'a mut Fields<T>,
    pub(super) scale: &'a [T],
    pub(super) weights: Weights,
}

impl<T: Project, D: Differences<T>> WithSimd for Sizes<'_, T, D> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let Self { setting, differences, fields, scale, weights } = self;
        let Weights { lambda_space, lambda_time, image, gamma, step } = weights;
        let Fields { tau, group_step, group_damp, cell_step, cell_damp, .. } = fields;
        let (zero, one) = (T::default(), T::from_f64(1.0));
        let floor = T::from_f64(FLOOR * image);
        let factor = T::from_f64(step * STEP * image / (lambda_space * setting.mean_radius));
        let per_image = T::from_f64(1.0 / image);
        let norm = T::from_f64(setting.norm_squared);
        let least = factor * (floor * per_image).sqrt();
        let mut most: Lane<T> = splat(zero);
        for &at in &setting.places.blocks {
            let (g, inside) = (load(scale, at), load(&setting.inside, at));
            let radius = differences.cell_radius(at);
            let own = each(|l| inside[l] * factor * (g[l].max(floor) * per_image).sqrt());
            let step = each(|l| inside[l] / (norm * own[l].max(least)));
            let soft = T::from_f64(gamma / lambda_time);
            store(tau, at, own);
            store(cell_step, at, step);
            store(cell_damp, at, each(|l| inside[l] / (one + step[l] * soft / radius[l])));
            most = each(|l| most[l].max(own[l]));
        }
        for &at in differences.group_blocks() {
            let own = differences.group_largest(tau, at);
            let radius = differences.group_radius(at);
            let step = each(|l| one / (norm * own[l].max(least)));
            let soft = T::from_f64(gamma / lambda_space);
            store(group_step, at, step);
            store(group_damp, at, each(|l| one / (one + step[l] * soft / radius[l])));
        }
        largest(&most).to_f64()
    }
}

/// Computes the upper triangle of `V' T V` of the first `ranks`, a multiple of [`LANES`], in tiles.
pub(super) struct Gram<'a, T: Project> {
    pub(super) setting: &'a Setting<T>,
    pub(super) tau: &'a [T],
    pub(super) ranks: usize,
    /// `[padded rank][padded rank]`.
    pub(super) out: &'a mut [T],
}

impl<T: Project> WithSimd for Gram<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { setting, tau, ranks, out } = self;
        let padded = setting.padded;
        out.fill(T::default());
        let cells = setting.places.cells.chunks(CHUNK);
        for (rows, cells) in setting.rows.chunks(CHUNK * padded).zip(cells) {
            for first in (0..ranks).step_by(TILE) {
                for second in (first / LANES * LANES..ranks).step_by(LANES) {
                    let mut sums = [[T::default(); LANES]; TILE];
                    for (row, &cell) in rows.chunks_exact(padded).zip(cells) {
                        let right = load(row, second);
                        let weight = tau[cell];
                        for (i, sum) in sums.iter_mut().enumerate() {
                            let left = weight * row[first + i];
                            for l in 0..LANES {
                                sum[l] = left.mul_add(right[l], sum[l]);
                            }
                        }
                    }
                    for (i, sum) in sums.iter().enumerate() {
                        let at = (first + i) * padded + second;
                        let old = load(out, at);
                        store(out, at, each(|l| old[l] + sum[l]));
                    }
                }
            }
        }
    }
}
