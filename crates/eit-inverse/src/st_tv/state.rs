//! Mutable state of the iteration: images, dual variables and step map.

use super::chain::{Chain, is_exact};
use super::duals::{Duals, convert};
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
    pub(crate) duals: Duals<T>,
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
        Self {
            frames,
            cells,
            groups,
            origin: zeros(frames * cells),
            change: zeros(frames * cells),
            fresh: zeros(frames * cells),
            work: zeros(frames * cells),
            duals: Duals::new(ops, problem, held),
            tail: zeros(frames * cells),
            has_tail: false,
            room: std::array::from_fn(|_| zeros(if bounded { frames * cells } else { 0 })),
            tau: zeros(spans * cells),
            cell_step: zeros(spans * cells),
            group_step: zeros(spans * groups),
            split: [1.0; 3],
            chain: is_exact(ops, problem).then(|| Chain::new(frames)),
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
    }

    /// Copies changes and duals of another precision.
    pub(crate) fn take_iterate<U: Project>(&mut self, other: &State<U>) {
        self.duals.take(&other.duals, 1.0);
        convert(&other.change, 1.0, &mut self.change);
        convert(&other.fresh, 1.0, &mut self.fresh);
    }

    /// Sets image and duals to zero.
    pub(crate) fn clear(&mut self) {
        self.start_at_origin();
        self.duals.scale(0.0);
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

    /// Returns the images, over cells.
    pub(crate) fn images(&self) -> impl Iterator<Item = T> {
        self.origin.iter().zip(&self.change).map(|(x, d)| *x + *d)
    }

    /// Returns the largest absolute value of the images.
    pub(crate) fn size(&self) -> f64 {
        self.images().fold(T::default(), |most, x| most.max(x.abs())).to_f64()
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
