//! Search for spatial and temporal duals that balance a fixed force of the data, for a lower bound.
//!
//! The duals of an iterate balance the force of its data only approximately. With that force fixed, a
//! few cheap steps on these duals alone, without products with the basis, reduce the error
//! substantially: FISTA (Beck, Teboulle, *SIAM J. Imaging Sci.* 2 (2009) 183) on
//!
//! ```text
//! min  |e - p|^2 / 2,    e = f + D' q + D_t' q_t,    |q| and |q_t| within their balls times `larger`
//! ```
//!
//! where `p` is the part of the error that bounds absorb: the entire error of one sign if the image is
//! at its bound, otherwise the excess over a multiple of the distance to the bound.
//!
//! The caller may change `f` between steps ([`Flow::push`]), which keep their momentum.
//!
//! Over 300 lines because the steps on pairs, single rows and time share one layout and are inlined
//! into one function.

use super::float::Float;
use super::kernel::{LANES, PANEL, add_blocks, add_row, analyse, lanes, row, row_mut, synthesise};
use super::operators::{BLOCK, Operators};
use super::state::{PAD, State};
use super::sweep::differences;
use pulp::{Arch, Simd, WithSimd};

/// Duals and memory of the search.
#[derive(Debug, Clone)]
pub(crate) struct Flow<T> {
    stride: usize,
    /// Coefficients of the force, of its change, or of the error.
    pub(crate) coefficients: Vec<T>,
    force: Vec<T>,
    /// `e`, followed by [`PAD`] values.
    pub(crate) error: Vec<T>,
    pub(crate) dual: Vec<T>,
    ahead: Vec<T>,
    /// Preceded by [`PAD`] zeros.
    pub(crate) time_dual: Vec<T>,
    time_ahead: Vec<T>,
    links: Vec<T>,
    /// The current image.
    image: Vec<T>,
    /// Number from which the next extrapolation is computed.
    momentum: f64,
}

/// Radii, bounds and number of steps.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Boxes {
    pub(crate) steps: usize,
    /// Number of ranks of the error that are computed; 0 for none.
    pub(crate) ranks: usize,
    /// Force per image towards which the error is moved, see [`super::certificate`].
    pub(crate) lean: f64,
    pub(crate) lambda_space: f64,
    pub(crate) lambda_time: f64,
    pub(crate) bounds: Option<[f64; 2]>,
    /// Threshold of the error for a bound to absorb it, per distance of the image from the bound.
    pub(crate) per_image: f64,
}

impl Boxes {
    /// Returns the largest positive and the most negative error that the bounds do not absorb where the
    /// image is `x`.
    pub(crate) fn limits(&self, x: f64) -> [f64; 2] {
        let Some([lower, upper]) = self.bounds else { return [f64::INFINITY, f64::NEG_INFINITY] };
        let room = |distance: f64| if distance == 0.0 { 0.0 } else { self.per_image * distance };
        [room(x - lower), room(x - upper)]
    }
}

impl<T: Float> Flow<T> {
    pub(crate) fn new(ops: &Operators<T>, state: &State<T>) -> Self {
        let values = ops.unknowns.next_multiple_of(BLOCK) * state.stride;
        let zeros = |count: usize| vec![T::default(); count];
        Self {
            stride: state.stride,
            coefficients: zeros(ops.padded_rank * state.stride),
            force: zeros(values),
            error: zeros(values + PAD),
            dual: zeros(state.dual.len()),
            ahead: zeros(state.dual.len()),
            time_dual: zeros(state.time_dual.len()),
            time_ahead: zeros(state.time_dual.len()),
            links: zeros(state.stride),
            image: zeros(values),
            momentum: 1.0,
        }
    }

    /// Starts from the duals of an iterate and the force `V F y` of `coefficients`; `image` is clipped to the
    /// bounds.
    pub(crate) fn start(
        &mut self,
        arch: Arch,
        ops: &Operators<T>,
        state: &State<T>,
        image: &[f64],
        how: Boxes,
    ) {
        self.image.iter_mut().zip(image).for_each(|(to, x)| *to = T::from_f64(*x));
        self.links.copy_from_slice(&state.links);
        self.dual.copy_from_slice(&state.dual);
        self.time_dual.copy_from_slice(&state.time_dual);
        self.momentum = 1.0;
        self.force.fill(T::default());
        arch.dispatch(Push { flow: self, ops, ranks: ops.padded_rank });
        arch.dispatch(Begin(Seek { flow: self, ops, how }));
    }

    /// Takes the steps of `how` and computes the coefficients `V' e` of the error that bounds do not absorb.
    pub(crate) fn advance(&mut self, arch: Arch, ops: &Operators<T>, how: Boxes) {
        arch.dispatch(Seek { flow: self, ops, how });
    }

    /// Adds `V c` to the force, with the first `ranks` of `coefficients`.
    pub(crate) fn push(&mut self, arch: Arch, ops: &Operators<T>, ranks: usize) {
        arch.dispatch(Push { flow: self, ops, ranks });
    }

    /// Computes the error of the duals, without extrapolation.
    pub(crate) fn finish(&mut self, arch: Arch, ops: &Operators<T>, how: Boxes) {
        self.swap_ahead();
        arch.dispatch(Finish(Seek { flow: self, ops, how }));
        self.swap_ahead();
    }

    fn swap_ahead(&mut self) {
        std::mem::swap(&mut self.ahead, &mut self.dual);
        std::mem::swap(&mut self.time_ahead, &mut self.time_dual);
    }
}

/// Adds the force of the coefficients.
struct Push<'a, T> {
    flow: &'a mut Flow<T>,
    ops: &'a Operators<T>,
    ranks: usize,
}

impl<T: Float> WithSimd for Push<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { flow, ops, ranks } = self;
        let (stride, rank) = (flow.stride, ops.padded_rank);
        for block in 0..ops.ready.len() {
            let own = &mut flow.force[block * BLOCK * stride..][..BLOCK * stride];
            let basis = &ops.basis[block * BLOCK / PANEL * rank..][..BLOCK / PANEL * rank];
            synthesise(simd, basis, rank, 0..ranks, &flow.coefficients, stride, own);
        }
    }
}

struct Seek<'a, T> {
    flow: &'a mut Flow<T>,
    ops: &'a Operators<T>,
    how: Boxes,
}

impl<T: Float> WithSimd for Seek<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        for _ in 0..self.how.steps {
            let t = self.flow.momentum;
            let next = 0.5 * (1.0 + (1.0 + 4.0 * t * t).sqrt());
            self.step(T::from_f64((t - 1.0) / next));
            self.flow.momentum = next;
        }
        if self.how.ranks > 0 {
            self.analyse_error(simd);
        }
    }
}

/// Projects the first duals onto their balls.
struct Begin<'a, T>(Seek<'a, T>);

impl<T: Float> WithSimd for Begin<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _: S) {
        self.0.begin();
    }
}

/// Computes the error of the last duals.
struct Finish<'a, T>(Seek<'a, T>);

impl<T: Float> WithSimd for Finish<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _: S) {
        for block in 0..self.0.ops.ready.len() {
            self.0.pull(block, false, T::default());
        }
    }
}

impl<T: Float> Seek<'_, T> {
    #[inline(always)]
    fn begin(&mut self) {
        let Self { flow, ops, how } = self;
        let stride = flow.stride;
        let space = T::from_f64(how.lambda_space);
        for (index, rows) in flow.dual.chunks_exact_mut(ops.components * stride).enumerate() {
            let radius = space * ops.radius[index];
            let (first, second) = rows.split_at_mut(stride);
            shrink_into(first, second, radius);
        }
        let time = T::from_f64(how.lambda_time);
        if !flow.time_dual.is_empty() {
            let rows = flow.time_dual[PAD..].chunks_exact_mut(stride).zip(&ops.time_radius);
            for (row, radius) in rows {
                for (q, link) in row.iter_mut().zip(&flow.links) {
                    let limit = time * *radius * *link;
                    *q = q.min(limit).max(T::default() - limit);
                }
            }
        }
        flow.ahead.copy_from_slice(&flow.dual);
        flow.time_ahead.copy_from_slice(&flow.time_dual);
    }

    /// Computes `V' e` of the extrapolated duals.
    #[inline(always)]
    fn analyse_error<S: Simd>(&mut self, simd: S) {
        let (stride, ops) = (self.flow.stride, self.ops);
        let rank = ops.padded_rank;
        self.flow.coefficients.fill(T::default());
        for block in 0..ops.ready.len() {
            self.pull(block, true, T::default());
            let flow = &mut *self.flow;
            let own = &flow.error[block * BLOCK * stride..][..BLOCK * stride];
            let basis = &ops.basis[block * BLOCK / PANEL * rank..][..BLOCK / PANEL * rank];
            let ranks = 0..self.how.ranks;
            analyse(simd, basis, rank, ranks, own, stride, &mut flow.coefficients);
        }
    }

    #[inline(always)]
    fn step(&mut self, momentum: T) {
        let (mut groups, ops) = (0, self.ops);
        let lean = T::from_f64(self.how.lean);
        for (block, ready) in ops.ready.iter().enumerate() {
            self.pull(block, true, lean);
            for group in groups..ready.groups {
                if ops.components == 2 {
                    self.pair(group, momentum);
                } else {
                    self.single(group, momentum);
                }
            }
            if !self.flow.time_dual.is_empty() {
                for p in block * BLOCK..((block + 1) * BLOCK).min(ops.unknowns) {
                    self.time(p, momentum);
                }
            }
            groups = ready.groups;
        }
    }

    /// Computes the error of the extrapolated duals on a block, less `lean` times the image; with `soft`, the
    /// part that bounds do not absorb.
    #[inline(always)]
    fn pull(&mut self, block: usize, soft: bool, lean: T) {
        let stride = self.flow.stride;
        for p in block * BLOCK..((block + 1) * BLOCK).min(self.ops.unknowns) {
            let mut offset = 0;
            while offset < stride {
                offset += match stride - offset {
                    24.. => self.pull_blocks::<3>(p, offset, soft, lean),
                    16.. => self.pull_blocks::<2>(p, offset, soft, lean),
                    _ => self.pull_blocks::<1>(p, offset, soft, lean),
                };
            }
        }
    }

    /// [`Seek::pull`] of an unknown on `B` blocks of frames, which stay in registers; returns their number of
    /// frames.
    #[inline(always)]
    fn pull_blocks<const B: usize>(
        &mut self,
        unknown: usize,
        offset: usize,
        soft: bool,
        lean: T,
    ) -> usize {
        let Self { flow, ops, how } = self;
        let (at, one) = (unknown * flow.stride + offset, T::from_f64(1.0));
        let mut sums = [[T::default(); LANES]; B];
        sums.copy_from_slice(row(&flow.force, at, B * LANES));
        for (r, value) in ops.divergence.row(unknown) {
            add_blocks(value, &flow.ahead, r * flow.stride + offset, &mut sums);
        }
        if !flow.time_ahead.is_empty() {
            add_blocks(T::default() - one, &flow.time_ahead, PAD + at, &mut sums);
            add_blocks(one, &flow.time_ahead, PAD + at - 1, &mut sums);
        }
        if let (Some(bounds), true) = (how.bounds, soft) {
            let [lower, upper] = bounds.map(T::from_f64);
            let (per_image, zero) = (T::from_f64(how.per_image), T::default());
            for (e, x) in sums.iter_mut().zip(row(&flow.image, at, B * LANES)) {
                *e = lanes(|l| {
                    let most = per_image * (x[l] - lower).max(zero);
                    let least = per_image * (x[l] - upper).min(zero);
                    e[l].min(most).max(least)
                });
            }
        }
        if lean > T::default() {
            add_blocks(T::default() - lean, &flow.image, at, &mut sums);
        }
        row_mut(&mut flow.error, at, B * LANES).copy_from_slice(&sums);
        B * LANES
    }

    #[inline(always)]
    fn pair(&mut self, index: usize, momentum: T) {
        let Self { flow, ops, how } = self;
        let stride = flow.stride;
        let group = &ops.groups[index];
        let radius = T::from_f64(how.lambda_space) * ops.radius[index];
        let step = step_size(ops, &flow.time_dual);
        let rows = group.unknowns.map(|p| row(&flow.error, p as usize * stride, stride));
        let duals = &mut flow.dual[2 * index * stride..][..2 * stride];
        let (a, b) = duals.split_at_mut(stride);
        let duals = a.as_chunks_mut::<LANES>().0.iter_mut().zip(b.as_chunks_mut::<LANES>().0);
        let aheads = &mut flow.ahead[2 * index * stride..][..2 * stride];
        let (c, d) = aheads.split_at_mut(stride);
        let aheads = c.as_chunks_mut::<LANES>().0.iter_mut().zip(d.as_chunks_mut::<LANES>().0);
        for (k, ((a, b), (c, d))) in duals.zip(aheads).enumerate() {
            let [da, db] = differences(group, [&rows[0][k], &rows[1][k], &rows[2][k]]);
            let up_a = add_row(T::default() - step, &da, *c);
            let up_b = add_row(T::default() - step, &db, *d);
            let shrink: [T; LANES] = lanes(|l| {
                let norm = up_a[l].mul_add(up_a[l], up_b[l] * up_b[l]).sqrt();
                radius / norm.max(radius)
            });
            let new_a: [T; LANES] = lanes(|l| up_a[l] * shrink[l]);
            let new_b: [T; LANES] = lanes(|l| up_b[l] * shrink[l]);
            advance(a, c, new_a, momentum);
            advance(b, d, new_b, momentum);
        }
    }

    #[inline(always)]
    fn single(&mut self, index: usize, momentum: T) {
        let Self { flow, ops, how } = self;
        let stride = flow.stride;
        let group = &ops.groups[index];
        let radius = T::from_f64(how.lambda_space) * ops.radius[index];
        let step = step_size(ops, &flow.time_dual);
        let rows = group.unknowns.map(|p| row(&flow.error, p as usize * stride, stride));
        let duals = row_mut(&mut flow.dual, index * stride, stride);
        let aheads = row_mut(&mut flow.ahead, index * stride, stride);
        for (k, (q, ahead)) in duals.iter_mut().zip(aheads).enumerate() {
            let [d, _] = differences(group, [&rows[0][k], &rows[1][k], &rows[2][k]]);
            let up = add_row(T::default() - step, &d, *ahead);
            let new: [T; LANES] = lanes(|l| up[l].min(radius).max(T::default() - radius));
            advance(q, ahead, new, momentum);
        }
    }

    #[inline(always)]
    fn time(&mut self, unknown: usize, momentum: T) {
        let Self { flow, ops, how } = self;
        let stride = flow.stride;
        let at = unknown * stride;
        let here = row(&flow.error, at, stride);
        let after = row(&flow.error, at + 1, stride);
        let links = row(&flow.links, 0, stride);
        let radius = T::from_f64(how.lambda_time) * ops.time_radius[unknown];
        let step = step_size(ops, &flow.time_dual);
        let duals = row_mut(&mut flow.time_dual, PAD + at, stride);
        let aheads = row_mut(&mut flow.time_ahead, PAD + at, stride);
        let rows = links.iter().zip(here.iter().zip(after));
        for ((q, ahead), (links, (here, after))) in duals.iter_mut().zip(aheads).zip(rows) {
            let new: [T; LANES] = lanes(|l| {
                let limit = radius * links[l];
                let up = (T::default() - step).mul_add(after[l] - here[l], ahead[l]);
                up.min(limit).max(T::default() - limit)
            });
            advance(q, ahead, new, momentum);
        }
    }
}

/// Updates a dual and its extrapolation by momentum.
#[inline(always)]
fn advance<T: Float>(q: &mut [T; LANES], ahead: &mut [T; LANES], new: [T; LANES], momentum: T) {
    *ahead = lanes(|l| momentum.mul_add(new[l] - q[l], new[l]));
    *q = new;
}

/// Returns the step size `1 / |[D; D_t]|^2`.
#[inline(always)]
fn step_size<T: Float>(ops: &Operators<T>, time_dual: &[T]) -> T {
    let time = if time_dual.is_empty() { 0.0 } else { 4.0 };
    T::from_f64(1.0 / (ops.norm_squared + time).max(1.0))
}

#[inline(always)]
fn shrink_into<T: Float>(first: &mut [T], second: &mut [T], radius: T) {
    if second.is_empty() {
        first.iter_mut().for_each(|q| *q = q.min(radius).max(T::default() - radius));
        return;
    }
    for (a, b) in first.iter_mut().zip(second) {
        let norm = a.mul_add(*a, *b * *b).sqrt();
        let factor = radius / norm.max(radius);
        (*a, *b) = (*a * factor, *b * factor);
    }
}
