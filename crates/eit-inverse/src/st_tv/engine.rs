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
//! # One sweep
//! What follows the data step of one iteration and what comes before that of the next needs of an
//! unknown only its neighbours. So both run in one sweep over blocks of unknowns: a block gets its
//! image; the groups that it completes get their duals; the blocks which those complete get their
//! `w` and give their share of `V' w`. The basis, the largest array, comes from memory once, and
//! everything else once to be read and once to be written.
//!
//! # Head and tail
//! Singular values of an electrode array fall by a million from the first to the last. Where
//! `tau s^2` is small an explicit step serves as well as the exact one: these directions, the tail,
//! enter as a constant force `V (s y)`, `y = s c - b`, that is brought up to date every
//! [`REFRESH`] iterations, and the products run over the head alone. The fixed point is the same.
//!
//! # Cost
//! Per iteration `4 n h T` flops in two dense products (`n` unknowns, `h` the head's rank, `T`
//! frames, padded to a multiple of 8) and 5 arrays of `n T` values, read, 4 of them written. For
//! 64 x 64 x 20 (`n` = 3228, `h` = 72 of 104) that is 18.6 Mflop and 0.9 + 2.8 MB in `f32`.
//! docs/PERFORMANCE.md has the measured time against that floor.
//!
//! Long because both halves of the iteration and their element-wise steps share one layout, and are
//! inlined into one function.

use super::kernel::{
    LANES, PANEL, RANKS, add_row, add_scaled, analyse, lanes, row, row_mut, synthesise,
};
use super::operators::{BLOCK, Group, Operators};
use super::scalar::Scalar;
use pulp::{Arch, Simd, WithSimd};

/// Over-relaxation.
const RHO: f64 = 1.9;

/// Zeros before and after the arrays whose neighbours in time are read across row ends.
const PAD: usize = LANES;

/// Iterations that share one force of the tail.
pub(crate) const REFRESH: usize = 32;

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
    /// `w`, then `x^`, then `x-`, then the next `w`, with [`PAD`] values after.
    work: Vec<T>,
    /// `x^` of the last iteration that was asked to keep it.
    pub(crate) candidate: Vec<T>,
    /// `V' w`, then `c' - V' w`.
    coefficients: Vec<T>,
    /// Those of the next `w` while they are summed.
    next: Vec<T>,
    /// Ranks below are the head, see the module.
    pub(crate) head: usize,
    /// Force of the tail, `V (s y)`, of blocks of unknowns; not used where there is no tail.
    tail: Vec<T>,
    /// Iterations since the tail was brought up to date.
    pub(crate) age: usize,
    /// The primal step for which `work` holds `w` and `coefficients` its coefficients.
    prepared: Option<f64>,
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
            next: vec![zero; ops.padded_rank * stride],
            head: ops.padded_rank,
            tail: vec![zero; values],
            age: REFRESH,
            prepared: None,
            links,
            present: (0..stride).map(|t| T::from_f64(if t < frames { 1.0 } else { 0.0 })).collect(),
        }
    }

    /// Takes image and duals of a state of the same problem.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.prepared = None;
        // another step size has another tail
        self.age = REFRESH;
        self.image.copy_from_slice(&other.image);
        self.dual.copy_from_slice(&other.dual);
        self.time_dual.copy_from_slice(&other.time_dual);
        self.bound_dual.copy_from_slice(&other.bound_dual);
    }

    /// Which frames are linked to their next one, `[stride]`, 1 or 0. The last one never is.
    pub(crate) fn links_mut(&mut self) -> &mut [T] {
        self.prepared = None;
        &mut self.links
    }

    /// Is a frame linked to its next one?
    pub(crate) fn is_linked(&self, frame: usize) -> bool {
        !self.time_dual.is_empty() && self.links[frame] > T::default()
    }

    /// Forgets image and duals.
    pub(crate) fn clear(&mut self) {
        self.age = REFRESH;
        self.prepared = None;
        let zero = T::default();
        self.image.fill(zero);
        self.dual.fill(zero);
        self.time_dual.fill(zero);
        self.bound_dual.fill(zero);
    }

    /// Moves all frames one back in time; the last one keeps its image and duals, and has no change
    /// in time to it yet.
    pub(crate) fn shift(&mut self) {
        self.age = REFRESH;
        self.prepared = None;
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
        self.age = REFRESH;
        self.prepared = None;
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

    /// Brings the tail up to date, with a head of these ranks. `fit` replaces the coefficients
    /// `[rank][stride]` of the image, of which those of the tail are given, by their force.
    pub(crate) fn refresh_tail(
        &mut self,
        arch: Arch,
        ops: &Operators<T>,
        head: usize,
        fit: impl FnOnce(&mut [T], usize),
    ) {
        self.head = head.next_multiple_of(RANKS).min(ops.padded_rank);
        self.age = 0;
        self.prepared = None;
        if self.head < ops.padded_rank {
            arch.dispatch(Analyse { state: self, ops });
            fit(&mut self.next, self.stride);
            arch.dispatch(Pull { state: self, ops });
        }
    }

    /// One iteration. `fit` replaces the head's coefficients `[rank][stride]` of `w` by the change
    /// that the data asks for. With `keep` the unrelaxed image is kept as the candidate. `next_tau` is
    /// the primal step of the iteration to come; another one costs a sweep more.
    pub(crate) fn iterate(
        &mut self,
        arch: Arch,
        ops: &Operators<T>,
        steps: &Steps,
        next_tau: f64,
        keep: bool,
        mut fit: impl FnMut(&mut [T], usize),
    ) {
        if self.prepared != Some(steps.tau) {
            arch.dispatch(Descend { state: self, ops, tau: T::from_f64(steps.tau) });
        }
        fit(&mut self.coefficients, self.stride);
        let next_tau_scaled = T::from_f64(next_tau);
        let steps = Scaled::new(steps);
        arch.dispatch(Sweep { state: self, ops, steps: &steps, next_tau: next_tau_scaled, keep });
        std::mem::swap(&mut self.coefficients, &mut self.next);
        self.prepared = Some(next_tau);
        self.age += 1;
    }
}

/// [`Steps`] in the iteration's type.
struct Scaled<T> {
    sigma: T,
    rho: T,
    space: T,
    time: T,
    bounds: Option<[T; 2]>,
}

impl<T: Scalar> Scaled<T> {
    fn new(steps: &Steps) -> Self {
        Self {
            sigma: T::from_f64(steps.sigma),
            rho: T::from_f64(RHO),
            space: T::from_f64(steps.lambda_space),
            time: T::from_f64(steps.lambda_time),
            bounds: steps.bounds.map(|b| b.map(T::from_f64)),
        }
    }
}

/// The tail's coefficients of the image.
struct Analyse<'a, T> {
    state: &'a mut State<T>,
    ops: &'a Operators<T>,
}

impl<T: Scalar> WithSimd for Analyse<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { state, ops } = self;
        let (rank, stride) = (ops.padded_rank, state.stride);
        state.next.fill(T::default());
        let blocks = ops.basis.chunks_exact(BLOCK / PANEL * rank);
        for (basis, image) in blocks.zip(state.image.chunks_exact(BLOCK * stride)) {
            analyse(basis, rank, state.head..rank, image, stride, &mut state.next);
        }
    }
}

/// The tail's force on all unknowns.
struct Pull<'a, T> {
    state: &'a mut State<T>,
    ops: &'a Operators<T>,
}

impl<T: Scalar> WithSimd for Pull<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { state, ops } = self;
        let rank = ops.padded_rank;
        state.tail.fill(T::default());
        let range = state.head..rank;
        synthesise(&ops.basis, rank, range, &state.next, state.stride, &mut state.tail);
    }
}

/// `w` and its coefficients, without an iteration before.
struct Descend<'a, T> {
    state: &'a mut State<T>,
    ops: &'a Operators<T>,
    tau: T,
}

impl<T: Scalar> WithSimd for Descend<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { state, ops, tau } = self;
        state.next.fill(T::default());
        for block in 0..ops.ready.len() {
            descend(state, ops, block, tau);
        }
        std::mem::swap(&mut state.coefficients, &mut state.next);
    }
}

/// `w` of a block, and its share of the coefficients.
#[inline(always)]
fn descend<T: Scalar>(state: &mut State<T>, ops: &Operators<T>, block: usize, tau: T) {
    let stride = state.stride;
    let first = block * BLOCK;
    for p in first..(first + BLOCK).min(ops.unknowns) {
        step_down(state, ops, p, tau);
    }
    let basis = &ops.basis[first / PANEL * ops.padded_rank..];
    let basis = &basis[..BLOCK / PANEL * ops.padded_rank];
    let own = &state.work[first * stride..][..BLOCK * stride];
    analyse(basis, ops.padded_rank, 0..state.head, own, stride, &mut state.next);
}

/// `w = x - tau (D' q + D_t' q_t + p + tail)` of an unknown.
#[inline(always)]
fn step_down<T: Scalar>(state: &mut State<T>, ops: &Operators<T>, unknown: usize, tau: T) {
    let stride = state.stride;
    let at = unknown * stride;
    let minus_tau = T::default() - tau;
    let mut offset = 0;
    while offset < stride {
        offset += match stride - offset {
            24.. => divergence::<T, 3>(state, ops, unknown, offset, minus_tau),
            16.. => divergence::<T, 2>(state, ops, unknown, offset, minus_tau),
            _ => divergence::<T, 1>(state, ops, unknown, offset, minus_tau),
        };
    }
    let work = &mut state.work[at..at + stride];
    if !state.time_dual.is_empty() {
        // before the first frame stands the zero at the end of the row before; one after the other,
        // since the compiler would shuffle two loads that overlap
        add_scaled(tau, &state.time_dual[PAD + at..][..stride], work);
        add_scaled(minus_tau, &state.time_dual[PAD + at - 1..][..stride], work);
    }
    if !state.bound_dual.is_empty() {
        add_scaled(minus_tau, &state.bound_dual[at..][..stride], work);
    }
    if state.head < ops.padded_rank {
        add_scaled(minus_tau, &state.tail[at..][..stride], work);
    }
}

/// `w = x - tau D' q` of `B` blocks of frames; returns how many frames these are.
#[inline(always)]
fn divergence<T: Scalar, const B: usize>(
    state: &mut State<T>,
    ops: &Operators<T>,
    unknown: usize,
    offset: usize,
    minus_tau: T,
) -> usize {
    let mut sums = [[T::default(); LANES]; B];
    for (r, value) in ops.divergence.row(unknown) {
        let duals = row(&state.dual, r * state.stride + offset, B * LANES);
        for b in 0..B {
            sums[b] = add_row(value, &duals[b], sums[b]);
        }
    }
    let at = unknown * state.stride + offset;
    let image = row(&state.image, at, B * LANES);
    let work = row_mut(&mut state.work, at, B * LANES);
    for b in 0..B {
        work[b] = add_row(minus_tau, &sums[b], image[b]);
    }
    B * LANES
}

/// The image from the fitted coefficients, all duals, and the next `w` with its coefficients.
struct Sweep<'a, T> {
    state: &'a mut State<T>,
    ops: &'a Operators<T>,
    steps: &'a Scaled<T>,
    next_tau: T,
    keep: bool,
}

impl<T: Scalar> WithSimd for Sweep<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { state, ops, steps, next_tau, keep } = self;
        state.next.fill(T::default());
        let (mut groups, mut blocks) = (0, 0);
        for (block, ready) in ops.ready.iter().enumerate() {
            ascend(state, ops, steps, block, keep);
            for group in groups..ready.groups {
                if ops.components == 2 {
                    pair_step(state, ops, steps, group);
                } else {
                    single_step(state, ops, steps, group);
                }
            }
            for block in blocks..ready.blocks {
                descend(state, ops, block, next_tau);
            }
            (groups, blocks) = (ready.groups, ready.blocks);
        }
    }
}

/// Image, and duals of time and bounds, of a block.
#[inline(always)]
fn ascend<T: Scalar>(
    state: &mut State<T>,
    ops: &Operators<T>,
    steps: &Scaled<T>,
    block: usize,
    keep: bool,
) {
    let (stride, first) = (state.stride, block * BLOCK);
    let own = first * stride..(first + BLOCK) * stride;
    let basis = &ops.basis[first / PANEL * ops.padded_rank..];
    let basis = &basis[..BLOCK / PANEL * ops.padded_rank];
    let work = &mut state.work[own.clone()];
    synthesise(basis, ops.padded_rank, 0..state.head, &state.coefficients, stride, work);
    if keep {
        state.candidate[own.clone()].copy_from_slice(work);
    }
    extrapolate(&mut state.image[own.clone()], work, steps.rho);
    if let Some(bounds) = steps.bounds {
        let duals = state.bound_dual[own.clone()].chunks_exact_mut(stride);
        for (duals, row) in duals.zip(work.chunks_exact(stride)) {
            bound_step(duals, row, &state.present, steps.sigma, bounds, steps.rho);
        }
    }
    if !state.time_dual.is_empty() {
        for p in first..(first + BLOCK).min(ops.unknowns) {
            time_step(state, ops, steps, p);
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
fn time_step<T: Scalar>(
    state: &mut State<T>,
    ops: &Operators<T>,
    steps: &Scaled<T>,
    unknown: usize,
) {
    let stride = state.stride;
    let at = unknown * stride;
    let here = row(&state.work, at, stride);
    // what is read beyond the row's end has no link
    let after = row(&state.work, at + 1, stride);
    let links = row(&state.links, 0, stride);
    let radius = steps.time * ops.time_radius[unknown];
    let duals = row_mut(&mut state.time_dual, PAD + at, stride);
    for ((q, links), (here, after)) in duals.iter_mut().zip(links).zip(here.iter().zip(after)) {
        *q = lanes(|l| {
            let limit = radius * links[l];
            let up = steps.sigma.mul_add(after[l] - here[l], q[l]);
            let new = up.min(limit).max(T::default() - limit);
            steps.rho.mul_add(new - q[l], q[l])
        });
    }
}

/// Differences of a group, one array for each component.
#[inline(always)]
pub(crate) fn differences<T: Scalar>(group: &Group<T>, rows: [&[T; LANES]; 3]) -> [[T; LANES]; 2] {
    // not by `map`: a closure inside it is compiled for the least of all machines
    let component = |w: &[T; 3]| {
        let first = lanes(|l| w[0] * rows[0][l]);
        add_row(w[2], rows[2], add_row(w[1], rows[1], first))
    };
    [component(&group.weights[0]), component(&group.weights[1])]
}

/// The rows of a group's unknowns.
#[inline(always)]
fn group_rows<'a, T: Scalar>(
    work: &'a [T],
    group: &Group<T>,
    stride: usize,
) -> [&'a [[T; LANES]]; 3] {
    group.unknowns.map(|p| row(work, p as usize * stride, stride))
}

#[inline(always)]
fn pair_step<T: Scalar>(state: &mut State<T>, ops: &Operators<T>, steps: &Scaled<T>, index: usize) {
    let stride = state.stride;
    let group = &ops.groups[index];
    let radius = steps.space * ops.radius[index];
    let [first, second, third] = group_rows(&state.work, group, stride);
    let duals = &mut state.dual[2 * index * stride..][..2 * stride];
    let (a, b) = duals.split_at_mut(stride);
    let duals = a.as_chunks_mut::<LANES>().0.iter_mut().zip(b.as_chunks_mut::<LANES>().0);
    for ((a, b), ((first, second), third)) in duals.zip(first.iter().zip(second).zip(third)) {
        let [da, db] = differences(group, [first, second, third]);
        let up_a = add_row(steps.sigma, &da, *a);
        let up_b = add_row(steps.sigma, &db, *b);
        let shrink = lanes(|l| {
            let norm = up_a[l].mul_add(up_a[l], up_b[l] * up_b[l]).sqrt();
            radius / norm.max(radius)
        });
        let relax = |up: [T; LANES], old: [T; LANES]| {
            lanes(|l| steps.rho.mul_add(up[l] * shrink[l] - old[l], old[l]))
        };
        *a = relax(up_a, *a);
        *b = relax(up_b, *b);
    }
}

#[inline(always)]
fn single_step<T: Scalar>(
    state: &mut State<T>,
    ops: &Operators<T>,
    steps: &Scaled<T>,
    index: usize,
) {
    let stride = state.stride;
    let group = &ops.groups[index];
    let radius = steps.space * ops.radius[index];
    let [first, second, third] = group_rows(&state.work, group, stride);
    let duals = row_mut(&mut state.dual, index * stride, stride);
    for (q, ((first, second), third)) in duals.iter_mut().zip(first.iter().zip(second).zip(third)) {
        let [d, _] = differences(group, [first, second, third]);
        *q = lanes(|l| {
            let up = steps.sigma.mul_add(d[l], q[l]);
            let new = up.min(radius).max(T::default() - radius);
            steps.rho.mul_add(new - q[l], q[l])
        });
    }
}
