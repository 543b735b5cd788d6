//! Passes of one iteration over all unknowns, see `engine`.
//!
//! Over 300 lines because the steps of one sweep share one layout and are inlined into one function.

use super::chain::Chain;
use super::float::Float;
use super::kernel::{LANES, PANEL, add_blocks, add_row, analyse, lanes, row, row_mut, synthesise};
use super::operators::{BLOCK, Group, Operators};
use super::state::{PAD, RHO, State, Weights};
use pulp::{Simd, WithSimd};

/// [`Weights`] in the floating-point type of the iteration.
pub(super) struct Scaled<T> {
    pub(super) rho: T,
    pub(super) space: T,
    pub(super) time: T,
    pub(super) bounds: Option<[T; 2]>,
    pub(super) smoothing: T,
    /// Positive, but smaller than every non-zero radius.
    tiny: T,
}

impl<T: Float> Scaled<T> {
    pub(super) fn new(weights: &Weights) -> Self {
        Self {
            rho: T::from_f64(RHO),
            space: T::from_f64(weights.lambda_space),
            time: T::from_f64(weights.lambda_time),
            bounds: weights.bounds.map(|b| b.map(T::from_f64)),
            smoothing: T::from_f64(weights.smoothing),
            tiny: T::from_f64(f64::from(f32::MIN_POSITIVE)),
        }
    }
}

/// Computes the image coefficients of the tail.
pub(super) struct Analyse<'a, T> {
    pub(super) state: &'a mut State<T>,
    pub(super) ops: &'a Operators<T>,
}

impl<T: Float> WithSimd for Analyse<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { state, ops } = self;
        let (rank, stride) = (ops.padded_rank, state.stride);
        state.next.fill(T::default());
        let blocks = ops.basis.chunks_exact(BLOCK / PANEL * rank);
        for (basis, image) in blocks.zip(state.image.chunks_exact(BLOCK * stride)) {
            analyse(simd, basis, rank, state.head..rank, image, stride, &mut state.next);
        }
    }
}

/// Computes the force of the tail on all unknowns.
pub(super) struct Pull<'a, T> {
    pub(super) state: &'a mut State<T>,
    pub(super) ops: &'a Operators<T>,
}

impl<T: Float> WithSimd for Pull<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { state, ops } = self;
        let rank = ops.padded_rank;
        state.tail.fill(T::default());
        let range = state.head..rank;
        synthesise(simd, &ops.basis, rank, range, &state.next, state.stride, &mut state.tail);
    }
}

/// Computes the force of the duals and the coefficients of `w` for a first iteration.
pub(super) struct Descend<'a, T> {
    pub(super) state: &'a mut State<T>,
    pub(super) ops: &'a Operators<T>,
}

impl<T: Float> WithSimd for Descend<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { state, ops } = self;
        state.next.fill(T::default());
        for block in 0..ops.ready.len() {
            descend(simd, state, ops, block);
        }
        std::mem::swap(&mut state.coefficients, &mut state.next);
    }
}

/// Computes the force of the duals on a block and adds the contribution of its `w` to the coefficients.
#[inline(always)]
fn descend<T: Float, S: Simd>(simd: S, state: &mut State<T>, ops: &Operators<T>, block: usize) {
    let (stride, blocks) = (state.stride, state.stride / LANES);
    let first = block * BLOCK;
    for p in first..(first + BLOCK).min(ops.unknowns) {
        gather_force(state, ops, p);
        let own = p * stride;
        let images = row(&state.image, own, stride).iter().zip(row(&state.work, own, stride));
        let rows = row_mut(&mut state.block, (p - first) * stride, stride).iter_mut();
        let taus = &state.tau[p * blocks..][..blocks];
        for ((w, (x, force)), tau) in rows.zip(images).zip(taus) {
            *w = add_row(T::default() - *tau, force, *x);
        }
    }
    let basis = &ops.basis[first / PANEL * ops.padded_rank..];
    let basis = &basis[..BLOCK / PANEL * ops.padded_rank];
    analyse(simd, basis, ops.padded_rank, 0..state.head, &state.block, stride, &mut state.next);
}

/// Computes `D' q + D_t' q_t + p + tail` of an unknown.
#[inline(always)]
fn gather_force<T: Float>(state: &mut State<T>, ops: &Operators<T>, unknown: usize) {
    let stride = state.stride;
    let mut offset = 0;
    while offset < stride {
        offset += match stride - offset {
            24.. => force::<T, 3>(state, ops, unknown, offset),
            16.. => force::<T, 2>(state, ops, unknown, offset),
            _ => force::<T, 1>(state, ops, unknown, offset),
        };
    }
}

/// Computes the force on `B` blocks of frames, which stay in registers; returns their number of frames.
#[inline(always)]
fn force<T: Float, const B: usize>(
    state: &mut State<T>,
    ops: &Operators<T>,
    unknown: usize,
    offset: usize,
) -> usize {
    let mut sums = [[T::default(); LANES]; B];
    for (r, value) in ops.divergence.row(unknown) {
        add_blocks(value, &state.dual, r * state.stride + offset, &mut sums);
    }
    let at = unknown * state.stride + offset;
    let one = T::from_f64(1.0);
    if !state.time_dual.is_empty() {
        // The value before the first frame is the zero at the end of the previous row. Two separate
        // additions, because the compiler would combine overlapping loads with shuffles.
        add_blocks(T::default() - one, &state.time_dual, PAD + at, &mut sums);
        add_blocks(one, &state.time_dual, PAD + at - 1, &mut sums);
    }
    if !state.bound_dual.is_empty() {
        add_blocks(one, &state.bound_dual, at, &mut sums);
    }
    if state.head < ops.padded_rank {
        add_blocks(one, &state.tail, at, &mut sums);
    }
    row_mut(&mut state.work, at, B * LANES).copy_from_slice(&sums);
    B * LANES
}

/// Updates the image from the fitted coefficients, all duals, and the next `w` with its coefficients.
pub(super) struct Sweep<'a, T> {
    pub(super) state: &'a mut State<T>,
    pub(super) ops: &'a Operators<T>,
    pub(super) steps: &'a Scaled<T>,
    pub(super) keep: bool,
}

impl<T: Float> WithSimd for Sweep<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { state, ops, steps, keep } = self;
        state.next.fill(T::default());
        let (mut groups, mut blocks) = (0, 0);
        for (block, ready) in ops.ready.iter().enumerate() {
            ascend(simd, state, ops, steps, block, keep);
            for group in groups..ready.groups {
                if ops.components == 2 {
                    pair_step(state, ops, steps, group);
                } else {
                    single_step(state, ops, steps, group);
                }
            }
            for block in blocks..ready.blocks {
                descend(simd, state, ops, block);
            }
            (groups, blocks) = (ready.groups, ready.blocks);
        }
    }
}

/// Updates the image of a block and its duals of time and bounds.
#[inline(always)]
fn ascend<T: Float, S: Simd>(
    simd: S,
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
    synthesise(simd, basis, ops.padded_rank, 0..state.head, &state.coefficients, stride, work);
    let blocks = stride / LANES;
    let taus = state.tau[first * blocks..].chunks_exact(blocks);
    let rows = work.chunks_exact_mut(stride).zip(state.image[own.clone()].chunks_exact_mut(stride));
    let candidates = state.candidate[own.clone()].chunks_exact_mut(stride);
    for (((force, image), taus), candidate) in rows.zip(taus).zip(candidates) {
        if keep {
            descend_by(image, force, taus, candidate);
        }
        extrapolate(image, force, taus, steps.rho);
    }
    if let Some(mut chain) = state.chain.take() {
        for p in first..(first + BLOCK).min(ops.unknowns) {
            chain_step(state, ops, steps, p, &mut chain);
        }
        state.chain = Some(chain);
        return;
    }
    if let Some(bounds) = steps.bounds {
        let per_cell = T::from_f64(state.split[2] / state.split[1]);
        let sigmas = state.cell_sigma[first * blocks..].chunks_exact(blocks);
        let duals = state.bound_dual[own.clone()].chunks_exact_mut(stride);
        let rows = state.work[own].chunks_exact(stride);
        for ((duals, row), sigmas) in duals.zip(rows).zip(sigmas) {
            bound_step(duals, row, &state.present, sigmas, per_cell, bounds, steps.rho);
        }
    }
    if !state.time_dual.is_empty() {
        for p in first..(first + BLOCK).min(ops.unknowns) {
            time_step(state, ops, steps, p);
        }
    }
}

/// Computes `x - tau force` of a row.
#[inline(always)]
fn descend_by<T: Float>(image: &[T], force: &[T], taus: &[T], out: &mut [T]) {
    let rows = image.as_chunks::<LANES>().0.iter().zip(force.as_chunks::<LANES>().0);
    for ((out, (x, f)), tau) in out.as_chunks_mut::<LANES>().0.iter_mut().zip(rows).zip(taus) {
        *out = add_row(T::default() - *tau, f, *x);
    }
}

/// Replaces the force on a row of the image `x` by `2 x^ - x` with `x^ = x - tau force`, and relaxes
/// `x`.
#[inline(always)]
fn extrapolate<T: Float>(image: &mut [T], force: &mut [T], taus: &[T], rho: T) {
    let images = image.as_chunks_mut::<LANES>().0;
    for ((x, f), tau) in images.iter_mut().zip(force.as_chunks_mut::<LANES>().0).zip(taus) {
        let change: [T; LANES] = lanes(|l| T::default() - *tau * f[l]);
        *f = lanes(|l| x[l] + change[l] + change[l]);
        *x = lanes(|l| rho.mul_add(change[l], x[l]));
    }
}

#[inline(always)]
fn bound_step<T: Float>(
    duals: &mut [T],
    row: &[T],
    present: &[T],
    sigmas: &[T],
    per_cell: T,
    bounds: [T; 2],
    rho: T,
) {
    let duals = duals.as_chunks_mut::<LANES>().0;
    let rows = row.as_chunks::<LANES>().0.iter().zip(present.as_chunks::<LANES>().0);
    for ((p, (b, present)), sigma) in duals.iter_mut().zip(rows).zip(sigmas) {
        let sigma = per_cell * *sigma;
        *p = lanes(|l| {
            let up = sigma.mul_add(b[l], p[l]);
            // zero between the bounds; avoids a division by sigma
            let new = (up - sigma * bounds[1]).max((up - sigma * bounds[0]).min(T::default()));
            present[l] * rho.mul_add(new - p[l], p[l])
        });
    }
}

/// Updates the duals of time and bounds of an unknown together, see [`super::chain`].
#[inline(always)]
fn chain_step<T: Float>(
    state: &mut State<T>,
    ops: &Operators<T>,
    steps: &Scaled<T>,
    unknown: usize,
    chain: &mut Chain<T>,
) {
    let (stride, frames, blocks) = (state.stride, state.frames, state.stride / LANES);
    let at = unknown * stride;
    let sigmas = &state.cell_sigma[unknown * blocks..][..blocks];
    let duals = &state.time_dual[PAD + at - 1..][..frames + 1];
    let image = &state.work[at..][..frames];
    for (t, x) in image.iter().enumerate() {
        let (sigma, own) = (sigmas[t / LANES], duals[t] - duals[t + 1]);
        chain.weights[t] = sigma;
        chain.data[t] = sigma.mul_add(*x, own);
    }
    if steps.bounds.is_some() {
        let duals = &state.bound_dual[at..][..frames];
        chain.data.iter_mut().zip(duals).for_each(|(v, p)| *v += *p);
    }
    chain.pull(steps.time * ops.time_radius[unknown], &state.links);
    let duals = &mut state.time_dual[PAD + at..][..frames];
    for (q, new) in duals.iter_mut().zip(&chain.dual) {
        *q = steps.rho.mul_add(*new - *q, *q);
    }
    if let Some([lower, upper]) = steps.bounds {
        let duals = &mut state.bound_dual[at..][..frames];
        for ((p, u), sigma) in duals.iter_mut().zip(&chain.slopes).zip(&chain.weights) {
            let new = *sigma * (*u - u.max(lower).min(upper));
            *p = steps.rho.mul_add(new - *p, *p);
        }
    }
}

#[inline(always)]
fn time_step<T: Float>(
    state: &mut State<T>,
    ops: &Operators<T>,
    steps: &Scaled<T>,
    unknown: usize,
) {
    let (stride, blocks) = (state.stride, state.stride / LANES);
    let at = unknown * stride;
    let here = row(&state.work, at, stride);
    // the value read beyond the end of the row belongs to a frame without a link
    let after = row(&state.work, at + 1, stride);
    let links = row(&state.links, 0, stride);
    let radius = steps.time * ops.time_radius[unknown];
    let sigmas = &state.cell_sigma[unknown * blocks..][..blocks];
    let duals = row_mut(&mut state.time_dual, PAD + at, stride);
    let rows = duals.iter_mut().zip(links).zip(here.iter().zip(after));
    for (block, ((q, links), (here, after))) in rows.enumerate() {
        // the last link connects to the next block
        let next = sigmas[(block + 1).min(blocks - 1)];
        let mut sigma = [sigmas[block]; LANES];
        sigma[LANES - 1] = sigma[0].min(next);
        *q = lanes(|l| {
            let limit = radius * links[l];
            let up = sigma[l].mul_add(after[l] - here[l], q[l]);
            let norm = up.abs().max(sigma[l].mul_add(steps.smoothing, limit)).max(steps.tiny);
            steps.rho.mul_add(up * (limit / norm) - q[l], q[l])
        });
    }
}

/// Returns the differences of a group, one array per component.
#[inline(always)]
pub(crate) fn differences<T: Float>(group: &Group<T>, rows: [&[T; LANES]; 3]) -> [[T; LANES]; 2] {
    // not `map`, because its closure would be compiled for the baseline instruction set
    let component = |w: &[T; 3]| {
        let first = lanes(|l| w[0] * rows[0][l]);
        add_row(w[2], rows[2], add_row(w[1], rows[1], first))
    };
    [component(&group.weights[0]), component(&group.weights[1])]
}

/// Returns the rows of a group's unknowns.
#[inline(always)]
fn group_rows<'a, T: Float>(
    work: &'a [T],
    group: &Group<T>,
    stride: usize,
) -> [&'a [[T; LANES]]; 3] {
    group.unknowns.map(|p| row(work, p as usize * stride, stride))
}

#[inline(always)]
fn pair_step<T: Float>(state: &mut State<T>, ops: &Operators<T>, steps: &Scaled<T>, index: usize) {
    let (stride, blocks) = (state.stride, state.stride / LANES);
    let group = &ops.groups[index];
    let radius = steps.space * ops.radius[index];
    let [first, second, third] = group_rows(&state.work, group, stride);
    let sigmas = &state.group_sigma[index * blocks..][..blocks];
    let duals = &mut state.dual[2 * index * stride..][..2 * stride];
    let (a, b) = duals.split_at_mut(stride);
    let duals = a.as_chunks_mut::<LANES>().0.iter_mut().zip(b.as_chunks_mut::<LANES>().0);
    let rows = first.iter().zip(second).zip(third).zip(sigmas);
    for ((a, b), (((first, second), third), &sigma)) in duals.zip(rows) {
        let [da, db] = differences(group, [first, second, third]);
        let up_a = add_row(sigma, &da, *a);
        let up_b = add_row(sigma, &db, *b);
        let least = sigma.mul_add(steps.smoothing, radius);
        let shrink = lanes(|l| {
            let norm = up_a[l].mul_add(up_a[l], up_b[l] * up_b[l]).sqrt();
            radius / norm.max(least)
        });
        let relax = |up: [T; LANES], old: [T; LANES]| {
            lanes(|l| steps.rho.mul_add(up[l] * shrink[l] - old[l], old[l]))
        };
        *a = relax(up_a, *a);
        *b = relax(up_b, *b);
    }
}

#[inline(always)]
fn single_step<T: Float>(
    state: &mut State<T>,
    ops: &Operators<T>,
    steps: &Scaled<T>,
    index: usize,
) {
    let (stride, blocks) = (state.stride, state.stride / LANES);
    let group = &ops.groups[index];
    let radius = steps.space * ops.radius[index];
    let [first, second, third] = group_rows(&state.work, group, stride);
    let sigmas = &state.group_sigma[index * blocks..][..blocks];
    let duals = row_mut(&mut state.dual, index * stride, stride);
    let rows = first.iter().zip(second).zip(third).zip(sigmas);
    for (q, (((first, second), third), &sigma)) in duals.iter_mut().zip(rows) {
        let [d, _] = differences(group, [first, second, third]);
        let least = sigma.mul_add(steps.smoothing, radius);
        *q = lanes(|l| {
            let up = sigma.mul_add(d[l], q[l]);
            let shrink = radius / up.abs().max(least);
            steps.rho.mul_add(up * shrink - q[l], q[l])
        });
    }
}
