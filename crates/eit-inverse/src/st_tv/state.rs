//! Mutable state of the iteration: images, dual variables and step map.

use super::chain::Chain;
use super::float::Float;
use super::lanes::{LANES, Lane, Project};
use super::operators::Operators;
use super::problem::Problem;

/// Number of consecutive frames that share their steps.
pub(crate) const SPAN: usize = 8;

/// Most frames that a pass over the basis handles together.
pub(crate) const TOGETHER: usize = 4;

/// Iterate of a problem. Arrays are `[frame][cell]`, `[frame][group]` or `[span][..]` in the layout of
/// [`super::differences`].
#[derive(Debug, Clone)]
pub(crate) struct State<T: Project> {
    pub(crate) frames: usize,
    pub(crate) cells: usize,
    pub(crate) groups: usize,
    /// Images from which changes are counted: the anchor, or images of an earlier iterate. Near them, products with
    /// rounded entries of the basis are almost exact.
    pub(crate) origin: Vec<T>,
    /// `d = x - origin`.
    pub(crate) change: Vec<T>,
    /// `d` of the last iteration before relaxation.
    pub(crate) fresh: Vec<T>,
    /// `w`, then `x- = origin + 2 d^ - d`.
    pub(crate) work: Vec<T>,
    /// `q`, the dual of the gradient, by component.
    pub(crate) flow: [Vec<T>; 2],
    /// `q_t`, the dual of the link to the frame before, between two rows of zeros; empty without links.
    pub(crate) links: Vec<T>,
    /// `p`, the joint dual of anchor and bounds; empty without both.
    pub(crate) force: Vec<T>,
    /// Force of the tail of the data term.
    pub(crate) tail: Vec<T>,
    /// Whether `tail` is not zero.
    pub(crate) has_tail: bool,
    /// Distances from the origin to the bounds; 0 in cells without an unknown. Empty without bounds.
    pub(crate) room: [Vec<T>; 2],
    /// The step map: `tau` and `1 / tau` of a cell, 0 without an unknown, and `sigma` of a group.
    pub(crate) tau: Vec<T>,
    pub(crate) cell_step: Vec<T>,
    pub(crate) group_step: Vec<T>,
    /// `sigma tau` of the duals of space, time, and anchor and bounds.
    pub(crate) split: [f64; 3],
    /// Memory for exact dual steps in time, see [`super::chain`]; `None` for gradient steps.
    pub(crate) chain: Option<Chain<T>>,
    /// Whether images are close to constants, from which their distance is measured.
    pub(crate) is_centred: bool,
    /// Partial sums of `V' w`, one lane per rank, of a few frames.
    pub(crate) sums: Vec<Lane<T>>,
    /// `V' w` of the last iteration, and the force `F y` of the data, `[frame][padded rank]`.
    pub(crate) coefficients: Vec<T>,
    pub(crate) forces: Vec<T>,
}

impl<T: Project> State<T> {
    pub(crate) fn new(ops: &Operators<T>, problem: &Problem<'_>) -> Self {
        let (frames, cells, groups) = (problem.frames(), ops.cells(), ops.groups);
        let spans = frames.div_ceil(SPAN);
        let zeros = |count: usize| vec![T::default(); count];
        let bounded = problem.bounds.is_some();
        let held = bounded || problem.is_held();
        let only = |is_used: bool, count: usize| zeros(if is_used { count } else { 0 });
        Self {
            frames,
            cells,
            groups,
            origin: zeros(frames * cells),
            change: zeros(frames * cells),
            fresh: zeros(frames * cells),
            work: zeros(frames * cells),
            flow: [zeros(frames * groups), zeros(frames * groups)],
            links: only(problem.linked(), (frames + 1) * cells),
            force: only(held, frames * cells),
            tail: zeros(frames * cells),
            has_tail: false,
            room: std::array::from_fn(|_| only(bounded, frames * cells)),
            tau: zeros(spans * cells),
            cell_step: zeros(spans * cells),
            group_step: zeros(spans * groups),
            split: [1.0; 3],
            chain: None,
            is_centred: false,
            sums: vec![[T::default(); LANES]; TOGETHER.min(frames) * ops.padded],
            coefficients: zeros(frames * ops.padded),
            forces: zeros(frames * ops.padded),
        }
    }

    /// Copies the iterate and the step map of another precision, with the same origin.
    pub(crate) fn take<U: Project>(&mut self, other: &State<U>) {
        self.take_iterate(other);
        let pairs = [
            (&mut self.origin, &other.origin),
            (&mut self.tau, &other.tau),
            (&mut self.cell_step, &other.cell_step),
            (&mut self.group_step, &other.group_step),
        ];
        pairs.into_iter().for_each(|(to, from)| convert(from, 1.0, to));
        for (to, from) in self.room.iter_mut().zip(&other.room) {
            convert(from, 1.0, to);
        }
        (self.split, self.is_centred) = (other.split, other.is_centred);
        self.chain = other.chain.as_ref().map(|_| Chain::new(self.frames));
    }

    /// Copies changes and duals of another precision.
    pub(crate) fn take_iterate<U: Project>(&mut self, other: &State<U>) {
        self.take_duals(other, 1.0);
        convert(&other.change, 1.0, &mut self.change);
        convert(&other.fresh, 1.0, &mut self.fresh);
    }

    /// Copies the duals of another iterate of the same frames, times a factor.
    pub(crate) fn take_duals<U: Project>(&mut self, other: &State<U>, factor: f64) {
        let [first, second] = &mut self.flow;
        let pairs = [
            (first, &other.flow[0]),
            (second, &other.flow[1]),
            (&mut self.links, &other.links),
            (&mut self.force, &other.force),
        ];
        pairs.into_iter().for_each(|(to, from)| convert(from, factor, to));
    }

    /// Sets image and duals to zero.
    pub(crate) fn clear(&mut self) {
        self.change.fill(T::default());
        self.fresh.fill(T::default());
        self.scale_duals(0.0);
    }

    /// Multiplies the duals.
    pub(crate) fn scale_duals(&mut self, factor: f64) {
        let factor = T::from_f64(factor);
        let [first, second] = &mut self.flow;
        for array in [first, second, &mut self.links, &mut self.force] {
            array.iter_mut().for_each(|v| *v = *v * factor);
        }
    }

    /// Counts changes from other images, over cells; the iterate stays.
    pub(crate) fn set_origin(
        &mut self,
        ops: &Operators<T>,
        images: &[f64],
        bounds: Option<[f64; 2]>,
    ) {
        for frame in 0..self.frames {
            for &cell in &ops.places.cells {
                let at = frame * self.cells + cell;
                let image = T::from_f64(images[at]);
                let moved = self.origin[at] - image;
                self.change[at] += moved;
                self.fresh[at] += moved;
                self.origin[at] = image;
                if let Some([lower, upper]) = bounds {
                    let x = image.to_f64();
                    self.room[0][at] = T::from_f64(lower - x);
                    self.room[1][at] = T::from_f64(upper - x);
                }
            }
        }
    }

    /// Makes the change from the origin zero.
    pub(crate) fn start_at_origin(&mut self) {
        self.change.fill(T::default());
        self.fresh.fill(T::default());
    }

    /// Returns the largest absolute value of the images.
    pub(crate) fn size(&self) -> f64 {
        let images = self.origin.iter().zip(&self.change);
        images.fold(T::default(), |most, (x, d)| most.max((*x + *d).abs())).to_f64()
    }

    /// Returns the step of an unknown.
    pub(crate) fn tau_of(&self, frame: usize, cell: usize) -> f64 {
        self.tau[frame / SPAN * self.cells + cell].to_f64()
    }

    /// Returns the number of spans of frames.
    pub(crate) fn spans(&self) -> usize {
        self.frames.div_ceil(SPAN)
    }
}

fn convert<T: Float, U: Float>(from: &[U], factor: f64, to: &mut [T]) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to = T::from_f64(factor * from.to_f64()));
}
