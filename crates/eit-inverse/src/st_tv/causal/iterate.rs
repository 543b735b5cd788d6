//! Primal-dual iteration on the change `d` of one frame.
//!
//! ```text
//! w   = d - T (D' q + r + tail)
//! d^  = w - T V F y,          y from the data step in the metric T, exactly
//! q^  = project((q + Sigma D (x^ + 2 d^ - d)) / (1 + Sigma gamma / radius))
//! r^  = u - clip(u - clip(u / (1 + Sigma gamma / radius), radius), Sigma room),   u = r + Sigma (2 d^ - d)
//! (d, q, r) += rho ((d^, q^, r^) - (d, q, r))
//! ```
//!
//! `r` is the joint dual of `radius |d|` and of the bounds. Both are functions of a single value, so the
//! proximal map of their sum is that of the first, clipped to the second, and bounds need neither
//! another variable nor a smaller step.
//!
//! Cost of an iteration with `n` cells and a head of `h` ranks: `4 n h` flops in the two products with
//! the basis and about `50 n` elsewhere. The basis is read twice (`4 n h` bytes as 16-bit entries, `8 n h`
//! in `f32`), the arrays once (about `80 n` bytes). At 64 x 64 and `h = 64` that is 1.0 Mflop and 1.1 MB,
//! which stays in an L2 cache of 1 MB; this is the reason for the short entries. The minimum time at the
//! machine's peaks is the larger of 4 us at 235 GFLOP/s and 7 us at 150 GB/s. For measured times see the
//! table of streams in docs/PERFORMANCE.md; the time above the minimum is a square root and a division
//! for each group, the conversion of entries, and the evaluations of a frame.

use super::differences::Differences;
use super::fields::{Fields, Setting};
use super::lanes::{
    BLOCKS, LANES, Lane, Project, clip, each, expand, load, shrink, splat, store, total,
};
use crate::st_tv::ball;
use crate::st_tv::float::Float;
pub(crate) use crate::st_tv::kernel::dot;
use pulp::{Simd, WithSimd};

/// Over-relaxation factor.
const RHO: f64 = 1.8;

/// Exact data step, from `c = V' w` to the force `F y`.
pub(crate) enum DataStep<'a, T> {
    /// Head of the singular coordinates: `y = M (S c - beta)`, `M` `[column][row]` of a padded head.
    Head { singular: &'a [T], inverse: &'a [T], beta: &'a [T], head: usize },
    /// `F M (F' c - beta)` with `F'` `[k][rank]` and `F M` `[rank][k]`.
    Dense { transposed: &'a [f64], back: &'a [f64], beta: &'a [f64] },
    /// The ball `|F' c - beta| <= radius`, in the eigenvectors of `F' G F`: transformed `F'` and `F`,
    /// eigenvalues, squared radius.
    Ball { transposed: &'a [f64], back: &'a [f64], beta: &'a [f64], values: &'a [f64], square: f64 },
}

/// Memory for the dense data steps, `[rank]` or longer.
pub(crate) struct Columns<'a> {
    pub(crate) first: &'a mut [f64],
    pub(crate) second: &'a mut [f64],
    /// Multiplier of the ball in the last iteration.
    pub(crate) multiplier: &'a mut f64,
}

/// Iterations of one frame.
pub(crate) struct Iterate<'a, T: Project, D> {
    pub(crate) setting: &'a Setting<T>,
    pub(crate) differences: &'a D,
    pub(crate) fields: &'a mut Fields<T>,
    pub(crate) data: DataStep<'a, T>,
    pub(crate) columns: Columns<'a>,
    pub(crate) lambda_space: T,
    pub(crate) lambda_time: T,
    pub(crate) bounded: bool,
    /// Whether to use short entries of the basis. Their error is small, and objective and bound use
    /// full-precision entries.
    pub(crate) is_short: bool,
    pub(crate) count: usize,
}

impl<T: Project, D: Differences<T>> WithSimd for Iterate<'_, T, D> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let ranks = match &self.data {
            DataStep::Head { head, .. } => *head,
            _ => self.setting.rank,
        };
        for _ in 0..self.count {
            self.descend(simd, ranks);
            self.fit(ranks);
            if self.bounded {
                self.ascend::<true>(ranks);
            } else {
                self.ascend::<false>(ranks);
            }
            self.flow_step();
        }
    }
}

impl<T: Project, D: Differences<T>> Iterate<'_, T, D> {
    /// Computes `w` and `V' w`.
    #[inline(always)]
    fn descend<S: Simd>(&mut self, simd: S, ranks: usize) {
        let Self { setting, differences, fields, is_short, .. } = self;
        let Fields { change, work, flow, force, tail, tau, sums, .. } = &mut **fields;
        let sums = &mut sums[..ranks];
        sums.fill([T::default(); LANES]);
        for (panel, blocks) in setting.places.blocks.chunks_exact(BLOCKS).enumerate() {
            let mut w = [[T::default(); LANES]; BLOCKS];
            for (j, (w, &at)) in w.iter_mut().zip(blocks).enumerate() {
                let divergence = differences.adjoint(flow, BLOCKS * panel + j, at);
                let (d, tau) = (load(change, at), load(tau, at));
                let (r, tail) = (load(force, at), load(tail, at));
                *w = each(|l| d[l] - tau[l] * (divergence[l] + (r[l] + tail[l])));
                store(work, at, *w);
            }
            let own = panel * setting.padded..panel * setting.padded + ranks;
            if T::HAS_SHORT && *is_short {
                T::project(simd, &setting.short[own], &w, sums);
            } else {
                T::project(simd, &setting.panels[own], &w, sums);
            }
        }
    }

    /// Computes the force of the data.
    #[inline(always)]
    fn fit(&mut self, ranks: usize) {
        let Fields { sums, coefficients, force_coefficients, scratch, .. } = &mut *self.fields;
        for (c, sum) in coefficients.iter_mut().zip(sums.iter()).take(ranks) {
            *c = total(sum);
        }
        if T::HAS_SHORT && self.is_short {
            for (c, unit) in coefficients.iter_mut().zip(&self.setting.short_units).take(ranks) {
                *c = *c * *unit;
            }
        }
        let Columns { first, second, multiplier } = &mut self.columns;
        match &self.data {
            DataStep::Head { singular, inverse, beta, head } => {
                for k in 0..*head {
                    scratch[k] = singular[k].mul_add(coefficients[k], T::default() - beta[k]);
                }
                multiply_head(inverse, &scratch[..*head], force_coefficients);
                for k in 0..*head {
                    force_coefficients[k] = force_coefficients[k] * singular[k];
                }
            }
            DataStep::Dense { transposed, back, beta } => {
                let rank = ranks;
                let own = &mut first[..rank];
                own.iter_mut().zip(coefficients.iter()).for_each(|(o, c)| *o = c.to_f64());
                rows_times(transposed, own, &mut second[..beta.len()]);
                second.iter_mut().zip(beta.iter()).for_each(|(u, b)| *u -= b);
                rows_times(back, &second[..beta.len()], own);
                force_coefficients.iter_mut().zip(own).for_each(|(z, o)| *z = T::from_f64(*o));
            }
            DataStep::Ball { transposed, back, beta, values, square } => {
                let rank = ranks;
                let own = &mut first[..rank];
                own.iter_mut().zip(coefficients.iter()).for_each(|(o, c)| *o = c.to_f64());
                let turned = &mut second[..beta.len()];
                rows_times(transposed, own, turned);
                turned.iter_mut().zip(beta.iter()).for_each(|(u, b)| *u -= b);
                let terms = || turned.iter().copied().zip(values.iter().copied());
                let mu = ball::multiplier(terms, *square);
                **multiplier = mu;
                for (u, value) in turned.iter_mut().zip(values.iter()) {
                    *u = ball::dual(*u, *value, mu);
                }
                rows_times(back, turned, own);
                force_coefficients.iter_mut().zip(own).for_each(|(z, o)| *z = T::from_f64(*o));
            }
        }
    }

    /// Computes `d^`, then updates `d` and `r`.
    #[inline(always)]
    fn ascend<const BOUNDED: bool>(&mut self, ranks: usize) {
        let Self { setting, differences, fields, lambda_time, is_short, .. } = self;
        let Fields {
            change,
            fresh,
            anchor,
            work,
            bar,
            force,
            room,
            tau,
            cell_step,
            cell_damp,
            force_coefficients,
            scratch,
            ..
        } = &mut **fields;
        let rho = T::from_f64(RHO);
        let units = scratch.iter_mut().zip(force_coefficients.iter().zip(&setting.short_units));
        units.take(ranks).for_each(|(out, (z, unit))| *out = *z * *unit);
        for (panel, blocks) in setting.places.blocks.chunks_exact(BLOCKS).enumerate() {
            let own = panel * setting.padded..panel * setting.padded + ranks;
            let pull = if T::HAS_SHORT && *is_short {
                expand(&setting.short[own], &scratch[..ranks])
            } else {
                expand(&setting.panels[own], &force_coefficients[..ranks])
            };
            for (pull, &at) in pull.iter().zip(blocks) {
                let (d, w, tau) = (load(change, at), load(work, at), load(tau, at));
                let (x, r) = (load(anchor, at), load(force, at));
                let (step, damp) = (load(cell_step, at), load(cell_damp, at));
                let radius = differences.cell_radius(at);
                let new = each(|l| w[l] - tau[l] * pull[l]);
                let ahead = each(|l| new[l] + (new[l] - d[l]));
                store(fresh, at, new);
                store(bar, at, each(|l| x[l] + ahead[l]));
                store(change, at, each(|l| rho.mul_add(new[l] - d[l], d[l])));
                let up = each(|l| step[l].mul_add(ahead[l], r[l]));
                let mut dual = each(|l| clip(up[l] * damp[l], *lambda_time * radius[l]));
                if BOUNDED {
                    let (below, above) = (load(&room[0], at), load(&room[1], at));
                    dual = each(|l| {
                        let soft = up[l] - dual[l];
                        up[l] - soft.min(step[l] * above[l]).max(step[l] * below[l])
                    });
                }
                store(force, at, each(|l| rho.mul_add(dual[l] - r[l], r[l])));
            }
        }
    }

    /// Updates `q`.
    #[inline(always)]
    fn flow_step(&mut self) {
        let Self { differences, fields, lambda_space, .. } = self;
        let Fields { bar, flow, group_step, group_damp, .. } = &mut **fields;
        let rho = T::from_f64(RHO);
        let [first, second] = flow;
        for &at in differences.group_blocks() {
            let [da, db] = differences.difference(bar, at);
            let (step, damp) = (load(group_step, at), load(group_damp, at));
            let (a, b) = (load(first, at), load(second, at));
            let up_a = each(|l| step[l].mul_add(da[l], a[l]) * damp[l]);
            let up_b = each(|l| step[l].mul_add(db[l], b[l]) * damp[l]);
            let radius = differences.group_radius(at);
            let factor = shrink(up_a, up_b, each(|l| *lambda_space * radius[l]));
            store(first, at, each(|l| rho.mul_add(up_a[l] * factor[l] - a[l], a[l])));
            store(second, at, each(|l| rho.mul_add(up_b[l] * factor[l] - b[l], b[l])));
        }
    }
}

/// Computes `out = M x` for `M` `[column][row]` of a head that is a multiple of [`LANES`].
#[inline(always)]
fn multiply_head<T: Float>(matrix: &[T], x: &[T], out: &mut [T]) {
    let head = x.len();
    for at in (0..head).step_by(LANES) {
        let mut sum = splat(T::default());
        for (column, x) in matrix.chunks_exact(head).zip(x) {
            let m = load(column, at);
            sum = add(*x, m, sum);
        }
        store(out, at, sum);
    }
}

#[inline(always)]
fn add<T: Float>(factor: T, lane: Lane<T>, sum: Lane<T>) -> Lane<T> {
    each(|l| factor.mul_add(lane[l], sum[l]))
}

/// Computes `out = matrix x`, by rows, with eight partial sums that the compiler keeps in registers.
#[inline(always)]
pub(crate) fn rows_times(matrix: &[f64], x: &[f64], out: &mut [f64]) {
    for (row, out) in matrix.chunks_exact(x.len()).zip(out) {
        *out = dot(row, x);
    }
}

/// Dispatches [`rows_times`] for the widest SIMD registers.
pub(crate) struct RowsTimes<'a> {
    pub(crate) matrix: &'a [f64],
    pub(crate) x: &'a [f64],
    pub(crate) out: &'a mut [f64],
}

impl WithSimd for RowsTimes<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        rows_times(self.matrix, self.x, self.out);
    }
}
