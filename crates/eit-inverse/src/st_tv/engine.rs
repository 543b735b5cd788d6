//! The iteration: a primal-dual method (Chambolle, Pock, *J. Math. Imaging Vis.* 40 (2011) 120)
//! whose primal step solves the data term exactly, over-relaxed.
//!
//! ```text
//! w   = x - tau (D' q + D_t' q_t + p)
//! x^  = w + V (c' - V' w),     c' = argmin data(c) + |c - V' w|^2 / (2 tau)
//! x-  = 2 x^ - x
//! q^  = project(q + sigma D x-)        onto |q_g| <= lambda_space size_g
//! q_t^ = project(q_t + sigma D_t x-)   onto |q_t| <= lambda_time area
//! p^  = p + sigma x- - sigma clip(p / sigma + x-, lower, upper)
//! (x, q, q_t, p) += rho ((x^, q^, q_t^, p^) - (x, q, q_t, p))
//! ```
//!
//! with `sigma tau (|D|^2 + 4 + 1) <= 1` (the 4 where the movie has more than one frame, the 1
//! where there are bounds) and `rho` = 1.9.
//!
//! # Cost
//! Per iteration `4 n r T` flops in two dense products (`n` unknowns, `r` the rank of the data, `T`
//! frames, padded to a multiple of 8) and about 14 passes over arrays of `n T` values. For
//! 64 x 64 x 20 (`n` = 3228, `r` = 104) that is 26.9 Mflop and 3.6 MB in `f32`.
//! docs/PERFORMANCE.md has the measured time against that floor.
//!
//! Long because both halves of the iteration and their element-wise steps share one layout, and are
//! inlined into one function each.

use super::kernel::{LANES, PANEL, add_row, block, for_blocks, lanes, panels_times, put};
use super::operators::{BLOCK, Group, Operators};
use super::scalar::Scalar;
use pulp::{Arch, Simd, WithSimd};

/// Over-relaxation.
const RHO: f64 = 1.9;

/// Zeros before and after the arrays whose neighbours in time are read across row ends.
const PAD: usize = LANES;

/// Step sizes and weights.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Steps {
    pub(crate) tau: f64,
    pub(crate) sigma: f64,
    pub(crate) lambda_space: f64,
    pub(crate) lambda_time: f64,
    pub(crate) bounds: Option<[f64; 2]>,
}

/// The iterate of one movie.
///
/// Arrays are `[unknown][stride]` or `[row][stride]`, see [`super::kernel`].
#[derive(Debug, Clone)]
pub(crate) struct State<T> {
    pub(crate) frames: usize,
    pub(crate) stride: usize,
    /// `x`.
    pub(crate) image: Vec<T>,
    /// `q`.
    pub(crate) dual: Vec<T>,
    /// `q_t`, with [`PAD`] zeros before; zero at the last frame and beyond. Empty without a time
    /// term.
    pub(crate) time_dual: Vec<T>,
    /// `p`; empty without bounds.
    pub(crate) bound_dual: Vec<T>,
    /// `w`, then `x^`, then `x-`, with [`PAD`] values after.
    work: Vec<T>,
    /// `x^` of the last iteration that was asked to keep it.
    pub(crate) candidate: Vec<T>,
    /// `V' w`, then `c' - V' w`.
    coefficients: Vec<T>,
    /// 1 for frames whose change to the next one counts, `[stride]`.
    links: Vec<T>,
    /// 1 for frames, 0 for padding, which has no bounds: it would leave zero where they exclude it,
    /// `[stride]`.
    present: Vec<T>,
}

impl<T: Scalar> State<T> {
    pub(crate) fn new(ops: &Operators<T>, frames: usize, time: bool, bounds: bool) -> Self {
        let stride = frames.next_multiple_of(LANES);
        let zero = T::default();
        let values = ops.unknowns.next_multiple_of(BLOCK) * stride;
        let mut links = vec![zero; stride];
        links.iter_mut().take(frames.saturating_sub(1)).for_each(|l| *l = T::from_f64(1.0));
        Self {
            frames,
            stride,
            image: vec![zero; values],
            dual: vec![zero; ops.gradient.count() * stride],
            time_dual: if time { vec![zero; PAD + values] } else { Vec::new() },
            bound_dual: if bounds { vec![zero; values] } else { Vec::new() },
            work: vec![zero; values + PAD],
            candidate: vec![zero; values],
            coefficients: vec![zero; ops.padded_rank * stride],
            links,
            present: (0..stride).map(|t| T::from_f64(if t < frames { 1.0 } else { 0.0 })).collect(),
        }
    }

    /// Takes image and duals of a state of the same problem.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.image.copy_from_slice(&other.image);
        self.dual.copy_from_slice(&other.dual);
        self.time_dual.copy_from_slice(&other.time_dual);
        self.bound_dual.copy_from_slice(&other.bound_dual);
    }

    /// Which frames are linked to their next one, `[stride]`, 1 or 0. The last one never is.
    pub(crate) fn links_mut(&mut self) -> &mut [T] {
        &mut self.links
    }

    /// Is a frame linked to its next one?
    pub(crate) fn is_linked(&self, frame: usize) -> bool {
        !self.time_dual.is_empty() && self.links[frame] > T::default()
    }

    /// Forgets image and duals.
    pub(crate) fn clear(&mut self) {
        let zero = T::default();
        self.image.fill(zero);
        self.dual.fill(zero);
        self.time_dual.fill(zero);
        self.bound_dual.fill(zero);
    }

    /// Moves all frames one back in time; the last one keeps its image and duals, and has no change
    /// in time to it yet.
    pub(crate) fn shift(&mut self) {
        let (stride, frames) = (self.stride, self.frames);
        for array in [&mut self.image, &mut self.dual, &mut self.bound_dual] {
            for row in array.chunks_exact_mut(stride) {
                row.copy_within(1..frames, 0);
            }
        }
        if let Some(rows) = self.time_dual.get_mut(PAD..) {
            for row in rows.chunks_exact_mut(stride) {
                row.copy_within(1..frames, 0);
                row[frames - 1] = T::default();
            }
        }
    }

    /// Subtracts the last frame's image from those of `frames`.
    pub(crate) fn subtract_newest(&mut self, frames: std::ops::Range<usize>) {
        let last = self.frames - 1;
        for row in self.image.chunks_exact_mut(self.stride) {
            let newest = row[last];
            row[frames.clone()].iter_mut().for_each(|x| *x = *x - newest);
        }
    }

    /// `q_t` of an unknown.
    pub(crate) fn time_dual_row(&self, unknown: usize) -> &[T] {
        &self.time_dual[PAD + unknown * self.stride..][..self.stride]
    }

    /// One iteration. `fit` replaces the coefficients `[rank][stride]` of `w` by the change that
    /// the data asks for. With `keep` the unrelaxed image is kept as the candidate.
    pub(crate) fn iterate(
        &mut self,
        arch: Arch,
        ops: &Operators<T>,
        steps: &Steps,
        keep: bool,
        mut fit: impl FnMut(&mut [T], usize),
    ) {
        let scaled = Scaled::new(steps);
        arch.dispatch(Descend { state: self, ops, steps: &scaled });
        fit(&mut self.coefficients, self.stride);
        arch.dispatch(Ascend { state: self, ops, steps: &scaled, keep });
    }
}

/// [`Steps`] in the iteration's type.
struct Scaled<T> {
    tau: T,
    sigma: T,
    rho: T,
    space: T,
    time: T,
    bounds: Option<[T; 2]>,
}

impl<T: Scalar> Scaled<T> {
    fn new(steps: &Steps) -> Self {
        Self {
            tau: T::from_f64(steps.tau),
            sigma: T::from_f64(steps.sigma),
            rho: T::from_f64(RHO),
            space: T::from_f64(steps.lambda_space),
            time: T::from_f64(steps.lambda_time),
            bounds: steps.bounds.map(|b| b.map(T::from_f64)),
        }
    }
}

/// First half: `w` and its coefficients.
struct Descend<'a, T> {
    state: &'a mut State<T>,
    ops: &'a Operators<T>,
    steps: &'a Scaled<T>,
}

impl<T: Scalar> WithSimd for Descend<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { state, ops, steps } = self;
        let stride = state.stride;
        state.coefficients.fill(T::default());
        let minus_tau = T::default() - steps.tau;
        for first in (0..ops.unknowns).step_by(BLOCK) {
            let count = BLOCK.min(ops.unknowns - first);
            for p in first..first + count {
                for_blocks!(stride, |offset, WIDTH| {
                    let force = force::<T, WIDTH>(state, ops, p, offset);
                    let at = p * stride + offset;
                    let image = block::<T, WIDTH>(&state.image, at);
                    put(&mut state.work, at, add_row(minus_tau, &force, image));
                });
            }
            let panels = ops.padded_rank / PANEL;
            let analysis = &ops.analysis[first * panels..][..count * panels];
            let block = &state.work[first * stride..][..count * stride];
            panels_times(analysis, count, block, stride, &mut state.coefficients);
        }
    }
}

/// `D' q + D_t' q_t + p` of `L` frames of an unknown.
#[inline(always)]
fn force<T: Scalar, const L: usize>(
    state: &State<T>,
    ops: &Operators<T>,
    unknown: usize,
    offset: usize,
) -> [T; L] {
    let mut sum = [T::default(); L];
    for (row, value) in ops.divergence.row(unknown) {
        let dual = block::<T, L>(&state.dual, row * state.stride + offset);
        sum = add_row(value, &dual, sum);
    }
    let at = unknown * state.stride + offset;
    if !state.time_dual.is_empty() {
        // before the first frame stands the zero at the end of the row before
        let before = block::<T, L>(&state.time_dual, PAD + at - 1);
        let here = block::<T, L>(&state.time_dual, PAD + at);
        sum = lanes(|l| sum[l] + (before[l] - here[l]));
    }
    if !state.bound_dual.is_empty() {
        let bound = block::<T, L>(&state.bound_dual, at);
        sum = lanes(|l| sum[l] + bound[l]);
    }
    sum
}

/// Second half: the image from the fitted coefficients, then all duals.
struct Ascend<'a, T> {
    state: &'a mut State<T>,
    ops: &'a Operators<T>,
    steps: &'a Scaled<T>,
    keep: bool,
}

impl<T: Scalar> WithSimd for Ascend<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { state, ops, steps, keep } = self;
        let stride = state.stride;
        let rank = ops.padded_rank;
        for first in (0..ops.unknowns).step_by(BLOCK) {
            let count = BLOCK.min(ops.unknowns - first);
            let own = first * stride..(first + count.next_multiple_of(PANEL)) * stride;
            let synthesis = &ops.synthesis[first / PANEL * rank..];
            let synthesis = &synthesis[..count.div_ceil(PANEL) * rank];
            panels_times(
                synthesis,
                rank,
                &state.coefficients,
                stride,
                &mut state.work[own.clone()],
            );
            if keep {
                state.candidate[own.clone()].copy_from_slice(&state.work[own.clone()]);
            }
            extrapolate(&mut state.image[own.clone()], &mut state.work[own.clone()], steps.rho);
            if let Some(bounds) = steps.bounds {
                let duals = state.bound_dual[own.clone()].chunks_exact_mut(stride);
                for (duals, row) in duals.zip(state.work[own].chunks_exact(stride)) {
                    bound_step(duals, row, &state.present, steps.sigma, bounds, steps.rho);
                }
            }
            if !state.time_dual.is_empty() {
                for p in first..first + count {
                    for_blocks!(stride, |offset, WIDTH| {
                        time_step::<T, WIDTH>(state, ops, steps, p, offset);
                    });
                }
            }
        }
        let pairs = ops.components == 2;
        for (index, (group, &radius)) in ops.groups.iter().zip(&ops.radius).enumerate() {
            let radius = steps.space * radius;
            let at = index * ops.components * stride;
            for_blocks!(stride, |offset, WIDTH| {
                if pairs {
                    pair_step::<T, WIDTH>(state, group, steps, radius, at + offset, offset);
                } else {
                    single_step::<T, WIDTH>(state, group, steps, radius, at + offset, offset);
                }
            });
        }
    }
}

/// `block` holds `x^`: sets it to `2 x^ - x` and relaxes `x`.
#[inline(always)]
fn extrapolate<T: Scalar>(image: &mut [T], block: &mut [T], rho: T) {
    let images = image.as_chunks_mut::<LANES>().0;
    for (x, b) in images.iter_mut().zip(block.as_chunks_mut::<LANES>().0) {
        let change: [T; LANES] = lanes(|l| b[l] - x[l]);
        *b = lanes(|l| b[l] + change[l]);
        *x = lanes(|l| rho.mul_add(change[l], x[l]));
    }
}

#[inline(always)]
fn bound_step<T: Scalar>(
    duals: &mut [T],
    row: &[T],
    present: &[T],
    sigma: T,
    bounds: [T; 2],
    rho: T,
) {
    let duals = duals.as_chunks_mut::<LANES>().0;
    let rows = row.as_chunks::<LANES>().0.iter().zip(present.as_chunks::<LANES>().0);
    for (p, (b, present)) in duals.iter_mut().zip(rows) {
        *p = lanes(|l| {
            let up = sigma.mul_add(b[l], p[l]);
            // zero between the bounds, without dividing by sigma
            let new = (up - sigma * bounds[1]).max((up - sigma * bounds[0]).min(T::default()));
            present[l] * rho.mul_add(new - p[l], p[l])
        });
    }
}

#[inline(always)]
fn time_step<T: Scalar, const L: usize>(
    state: &mut State<T>,
    ops: &Operators<T>,
    steps: &Scaled<T>,
    unknown: usize,
    offset: usize,
) {
    let at = unknown * state.stride + offset;
    let here = block::<T, L>(&state.work, at);
    // what is read beyond the row's end has no link
    let after = block::<T, L>(&state.work, at + 1);
    let links = block::<T, L>(&state.links, offset);
    let old = block::<T, L>(&state.time_dual, PAD + at);
    let radius = steps.time * ops.time_radius[unknown];
    let new = lanes(|l| {
        let limit = radius * links[l];
        let up = steps.sigma.mul_add(after[l] - here[l], old[l]);
        let new = up.min(limit).max(T::default() - limit);
        steps.rho.mul_add(new - old[l], old[l])
    });
    put::<T, L>(&mut state.time_dual, PAD + at, new);
}

/// Differences of a group in `L` frames, one array for each component.
#[inline(always)]
fn differences<T: Scalar, const L: usize>(
    state: &State<T>,
    group: &Group<T>,
    offset: usize,
) -> [[T; L]; 2] {
    let row = |place: usize| group.unknowns[place] as usize * state.stride + offset;
    let rows = [0, 1, 2].map(|place| block::<T, L>(&state.work, row(place)));
    group.weights.map(|w| {
        let first = lanes(|l| w[0] * rows[0][l]);
        add_row(w[2], &rows[2], add_row(w[1], &rows[1], first))
    })
}

#[inline(always)]
fn pair_step<T: Scalar, const L: usize>(
    state: &mut State<T>,
    group: &Group<T>,
    steps: &Scaled<T>,
    radius: T,
    at: usize,
    offset: usize,
) {
    let [da, db] = differences::<T, L>(state, group, offset);
    let stride = state.stride;
    let a = block::<T, L>(&state.dual, at);
    let b = block::<T, L>(&state.dual, at + stride);
    let up_a = add_row(steps.sigma, &da, a);
    let up_b = add_row(steps.sigma, &db, b);
    let shrink: [T; L] = lanes(|l| {
        let norm = up_a[l].mul_add(up_a[l], up_b[l] * up_b[l]).sqrt();
        radius / norm.max(radius)
    });
    let relax =
        |up: [T; L], old: [T; L]| lanes(|l| steps.rho.mul_add(up[l] * shrink[l] - old[l], old[l]));
    put::<T, L>(&mut state.dual, at, relax(up_a, a));
    put::<T, L>(&mut state.dual, at + stride, relax(up_b, b));
}

#[inline(always)]
fn single_step<T: Scalar, const L: usize>(
    state: &mut State<T>,
    group: &Group<T>,
    steps: &Scaled<T>,
    radius: T,
    at: usize,
    offset: usize,
) {
    let [d, _] = differences::<T, L>(state, group, offset);
    let old = block::<T, L>(&state.dual, at);
    let new = lanes(|l| {
        let up = steps.sigma.mul_add(d[l], old[l]);
        let new = up.min(radius).max(T::default() - radius);
        steps.rho.mul_add(new - old[l], old[l])
    });
    put::<T, L>(&mut state.dual, at, new);
}
