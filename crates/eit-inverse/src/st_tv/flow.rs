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
use super::duals::{Duals, convert};
use super::lanes::{LANES, Lane, Project, clip, each, load, shrink, store};
use super::operators::Operators;
use super::problem::Problem;
use super::state::{State, TOGETHER};

/// Duals and memory of the search.
#[derive(Debug, Clone)]
pub(crate) struct Flow<T: Project> {
    frames: usize,
    how: Boxes,
    /// Coefficients of the force, of its change, or of the error, `[frame][padded rank]`.
    pub(crate) coefficients: Vec<f64>,
    z: Vec<T>,
    force: Vec<T>,
    /// `e`.
    pub(crate) error: Vec<T>,
    /// `q` and `q_t`, and their extrapolation.
    pub(crate) duals: Duals<T>,
    ahead: Duals<T>,
    /// Image of the shift and of the distances to the bounds, and the anchor.
    image: Vec<T>,
    anchor: Vec<T>,
    sums: Vec<Lane<T>>,
    /// Number from which the next extrapolation is computed.
    momentum: f64,
}

/// Radii and bounds.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Boxes {
    pub(crate) lambda_space: f64,
    pub(crate) lambda_time: f64,
    pub(crate) lambda_anchor: f64,
    pub(crate) bounds: Option<[f64; 2]>,
    /// Error that a bound leaves, per distance of the image from it.
    pub(crate) mu: f64,
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
    pub(crate) fn new(ops: &Operators<T>, problem: &Problem<'_>) -> Self {
        let frames = problem.frames();
        let zeros = |count: usize| vec![T::default(); count];
        let (cells, ranks) = (frames * ops.cells(), frames * ops.padded);
        Self {
            frames,
            how: Boxes::default(),
            coefficients: vec![0.0; ranks],
            z: zeros(ranks),
            force: zeros(cells),
            error: zeros(cells),
            duals: Duals::new(ops, problem, false),
            ahead: Duals::new(ops, problem, false),
            image: zeros(cells),
            anchor: zeros(if problem.is_held() { cells } else { 0 }),
            sums: vec![[T::default(); LANES]; TOGETHER.min(frames) * ops.padded],
            momentum: 1.0,
        }
    }

    /// Starts from the duals of an iterate and the force `V c` of `coefficients`; `images` are within the bounds.
    pub(crate) fn start(
        &mut self,
        ops: &Operators<T>,
        state: &State<T>,
        images: &[f64],
        how: Boxes,
    ) {
        self.how = how;
        convert(images, 1.0, &mut self.image);
        if !self.anchor.is_empty() {
            self.anchor.copy_from_slice(&state.origin);
        }
        self.momentum = 1.0;
        self.push(ops, ops.padded, false);
        // a step without error projects the duals onto their balls
        self.ahead.take(&state.duals, 1.0);
        self.error.fill(T::default());
        for_basis!(ops, |differences| {
            for frame in 0..self.frames {
                self.step(ops, differences, frame, T::default());
            }
        });
    }

    /// Takes steps; the error is moved towards `shift` times the image.
    pub(crate) fn advance(&mut self, ops: &Operators<T>, shift: f64, steps: usize) {
        for_basis!(ops, |differences| {
            for _ in 0..steps {
                let t = self.momentum;
                self.momentum = 0.5 * (1.0 + (1.0 + 4.0 * t * t).sqrt());
                let momentum = T::from_f64((t - 1.0) / self.momentum);
                // the duals of a frame, and of its link to the frame before, act on errors that are computed already
                for frame in 0..self.frames {
                    self.pull_frame(ops, differences, frame, Some(shift));
                    self.step(ops, differences, frame, momentum);
                }
            }
        });
    }

    /// Computes the coefficients `V' h(e)` of the extrapolated duals.
    pub(crate) fn analyse(&mut self, ops: &Operators<T>, ranks: usize) {
        self.find_error(ops, Some(0.0));
        ops.analyse(&self.error, ranks, &mut self.sums, &mut self.coefficients);
    }

    /// Sets the force of the first `ranks` of `coefficients`, or adds it.
    pub(crate) fn push(&mut self, ops: &Operators<T>, ranks: usize, add: bool) {
        convert(&self.coefficients, 1.0, &mut self.z);
        ops.expand(&self.z, 0..ranks, add, &mut self.force);
    }

    /// Computes the error `e` of the last duals.
    pub(crate) fn finish(&mut self, ops: &Operators<T>) {
        std::mem::swap(&mut self.ahead, &mut self.duals);
        self.find_error(ops, None);
        std::mem::swap(&mut self.ahead, &mut self.duals);
    }

    fn find_error(&mut self, ops: &Operators<T>, shift: Option<f64>) {
        for_basis!(ops, |differences| {
            for frame in 0..self.frames {
                self.pull_frame(ops, differences, frame, shift);
            }
        });
    }

    #[inline(always)]
    fn pull_frame<D: Differences<T>>(
        &mut self,
        ops: &Operators<T>,
        differences: &D,
        frame: usize,
        shift: Option<f64>,
    ) {
        match (self.anchor.is_empty(), self.how.bounds) {
            (true, None) => self.pull::<D, false, false>(ops, differences, frame, shift),
            (true, Some(_)) => self.pull::<D, false, true>(ops, differences, frame, shift),
            (false, None) => self.pull::<D, true, false>(ops, differences, frame, shift),
            (false, Some(_)) => self.pull::<D, true, true>(ops, differences, frame, shift),
        }
    }

    /// Computes the error of the extrapolated duals in a frame; with a shift, only the part that anchor and bounds do
    /// not absorb.
    #[inline(always)]
    fn pull<D: Differences<T>, const ANCHORED: bool, const BOUNDED: bool>(
        &mut self,
        ops: &Operators<T>,
        differences: &D,
        frame: usize,
        shift: Option<f64>,
    ) {
        let Self { how, force, error, ahead, image, anchor, .. } = self;
        let (base, q) = (frame * ops.cells(), ahead.flow_of(frame));
        let (mu, held) = (T::from_f64(how.mu), T::from_f64(how.lambda_anchor));
        let [lower, upper] = how.bounds.unwrap_or_default().map(T::from_f64);
        let zero = T::default();
        for (block, &at) in ops.places.blocks.iter().enumerate() {
            let here = base + at;
            let mut e = ahead.pull(differences, q, (block, at, here), load(force, here));
            let Some(shift) = shift else {
                store(error, here, e);
                continue;
            };
            let (shift, x) = (T::from_f64(shift), load(image, here));
            // distances to the bounds from the anchor while shifted, otherwise from the image, since the cost of a
            // bound's force is proportional to the distance from the bound
            let (mut centre, mut from) = (x, x);
            if ANCHORED {
                let radius = differences.cell_radius(at);
                centre = load(anchor, here);
                from = if shift > zero { centre } else { x };
                e = each!(|l| {
                    let value = e[l] - shift * (x[l] - centre[l]);
                    value - clip(value, held * radius[l])
                });
            }
            if BOUNDED {
                e = each!(|l| {
                    let most = mu * (from[l] - lower).max(zero);
                    let least = mu * (from[l] - upper).min(zero);
                    e[l].min(most).max(least)
                });
            }
            store(error, here, each!(|l| e[l] - shift * centre[l]));
        }
    }

    /// Takes a gradient step on the flow of a frame and its link to the frame before.
    #[inline(always)]
    fn step<D: Differences<T>>(
        &mut self,
        ops: &Operators<T>,
        differences: &D,
        frame: usize,
        momentum: T,
    ) {
        let Self { how, error, duals, ahead, .. } = self;
        let (cells, groups) = (ops.cells(), ops.groups);
        let Duals { flow: [first, second], links, .. } = duals;
        let Duals { flow: [next_first, next_second], links: links_ahead, .. } = ahead;
        let norm = ops.norm_squared + if links.is_empty() { 0.0 } else { 4.0 };
        let step = T::from_f64(-1.0 / norm.max(1.0));
        let (space, time) = (T::from_f64(how.lambda_space), T::from_f64(how.lambda_time));
        let (base, own) = (frame * groups, &error[frame * cells..(frame + 1) * cells]);
        for &at in differences.group_blocks() {
            let [da, db] = differences.difference(own, at);
            let at_group = differences.group_radius(at);
            let here = base + at;
            let (a, b) = (load(next_first, here), load(next_second, here));
            let up_a = each!(|l| step.mul_add(da[l], a[l]));
            let up_b = each!(|l| step.mul_add(db[l], b[l]));
            let radius = each!(|l| space * at_group[l]);
            let factor = shrink(up_a, up_b, radius, radius);
            let (a, b) = (each!(|l| up_a[l] * factor[l]), each!(|l| up_b[l] * factor[l]));
            let (old_a, old_b) = (load(first, here), load(second, here));
            store(next_first, here, each!(|l| momentum.mul_add(a[l] - old_a[l], a[l])));
            store(next_second, here, each!(|l| momentum.mul_add(b[l] - old_b[l], b[l])));
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
            let new = each!(|l| clip(step.mul_add(e[l] - before[l], q[l]), time * radius[l]));
            store(links_ahead, here, each!(|l| momentum.mul_add(new[l] - old[l], new[l])));
            store(links, here, new);
        }
    }
}
