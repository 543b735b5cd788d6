//! Search for duals of space and time that balance a fixed force `f = A' y` of the data, for a lower bound.
//!
//! The duals of an iterate balance the force of its data only approximately. With that force fixed, a few cheap steps
//! on these duals alone, without products with the basis, reduce the error substantially: accelerated gradient steps
//! (Beck, Teboulle, *SIAM J. Imaging Sci.* 2 (2009) 183) on
//!
//! ```text
//! min  |h(e)|^2 / 2,    e = f + D' q + D_t' q_t,    |q| and |q_t| within their balls times `larger`
//! ```
//!
//! where `h` is the part of the error that anchor and bounds do not absorb: they absorb `lambda_anchor area` of either
//! sign, and the entire error of one sign if the image is at its bound, otherwise the excess over `mu` times the
//! distance to the bound. With a shift `mu` about an image, the steps make `h(e)` equal to a small multiple of the
//! image instead: this is a step of the proximal method of multipliers, which aligns the flows with the gradients of
//! the image,
//!
//! ```text
//! mu d+ = clip(soft(mu d - e, lambda_anchor area), mu room),   h = -mu x+,   x+ = x^ + d+
//! ```
//!
//! The caller may change `f` between steps ([`Flow::push`]), which keep their momentum.

use super::differences::{Differences, for_basis};
use super::lanes::{LANES, Lane, Project, clip, each, largest, load, shrink, splat, store};
use super::operators::Operators;
use super::problem::Problem;
use super::products::{Analyse, Expand};
use super::state::{State, TOGETHER};
use pulp::{Arch, Simd, WithSimd};

/// Duals and memory of the search.
#[derive(Debug, Clone)]
pub(crate) struct Flow<T: Project> {
    frames: usize,
    /// Coefficients of the force, of its change, or of the error, `[frame][padded rank]`.
    pub(crate) coefficients: Vec<f64>,
    z: Vec<T>,
    force: Vec<T>,
    /// `e`.
    pub(crate) error: Vec<T>,
    /// `q` and its extrapolation, by component.
    pub(crate) flow: [Vec<T>; 2],
    ahead: [Vec<T>; 2],
    /// `q_t`, as in [`State::links`].
    pub(crate) links: Vec<T>,
    links_ahead: Vec<T>,
    /// Image of the shift and of the distances to the bounds, and the anchor.
    image: Vec<T>,
    anchor: Vec<T>,
    sums: Vec<Lane<T>>,
    /// Number from which the next extrapolation is computed.
    momentum: f64,
}

/// Radii, bounds and shift.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Boxes {
    pub(crate) lambda_space: f64,
    pub(crate) lambda_time: f64,
    pub(crate) lambda_anchor: f64,
    pub(crate) bounds: Option<[f64; 2]>,
    /// Error that a bound leaves, per distance of the image from it.
    pub(crate) mu: f64,
    /// Force per image towards which the error is moved.
    pub(crate) shift: f64,
}

impl Boxes {
    /// Returns the largest positive and the most negative error that the bounds do not absorb where the
    /// image is `x`.
    pub(crate) fn limits(&self, x: f64) -> [f64; 2] {
        let Some([lower, upper]) = self.bounds else { return [f64::INFINITY, f64::NEG_INFINITY] };
        let room = |distance: f64| if distance == 0.0 { 0.0 } else { self.mu * distance };
        [room(x - lower), room(x - upper)]
    }
}

impl<T: Project> Flow<T> {
    pub(crate) fn new(ops: &Operators<T>, state: &State<T>, problem: &Problem<'_>) -> Self {
        let zeros = |count: usize| vec![T::default(); count];
        let (cells, groups) = (state.frames * state.cells, state.frames * state.groups);
        let pair = || [zeros(groups), zeros(groups)];
        Self {
            frames: state.frames,
            coefficients: vec![0.0; state.frames * ops.padded],
            z: zeros(state.frames * ops.padded),
            force: zeros(cells),
            error: zeros(cells),
            flow: pair(),
            ahead: pair(),
            links: state.links.clone(),
            links_ahead: state.links.clone(),
            image: zeros(cells),
            anchor: zeros(if problem.is_held() { cells } else { 0 }),
            sums: vec![[T::default(); LANES]; TOGETHER.min(state.frames) * ops.padded],
            momentum: 1.0,
        }
    }

    /// Starts from the duals of an iterate and the force `V c` of `coefficients`; `images` are within the bounds.
    pub(crate) fn start(
        &mut self,
        arch: Arch,
        ops: &Operators<T>,
        state: &State<T>,
        images: &[f64],
        how: Boxes,
    ) {
        for frame in 0..self.frames {
            for &cell in &ops.places.cells {
                let at = frame * ops.cells() + cell;
                self.image[at] = T::from_f64(images[at]);
            }
        }
        if !self.anchor.is_empty() {
            self.anchor.copy_from_slice(&state.origin);
        }
        for (own, q) in self.flow.iter_mut().zip(&state.flow) {
            own.copy_from_slice(q);
        }
        self.links.copy_from_slice(&state.links);
        self.momentum = 1.0;
        self.expand(arch, ops, ops.padded, false);
        for_basis!(arch, ops.basis, |differences| Begin(Seek {
            ops,
            differences,
            flow: &mut *self,
            how
        }));
    }

    /// Takes steps.
    pub(crate) fn advance(&mut self, arch: Arch, ops: &Operators<T>, how: Boxes, steps: usize) {
        for_basis!(arch, ops.basis, |differences| Advance(
            Seek { ops, differences, flow: &mut *self, how },
            steps
        ));
    }

    /// Computes the coefficients `V' h(e)` of the extrapolated duals.
    pub(crate) fn analyse(&mut self, arch: Arch, ops: &Operators<T>, how: Boxes, ranks: usize) {
        let how = Boxes { shift: 0.0, ..how };
        for_basis!(arch, ops.basis, |differences| Error(
            Seek { ops, differences, flow: &mut *self, how },
            true
        ));
        let Self { frames, error: x, sums, coefficients: out, .. } = self;
        arch.dispatch(Analyse { ops, frames: *frames, x, ranks, sums, out });
    }

    /// Adds the force of the first `ranks` of `coefficients`.
    pub(crate) fn push(&mut self, arch: Arch, ops: &Operators<T>, ranks: usize) {
        self.expand(arch, ops, ranks, true);
    }

    fn expand(&mut self, arch: Arch, ops: &Operators<T>, ranks: usize, add: bool) {
        let Self { frames, z, coefficients, force: out, .. } = self;
        z.iter_mut().zip(coefficients).for_each(|(z, c)| *z = T::from_f64(*c));
        arch.dispatch(Expand { ops, frames: *frames, ranks: 0..ranks, z, add, out });
    }

    /// Computes the error `e` of the last duals. Returns the largest ratio of a group's dual to its radius times
    /// `lambda_space`.
    pub(crate) fn finish(&mut self, arch: Arch, ops: &Operators<T>, how: Boxes) -> f64 {
        self.swap_ahead();
        for_basis!(arch, ops.basis, |differences| Error(
            Seek { ops, differences, flow: &mut *self, how },
            false
        ));
        self.swap_ahead();
        for_basis!(arch, ops.basis, |differences| Ratio(Seek {
            ops,
            differences,
            flow: &mut *self,
            how
        }))
    }

    fn swap_ahead(&mut self) {
        std::mem::swap(&mut self.ahead, &mut self.flow);
        std::mem::swap(&mut self.links_ahead, &mut self.links);
    }
}

struct Seek<'a, T: Project, D> {
    ops: &'a Operators<T>,
    differences: &'a D,
    flow: &'a mut Flow<T>,
    how: Boxes,
}

/// Takes a number of steps.
struct Advance<'a, T: Project, D>(Seek<'a, T, D>, usize);

impl<T: Project, D: Differences<T>> WithSimd for Advance<'_, T, D> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self(mut seek, steps) = self;
        for _ in 0..steps {
            let t = seek.flow.momentum;
            let next = 0.5 * (1.0 + (1.0 + 4.0 * t * t).sqrt());
            seek.flow.momentum = next;
            let momentum = T::from_f64((t - 1.0) / next);
            // the duals of a frame, and of its link to the frame before, act on errors that are computed already
            for frame in 0..seek.flow.frames {
                seek.pull_frame(frame, true);
                seek.step(frame, momentum);
            }
        }
    }
}

/// Computes the error of the extrapolated duals, or the part that anchor and bounds do not absorb.
struct Error<'a, T: Project, D>(Seek<'a, T, D>, bool);

impl<T: Project, D: Differences<T>> WithSimd for Error<'_, T, D> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self(mut seek, is_soft) = self;
        for frame in 0..seek.flow.frames {
            seek.pull_frame(frame, is_soft);
        }
    }
}

/// Projects the first duals onto their balls.
struct Begin<'a, T: Project, D>(Seek<'a, T, D>);

impl<T: Project, D: Differences<T>> WithSimd for Begin<'_, T, D> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Seek { ops, differences, flow, how } = self.0;
        let (space, time) = (T::from_f64(how.lambda_space), T::from_f64(how.lambda_time));
        let Flow { frames, flow: [first, second], ahead, links, links_ahead, .. } = flow;
        for base in (0..*frames).map(|frame| frame * ops.groups) {
            for &at in differences.group_blocks() {
                let (a, b) = (load(first, base + at), load(second, base + at));
                let radius = differences.group_radius(at);
                let radius = each(|l| space * radius[l]);
                let factor = shrink(a, b, radius, radius);
                store(first, base + at, each(|l| a[l] * factor[l]));
                store(second, base + at, each(|l| b[l] * factor[l]));
            }
        }
        if !links.is_empty() {
            for base in (1..*frames).map(|frame| frame * ops.cells()) {
                for &at in &ops.places.blocks {
                    let (q, radius) = (load(links, base + at), differences.cell_radius(at));
                    store(links, base + at, each(|l| clip(q[l], time * radius[l])));
                }
            }
        }
        ahead[0].copy_from_slice(first);
        ahead[1].copy_from_slice(second);
        links_ahead.copy_from_slice(links);
    }
}

/// Computes the largest ratio of a group's dual to its radius.
struct Ratio<'a, T: Project, D>(Seek<'a, T, D>);

impl<T: Project, D: Differences<T>> WithSimd for Ratio<'_, T, D> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let Seek { ops, differences, flow, how } = self.0;
        let space = T::from_f64(how.lambda_space);
        let mut most = splat(T::default());
        for base in (0..flow.frames).map(|frame| frame * ops.groups) {
            for &at in differences.group_blocks() {
                let (a, b) = (load(&flow.flow[0], base + at), load(&flow.flow[1], base + at));
                let radius = differences.group_radius(at);
                most = each(|l| {
                    let norm = a[l].mul_add(a[l], b[l] * b[l]).sqrt();
                    most[l].max(norm / (space * radius[l]))
                });
            }
        }
        largest(&most).to_f64()
    }
}

impl<T: Project, D: Differences<T>> Seek<'_, T, D> {
    #[inline(always)]
    fn pull_frame(&mut self, frame: usize, is_soft: bool) {
        match (self.flow.anchor.is_empty(), self.how.bounds) {
            (true, None) => self.pull::<false, false>(frame, is_soft),
            (true, Some(_)) => self.pull::<false, true>(frame, is_soft),
            (false, None) => self.pull::<true, false>(frame, is_soft),
            (false, Some(_)) => self.pull::<true, true>(frame, is_soft),
        }
    }

    /// Computes the error of the extrapolated duals in a frame, shifted; only the part that anchor and bounds do not
    /// absorb if it is soft.
    #[inline(always)]
    fn pull<const ANCHORED: bool, const BOUNDED: bool>(&mut self, frame: usize, is_soft: bool) {
        let Self { ops, differences, flow, how } = self;
        let Flow { force, error, ahead, links_ahead, image, anchor, .. } = &mut **flow;
        let (cells, groups) = (ops.cells(), ops.groups);
        let (base, own) = (frame * cells, frame * groups..(frame + 1) * groups);
        let q = [&ahead[0][own.clone()], &ahead[1][own]];
        let (mu, shift) = (T::from_f64(how.mu), T::from_f64(how.shift));
        let held = T::from_f64(how.lambda_anchor);
        let [lower, upper] = how.bounds.unwrap_or_default().map(T::from_f64);
        let zero = T::default();
        for (block, &at) in ops.places.blocks.iter().enumerate() {
            let here = base + at;
            let (divergence, f) = (differences.adjoint(q, block, at), load(force, here));
            let mut e = each(|l| f[l] + divergence[l]);
            if !links_ahead.is_empty() {
                let (own, next) = (load(links_ahead, here), load(links_ahead, here + cells));
                e = each(|l| e[l] + (own[l] - next[l]));
            }
            if !is_soft {
                store(error, here, e);
                continue;
            }
            let x = load(image, here);
            // distances to the bounds from the anchor while shifted, otherwise from the image, since the cost of a
            // bound's force is proportional to the distance from the bound
            let (mut centre, mut from) = (x, x);
            if ANCHORED {
                let radius = differences.cell_radius(at);
                centre = load(anchor, here);
                from = if shift > zero { centre } else { x };
                e = each(|l| {
                    let value = e[l] - shift * (x[l] - centre[l]);
                    value - clip(value, held * radius[l])
                });
            }
            if BOUNDED {
                e = each(|l| {
                    let most = mu * (from[l] - lower).max(zero);
                    let least = mu * (from[l] - upper).min(zero);
                    e[l].min(most).max(least)
                });
            }
            store(error, here, each(|l| e[l] - shift * centre[l]));
        }
    }

    /// Takes a gradient step on the flow of a frame and its link to the frame before.
    #[inline(always)]
    fn step(&mut self, frame: usize, momentum: T) {
        let Self { ops, differences, flow, how } = self;
        let Flow { error, flow, ahead, links, links_ahead, .. } = &mut **flow;
        let (cells, groups) = (ops.cells(), ops.groups);
        let norm = ops.norm_squared + if links.is_empty() { 0.0 } else { 4.0 };
        let step = T::from_f64(-1.0 / norm.max(1.0));
        let (space, time) = (T::from_f64(how.lambda_space), T::from_f64(how.lambda_time));
        let ([first, second], [next_first, next_second]) = (flow, ahead);
        let (base, own) = (frame * groups, &error[frame * cells..(frame + 1) * cells]);
        for &at in differences.group_blocks() {
            let [da, db] = differences.difference(own, at);
            let at_group = differences.group_radius(at);
            let here = base + at;
            let (a, b) = (load(next_first, here), load(next_second, here));
            let up_a = each(|l| step.mul_add(da[l], a[l]));
            let up_b = each(|l| step.mul_add(db[l], b[l]));
            let radius = each(|l| space * at_group[l]);
            let factor = shrink(up_a, up_b, radius, radius);
            let (a, b) = (each(|l| up_a[l] * factor[l]), each(|l| up_b[l] * factor[l]));
            let (old_a, old_b) = (load(first, here), load(second, here));
            store(next_first, here, each(|l| momentum.mul_add(a[l] - old_a[l], a[l])));
            store(next_second, here, each(|l| momentum.mul_add(b[l] - old_b[l], b[l])));
            store(first, here, a);
            store(second, here, b);
        }
        if frame == 0 || links.is_empty() {
            return;
        }
        for &at in &ops.places.blocks {
            let here = frame * cells + at;
            let (before, e) = (load(error, here - cells), load(error, here));
            let (old, q) = (load(links, here), load(links_ahead, here));
            let radius = differences.cell_radius(at);
            let new = each(|l| clip(step.mul_add(e[l] - before[l], q[l]), time * radius[l]));
            store(links_ahead, here, each(|l| momentum.mul_add(new[l] - old[l], new[l])));
            store(links, here, new);
        }
    }
}
