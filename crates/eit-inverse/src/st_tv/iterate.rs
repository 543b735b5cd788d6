//! The iteration: a primal-dual method (Chambolle, Pock, *J. Math. Imaging Vis.* 40 (2011) 120) on the change `d` of
//! the images from their origin, whose primal step solves the data term exactly, over-relaxed.
//!
//! ```text
//! w   = d - T (D' q + D_t' q_t + p + tail)
//! d^  = argmin data(origin + d) + |d - w|^2_{T^-1} / 2 = w - T V F y,      see [`super::fit`]
//! x-  = origin + 2 d^ - d
//! q^  = project((q + Sigma D x-) / (1 + Sigma gamma / radius))             radius = lambda_space size_g
//! q_t^ = project((q_t + Sigma D_t x-) / (1 + Sigma gamma / radius))        radius = lambda_time area
//! p^  = u - clip(soft(u, radius), Sigma room),   u = p + Sigma (2 d^ - d)  radius = lambda_anchor area
//! (d, q, q_t, p) += rho ((d^, q^, q_t^, p^) - (d, q, q_t, p))
//! ```
//!
//! with the steps `T` and `Sigma` of a map (see [`super::step`]). `gamma` smooths the norms slightly (Huber), so that
//! the duals of flat regions converge; its effect is far below the requested gap. `p` is the joint dual of anchor and
//! bounds: both are functions of a single value, so that the proximal map of their sum is that of the first, clipped
//! to the second. Where frames are strongly linked, `q_t` and `p` take an exact step together (see [`super::chain`]).
//!
//! # Head and tail
//! The singular values of an electrode array decrease by a factor of a million from first to last. Where `T s^2` is
//! small, an explicit step works as well as the exact one. These directions, the tail, enter as a constant force
//! `V (s y)`, which is updated at every evaluation, and the products run over the head only. The fixed point is the
//! same.
//!
//! # Order
//! The end of an iteration of four frames, and the start of the next one of the four before them, whose forces are then
//! complete, follow each other while their arrays (0.6 MB at 64 x 64) are in the L2 cache.
//!
//! # Cost
//! An iteration of one frame with `n` cells and a head of `h` ranks takes `4 n h` flops in the two products with the
//! basis and about `50 n` elsewhere. The basis is read twice for four frames (`4 n h` bytes as 16-bit entries, `8 n h`
//! in `f32`), the arrays of a frame once (about `80 n` bytes). At 64 x 64 and `h = 64` one frame is 1.0 Mflop and
//! 1.1 MB, which stays in an L2 cache of 1 MB; this is the reason for the short entries. The minimum time at the
//! machine's peaks is the larger of 4 us at 235 GFLOP/s and 7 us at 150 GB/s. For measured times see
//! docs/PERFORMANCE.md; the time above the minimum is a square root and a division for each group, the conversion of
//! entries, and the evaluations.

use super::chain::Chain;
use super::differences::{Basis, Differences};
use super::duals::Duals;
use super::fit::DataSteps;
use super::lanes::{
    BLOCKS, LANES, Lane, Project, by_frames, each, load, shrink, splat, store, total,
};
use super::operators::Operators;
use super::problem::Problem;
use super::state::{SPAN, State, TOGETHER};
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;

/// Largest weight, in the solver's units; larger weights do not change the result but would overflow `f32`.
pub(crate) const LARGEST_WEIGHT: f64 = 1e8;

/// How to iterate.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pace {
    /// Threshold, in units of the image, below which the norm of a difference is quadratic (Huber).
    pub(crate) smoothing: f64,
    /// Over-relaxation factor.
    pub(crate) rho: f64,
}

impl<T: Project> State<T> {
    /// Performs iterations; the unrelaxed change of the last one is kept in `fresh`.
    pub(crate) fn iterate(
        &mut self,
        ops: &Operators<T>,
        problem: &Problem<'_>,
        data: &mut DataSteps<T>,
        pace: Pace,
        count: usize,
    ) {
        let weight = |lambda: f64| T::from_f64(lambda.min(LARGEST_WEIGHT));
        let scaled = Scaled {
            rho: T::from_f64(pace.rho),
            space: weight(problem.lambda_space),
            time: weight(problem.lambda_time),
            anchor: weight(problem.anchor.map_or(0.0, |anchor| anchor.lambda)),
            smoothing: T::from_f64(pace.smoothing),
            bounds: problem.bounds.map(|b| b.map(T::from_f64)),
            tiny: T::from_f64(f64::from(f32::MIN_POSITIVE)),
        };
        let mut chain = self.chain.take();
        let own = chain.as_mut();
        match &ops.basis {
            Basis::Grid(differences) => Arch::new().dispatch(Iterate {
                ops,
                differences,
                state: self,
                data,
                scaled,
                chain: own,
                count,
            }),
            Basis::Gathered(differences) => Arch::new().dispatch(Iterate {
                ops,
                differences: &**differences,
                state: self,
                data,
                scaled,
                chain: own,
                count,
            }),
        }
        self.chain = chain;
    }
}

/// [`Pace`] and weights in the floating-point type of the iteration.
#[derive(Clone, Copy)]
struct Scaled<T> {
    rho: T,
    space: T,
    time: T,
    anchor: T,
    smoothing: T,
    bounds: Option<[T; 2]>,
    /// Positive, but smaller than every non-zero radius.
    tiny: T,
}

struct Iterate<'a, T: Project, D> {
    ops: &'a Operators<T>,
    differences: &'a D,
    state: &'a mut State<T>,
    data: &'a mut DataSteps<T>,
    scaled: Scaled<T>,
    chain: Option<&'a mut Chain<T>>,
    count: usize,
}

impl<T: Project, D: Differences<T>> WithSimd for Iterate<'_, T, D> {
    type Output = ();

    /// Each part is called at one place, because every call is compiled for all widths, types and layouts.
    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let frames = self.state.frames;
        let groups = frames.div_ceil(TOGETHER);
        let is_chained = self.chain.is_some();
        let is_linked = !is_chained && !self.state.duals.links.is_empty();
        let (mut done, mut group) = (0, 0);
        // groups with complete forces
        let mut complete = 0..groups;
        loop {
            for group in complete {
                self.descend_group(simd, group);
            }
            if done == self.count || groups == 0 {
                return;
            }
            let (is_last, is_end) = (done + 1 == self.count, group + 1 == groups);
            self.fit(group);
            self.ascend_group(simd, group, is_last);
            if is_chained && is_end {
                self.chain_steps();
            }
            for frame in match (is_chained, is_end) {
                (false, _) => self.group(group),
                (true, false) => 0..0,
                (true, true) => 0..frames,
            } {
                if is_linked && frame > 0 {
                    self.link_step(frame);
                }
                self.flow_step(frame);
            }
            // those of the group before are complete, and its arrays still in cache
            let before = if is_chained { 0 } else { group.saturating_sub(1) };
            complete = match (is_last, is_end) {
                (true, _) => 0..0,
                (false, true) => before..groups,
                (false, false) if is_chained => 0..0,
                (false, false) => before..group,
            };
            (done, group) = if is_end { (done + 1, 0) } else { (done, group + 1) };
        }
    }
}

impl<T: Project, D: Differences<T>> Iterate<'_, T, D> {
    /// Returns the frames of a group, which pass over the basis together.
    #[inline(always)]
    fn group(&self, index: usize) -> Range<usize> {
        index * TOGETHER..self.state.frames.min((index + 1) * TOGETHER)
    }

    #[inline(always)]
    fn descend_group<S: Simd>(&mut self, simd: S, group: usize) {
        let Range { start, end } = self.group(group);
        by_frames!(end - start, |G, at| self.descend::<S, G>(simd, start + at));
    }

    #[inline(always)]
    fn ascend_group<S: Simd>(&mut self, simd: S, group: usize, keep: bool) {
        let Range { start, end } = self.group(group);
        by_frames!(end - start, |G, at| self.ascend::<S, G>(simd, start + at, keep));
    }

    /// Computes `w` and `V' w` of `G` frames.
    #[inline(always)]
    fn descend<S: Simd, const G: usize>(&mut self, simd: S, first: usize) {
        let Self { ops, differences, state, data, .. } = self;
        let (cells, has_tail, ranks, padded) = (state.cells, state.has_tail, data.head, ops.padded);
        let State { change, work, duals, tail, tau, sums, coefficients, .. } = &mut **state;
        let sums = &mut sums[..G * padded];
        sums.fill([T::default(); LANES]);
        for (panel, blocks) in ops.places.blocks.chunks_exact(BLOCKS).enumerate() {
            let mut w = [[[T::default(); LANES]; BLOCKS]; G];
            for (f, w) in w.iter_mut().enumerate() {
                let frame = first + f;
                let (base, span) = (frame * cells, frame / SPAN * cells);
                let q = duals.flow_of(frame);
                for (j, (w, &at)) in w.iter_mut().zip(blocks).enumerate() {
                    let zero = splat(T::default());
                    let tail = if has_tail { load(tail, base + at) } else { zero };
                    let block = (BLOCKS * panel + j, at, base + at);
                    let pull = duals.pull(*differences, q, block, tail);
                    let (d, tau) = (load(change, base + at), load(tau, span + at));
                    *w = each!(|l| d[l] - tau[l] * pull[l]);
                    store(work, base + at, *w);
                }
            }
            let basis = &ops.short[panel * padded..][..ranks];
            T::project(simd, basis, &w, sums, padded);
        }
        let coefficients = &mut coefficients[first * padded..][..G * padded];
        for (c, sum) in coefficients.iter_mut().zip(sums) {
            *c = total(sum);
        }
        scale_by(coefficients, &ops.short_units);
    }

    /// Computes the force of the data on a group from `V' w`, in units of the entries of the basis.
    #[inline(always)]
    fn fit(&mut self, group: usize) {
        let Range { start, end } = self.group(group);
        let Self { ops, state, data, .. } = self;
        let own = start * ops.padded..end * ops.padded;
        let forces = &mut state.forces[own.clone()];
        data.apply(start, &state.coefficients[own], forces);
        scale_by(forces, &ops.short_units);
    }

    /// Computes `d^` and `x-` of `G` frames, then updates `d` and `p`.
    #[inline(always)]
    fn ascend<S: Simd, const G: usize>(&mut self, simd: S, first: usize, keep: bool) {
        let Self { ops, differences, state, data, scaled, chain, .. } = self;
        let (cells, ranks, padded) = (state.cells, data.head, ops.padded);
        let is_held = !state.duals.held.is_empty() && chain.is_none();
        let split = T::from_f64(state.split[2]);
        let State { origin, change, fresh, work, duals, room, tau, cell_step, forces, .. } =
            &mut **state;
        let force = &mut duals.held;
        let forces = &forces[first * padded..(first + G) * padded];
        let rho = scaled.rho;
        for (panel, blocks) in ops.places.blocks.chunks_exact(BLOCKS).enumerate() {
            let basis = &ops.short[panel * padded..][..ranks];
            let mut pull = [[[T::default(); LANES]; BLOCKS]; G];
            T::expand(simd, basis, forces, padded, &mut pull);
            for (f, pull) in pull.iter().enumerate() {
                let (base, span) = ((first + f) * cells, (first + f) / SPAN * cells);
                for (pull, &at) in pull.iter().zip(blocks) {
                    let here = base + at;
                    let (d, w, tau) = (load(change, here), load(work, here), load(tau, span + at));
                    let new = each!(|l| w[l] - tau[l] * pull[l]);
                    let ahead = each!(|l| new[l] + (new[l] - d[l]));
                    let x = load(origin, here);
                    if keep {
                        store(fresh, here, new);
                    }
                    store(work, here, each!(|l| x[l] + ahead[l]));
                    store(change, here, each!(|l| rho.mul_add(new[l] - d[l], d[l])));
                    if !is_held {
                        continue;
                    }
                    let (p, step) = (load(force, here), load(cell_step, span + at));
                    let radius = differences.cell_radius(at);
                    let step = each!(|l| split * step[l]);
                    let up = each!(|l| step[l].mul_add(ahead[l], p[l]));
                    let limit = each!(|l| scaled.anchor * radius[l]);
                    let mut dual = huber(up, limit, step, scaled);
                    if !room[0].is_empty() {
                        let (below, above) = (load(&room[0], here), load(&room[1], here));
                        dual = each!(|l| {
                            let soft = up[l] - dual[l];
                            up[l] - soft.min(step[l] * above[l]).max(step[l] * below[l])
                        });
                    }
                    store(force, here, each!(|l| rho.mul_add(dual[l] - p[l], p[l])));
                }
            }
        }
    }

    /// Updates `q_t` of the link between a frame and the one before.
    #[inline(always)]
    fn link_step(&mut self, frame: usize) {
        let Self { ops, differences, state, scaled, .. } = self;
        let (cells, split) = (state.cells, T::from_f64(state.split[1]));
        let State { work, duals, cell_step, .. } = &mut **state;
        let links = &mut duals.links;
        let base = frame * cells;
        let spans = [(frame - 1) / SPAN * cells, frame / SPAN * cells];
        for &at in &ops.places.blocks {
            let (before, here) = (load(work, base - cells + at), load(work, base + at));
            let (first, second) = (load(cell_step, spans[0] + at), load(cell_step, spans[1] + at));
            let step = each!(|l| split * first[l].min(second[l]));
            let (q, radius) = (load(links, base + at), differences.cell_radius(at));
            let up = each!(|l| step[l].mul_add(here[l] - before[l], q[l]));
            let limit = each!(|l| scaled.time * radius[l]);
            let new = huber(up, limit, step, scaled);
            store(links, base + at, each!(|l| scaled.rho.mul_add(new[l] - q[l], q[l])));
        }
    }

    /// Updates `q_t` and `p` of all frames together.
    #[inline(always)]
    fn chain_steps(&mut self) {
        let Self { ops, differences, state, scaled, chain, .. } = self;
        let Some(chain) = chain else { return };
        let (frames, cells) = (state.frames, state.cells);
        let split = T::from_f64(state.split[1]);
        let State { work, duals, cell_step, .. } = &mut **state;
        let Duals { links, held: force, .. } = duals;
        for &at in &ops.places.blocks {
            let radius = differences.cell_radius(at);
            for (l, radius) in radius.iter().enumerate() {
                let at = at + l;
                if ops.inside[at] == T::default() {
                    continue;
                }
                for t in 0..frames {
                    let here = t * cells + at;
                    let sigma = split * cell_step[t / SPAN * cells + at];
                    let held = force.get(here).copied().unwrap_or_default();
                    let own = (links[here] - links[here + cells]) + held;
                    chain.weights[t] = sigma;
                    chain.data[t] = sigma.mul_add(work[here], own);
                }
                chain.pull(scaled.time * *radius);
                for t in 1..frames {
                    let q = &mut links[t * cells + at];
                    *q = scaled.rho.mul_add(chain.dual[t - 1] - *q, *q);
                }
                let Some([lower, upper]) = scaled.bounds else { continue };
                for t in 0..frames {
                    let (p, u) = (&mut force[t * cells + at], chain.slopes[t]);
                    let new = chain.weights[t] * (u - u.max(lower).min(upper));
                    *p = scaled.rho.mul_add(new - *p, *p);
                }
            }
        }
    }

    /// Updates `q` of a frame.
    #[inline(always)]
    fn flow_step(&mut self, frame: usize) {
        let Self { differences, state, scaled, .. } = self;
        let State { cells, groups, work, duals, group_step, .. } = &mut **state;
        let (base, span) = (frame * *groups, frame / SPAN * *groups);
        let bar = &work[frame * *cells..(frame + 1) * *cells];
        let [first, second] = &mut duals.flow;
        for &at in differences.group_blocks() {
            let [da, db] = differences.difference(bar, at);
            let step = load(group_step, span + at);
            let (a, b) = (load(first, base + at), load(second, base + at));
            let up_a = each!(|l| step[l].mul_add(da[l], a[l]));
            let up_b = each!(|l| step[l].mul_add(db[l], b[l]));
            let radius = differences.group_radius(at);
            let radius = each!(|l| scaled.space * radius[l]);
            let least = each!(|l| step[l].mul_add(scaled.smoothing, radius[l]));
            let factor = shrink(up_a, up_b, radius, least);
            let rho = scaled.rho;
            store(first, base + at, each!(|l| rho.mul_add(up_a[l] * factor[l] - a[l], a[l])));
            store(second, base + at, each!(|l| rho.mul_add(up_b[l] * factor[l] - b[l], b[l])));
        }
    }
}

/// Multiplies `[frame][rank]` by a factor of each rank.
#[inline(always)]
fn scale_by<T: Project>(values: &mut [T], factors: &[T]) {
    for row in values.chunks_exact_mut(factors.len()) {
        for (value, factor) in row.iter_mut().zip(factors) {
            *value = *value * *factor;
        }
    }
}

/// Returns `project(up / (1 + step gamma / limit))` onto `[-limit, limit]`.
#[inline(always)]
fn huber<T: Project>(up: Lane<T>, limit: Lane<T>, step: Lane<T>, scaled: &Scaled<T>) -> Lane<T> {
    each!(|l| {
        let least = step[l].mul_add(scaled.smoothing, limit[l]);
        up[l] * (limit[l] / up[l].abs().max(least).max(scaled.tiny))
    })
}
