//! Flow search for the lower bound of a frame: with the force `f = A' y` of the data fixed, find `q` in
//! its balls such that `f + D' q` exceeds the limits of the dual of the change as little as possible.
//!
//! Accelerated gradient steps (Beck, Teboulle, *SIAM J. Imaging Sci.* 2 (2009) 183) on the smoothed
//! dual of the frame over `q` alone. Smoothed about the current image `x` with a weight `mu`, the
//! gradient is `-mu D x+`,
//!
//! ```text
//! mu d+ = clip(soft(mu d - e, radius), mu room),   e = f + D' q,   x+ = x^ + d+
//! ```
//!
//! in the first steps, which improve the bound. The later steps omit the shift by `x` and make `e`
//! feasible; with bounds, `e` may exceed its radius, by `mu` times the distance of the current image
//! (instead of the anchor) from the bound. No product with the basis is needed.

use super::differences::Differences;
use super::fields::Setting;
use super::lanes::{LANES, Lane, Project, each, largest, load, shrink, store};
use pulp::{Simd, WithSimd};

/// Arrays of the flow search.
#[derive(Debug, Clone)]
pub(crate) struct FlowFields<T> {
    /// `f`.
    pub(crate) force: Vec<T>,
    /// `f + D' q`.
    pub(crate) error: Vec<T>,
    pub(crate) flow: [Vec<T>; 2],
    /// Extrapolated.
    ahead: [Vec<T>; 2],
    /// `x - x^` of the image whose objective is to be bounded.
    pub(crate) change: Vec<T>,
}

impl<T: Project> FlowFields<T> {
    pub(crate) fn new(setting: &Setting<T>) -> Self {
        let cells = vec![T::default(); setting.places.length];
        let groups = vec![T::default(); setting.basis.group_length(&setting.places)];
        let pair = [groups.clone(), groups];
        Self {
            force: cells.clone(),
            error: cells.clone(),
            flow: pair.clone(),
            ahead: pair,
            change: cells,
        }
    }
}

/// Settings of the flow search.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FlowSteps {
    pub(crate) steps: usize,
    /// Number of shifted steps, which come first.
    pub(crate) shifted: usize,
    /// Weights, slightly enlarged for the search.
    pub(crate) lambda_space: f64,
    pub(crate) lambda_time: f64,
    pub(crate) mu: f64,
    pub(crate) bounded: bool,
}

/// Flow search from `start`; sets `flow` and `error`. Returns the largest ratio of a group's dual to its
/// radius times `lambda_space`.
pub(crate) struct Seek<'a, T: Project, D> {
    pub(crate) setting: &'a Setting<T>,
    pub(crate) differences: &'a D,
    pub(crate) fields: &'a mut FlowFields<T>,
    pub(crate) start: &'a [Vec<T>; 2],
    pub(crate) anchor: &'a [T],
    pub(crate) room: &'a [Vec<T>; 2],
    pub(crate) how: FlowSteps,
}

impl<T: Project, D: Differences<T>> WithSimd for Seek<'_, T, D> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _: S) -> f64 {
        self.begin();
        let mut t = 1.0_f64;
        for step in 0..self.how.steps {
            let shift = if step < self.how.shifted { self.how.mu } else { 0.0 };
            if self.how.bounded {
                self.pull::<true>(T::from_f64(shift));
            } else {
                self.pull::<false>(T::from_f64(shift));
            }
            let next = 0.5 * (1.0 + (1.0 + 4.0 * t * t).sqrt());
            self.push(T::from_f64((t - 1.0) / next));
            t = next;
        }
        self.end()
    }
}

impl<T: Project, D: Differences<T>> Seek<'_, T, D> {
    /// Projects the start onto the balls.
    #[inline(always)]
    fn begin(&mut self) {
        let space = T::from_f64(self.how.lambda_space);
        let FlowFields { flow, ahead, .. } = &mut *self.fields;
        for &at in self.differences.group_blocks() {
            let (a, b) = (load(&self.start[0], at), load(&self.start[1], at));
            let radius = self.differences.group_radius(at);
            let factor = shrink(a, b, each(|l| space * radius[l]));
            let (a, b) = (each(|l| a[l] * factor[l]), each(|l| b[l] * factor[l]));
            store(&mut flow[0], at, a);
            store(&mut flow[1], at, b);
            store(&mut ahead[0], at, a);
            store(&mut ahead[1], at, b);
        }
    }

    /// Computes `-mu x+` of the cells, in `error`.
    #[inline(always)]
    fn pull<const BOUNDED: bool>(&mut self, shift: T) {
        let Self { setting, differences, fields, how, .. } = self;
        let FlowFields { force, error, ahead, change, .. } = &mut **fields;
        let time = T::from_f64(how.lambda_time);
        let mu = T::from_f64(how.mu);
        for (block, &at) in setting.places.blocks.iter().enumerate() {
            let divergence = differences.adjoint(ahead, block, at);
            let (f, d, x) = (load(force, at), load(change, at), load(self.anchor, at));
            let radius = differences.cell_radius(at);
            let mut soft: Lane<T> = each(|l| {
                let value = f[l] + divergence[l] - shift * d[l];
                let limit = time * radius[l];
                value - value.min(limit).max(T::default() - limit)
            });
            if BOUNDED {
                let (below, above) = (load(&self.room[0], at), load(&self.room[1], at));
                // distances to the bounds from the anchor while shifted, then from the current image,
                // since the cost of a bound's force is proportional to the distance from the bound
                let from = if shift > T::default() { [T::default(); LANES] } else { d };
                soft = each(|l| {
                    let (most, least) = (mu * (from[l] - below[l]), mu * (from[l] - above[l]));
                    soft[l].min(most).max(least)
                });
            }
            store(error, at, each(|l| soft[l] - shift * x[l]));
        }
    }

    /// Performs one step of the flow.
    #[inline(always)]
    fn push(&mut self, momentum: T) {
        let Self { setting, differences, fields, how, .. } = self;
        let FlowFields { error, flow, ahead, .. } = &mut **fields;
        let space = T::from_f64(how.lambda_space);
        let step = T::from_f64(-1.0 / (setting.norm_squared - 1.0).max(1.0));
        let ([first, second], [next_first, next_second]) = (flow, ahead);
        for &at in differences.group_blocks() {
            let [da, db] = differences.difference(error, at);
            let (a, b) = (load(next_first, at), load(next_second, at));
            let up_a = each(|l| step.mul_add(da[l], a[l]));
            let up_b = each(|l| step.mul_add(db[l], b[l]));
            let radius = differences.group_radius(at);
            let factor = shrink(up_a, up_b, each(|l| space * radius[l]));
            let (a, b) = (each(|l| up_a[l] * factor[l]), each(|l| up_b[l] * factor[l]));
            let (old_a, old_b) = (load(first, at), load(second, at));
            store(next_first, at, each(|l| momentum.mul_add(a[l] - old_a[l], a[l])));
            store(next_second, at, each(|l| momentum.mul_add(b[l] - old_b[l], b[l])));
            store(first, at, a);
            store(second, at, b);
        }
    }

    /// Computes the remaining error; returns the largest ratio of a dual to its radius.
    #[inline(always)]
    fn end(&mut self) -> f64 {
        let Self { setting, differences, fields, how, .. } = self;
        let FlowFields { force, error, flow, .. } = &mut **fields;
        for (block, &at) in setting.places.blocks.iter().enumerate() {
            let divergence = differences.adjoint(flow, block, at);
            let f = load(force, at);
            store(error, at, each(|l| f[l] + divergence[l]));
        }
        let space = T::from_f64(how.lambda_space);
        let mut most = [T::default(); LANES];
        for &at in differences.group_blocks() {
            let (a, b) = (load(&flow[0], at), load(&flow[1], at));
            let radius = differences.group_radius(at);
            let ratio = each(|l| {
                let norm = a[l].mul_add(a[l], b[l] * b[l]).sqrt();
                norm / (space * radius[l])
            });
            most = each(|l| most[l].max(ratio[l]));
        }
        largest(&most).to_f64()
    }
}

/// Computes `out = V z` on all cells, over a range of ranks.
pub(crate) struct Expand<'a, T: Project> {
    pub(crate) setting: &'a Setting<T>,
    pub(crate) ranks: std::ops::Range<usize>,
    /// `[padded rank]`.
    pub(crate) z: &'a [T],
    pub(crate) out: &'a mut [T],
}

impl<T: Project> WithSimd for Expand<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { setting, ranks, z, out } = self;
        for (panel, blocks) in setting.places.blocks.chunks_exact(super::lanes::BLOCKS).enumerate()
        {
            let sums = super::lanes::expand(setting.panel(panel, ranks.clone()), &z[ranks.clone()]);
            for (sum, &at) in sums.into_iter().zip(blocks) {
                store(out, at, sum);
            }
        }
    }
}
