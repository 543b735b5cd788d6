//! Mutable state of the iteration: image, dual variables and intermediate arrays.

use super::chain::Chain;
use super::float::Float;
use super::kernel::LANES;
use super::operators::{BLOCK, Operators};

/// Over-relaxation factor.
pub(crate) const RHO: f64 = 1.9;

/// Padding before or after the arrays whose temporal neighbours are read across row ends.
pub(crate) const PAD: usize = LANES;

/// Number of iterations between updates of the tail's force.
pub(crate) const REFRESH: usize = 32;

/// Weights of an iteration.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Weights {
    pub(crate) lambda_space: f64,
    pub(crate) lambda_time: f64,
    pub(crate) bounds: Option<[f64; 2]>,
    /// Threshold, in units of the image, below which the norm of a difference is quadratic (Huber), so
    /// that the duals of flat regions converge.
    pub(crate) smoothing: f64,
}

/// Iterate of one sequence.
///
/// Arrays are `[unknown][stride]` or `[row][stride]`, see [`super::kernel`].
#[derive(Debug, Clone)]
pub(crate) struct State<T> {
    pub(crate) frames: usize,
    pub(crate) stride: usize,
    /// `x`.
    pub(crate) image: Vec<T>,
    /// Mean of each frame's image, by the distance from which steps are balanced, `[stride]`; 0 unless
    /// `is_centred`.
    pub(crate) means: Vec<f64>,
    /// Whether images are close to constants.
    pub(crate) is_centred: bool,
    /// `q`.
    pub(crate) dual: Vec<T>,
    /// `q_t`, preceded by [`PAD`] zeros; zero at the last frame and beyond. Empty without a time
    /// term.
    pub(crate) time_dual: Vec<T>,
    /// `p`; empty without bounds.
    pub(crate) bound_dual: Vec<T>,
    /// Force of the duals, then `x-`, then the next force, followed by [`PAD`] values.
    pub(crate) work: Vec<T>,
    /// `w` of a block of unknowns.
    pub(crate) block: Vec<T>,
    /// `x^` of the last iteration with `keep`.
    pub(crate) candidate: Vec<T>,
    /// `V' w`, then the force `F y` of the data.
    pub(crate) coefficients: Vec<T>,
    /// Coefficients of the next `w` while they are summed.
    pub(crate) next: Vec<T>,
    /// Number of ranks in the head, see [`super::engine`].
    pub(crate) head: usize,
    /// Force of the tail, `V (s y)`, of blocks of unknowns; not used without a tail.
    pub(crate) tail: Vec<T>,
    /// Iterations since the last update of the tail.
    pub(crate) age: usize,
    /// Whether `work` and `coefficients` are ready for the next iteration.
    pub(crate) prepared: bool,
    /// The step map: `tau` of an unknown, and `sigma` of its links and bounds and of a group, one
    /// value for each block of [`LANES`] frames.
    pub(crate) tau: Vec<T>,
    pub(crate) cell_sigma: Vec<T>,
    pub(crate) group_sigma: Vec<T>,
    /// `sigma tau` of the duals of space, time and bounds.
    pub(crate) split: [f64; 3],
    /// Memory for exact dual steps in time, see [`super::chain`]; `None` for gradient steps.
    pub(crate) chain: Option<Chain<T>>,
    /// 1 for frames that are linked to the next one, otherwise 0, `[stride]`.
    pub(crate) links: Vec<T>,
    /// 1 for frames, 0 for padding, `[stride]`. Bounds do not apply to padding, because it must stay
    /// zero even if they exclude zero.
    pub(crate) present: Vec<T>,
}

impl<T: Float> State<T> {
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
            means: vec![0.0; stride],
            is_centred: false,
            dual: vec![zero; ops.gradient.count() * stride],
            time_dual: if time { vec![zero; PAD + values] } else { Vec::new() },
            bound_dual: if bounds { vec![zero; values] } else { Vec::new() },
            work: vec![zero; values + PAD],
            block: vec![zero; BLOCK * stride],
            candidate: vec![zero; values],
            coefficients: vec![zero; ops.padded_rank * stride],
            next: vec![zero; ops.padded_rank * stride],
            head: ops.padded_rank,
            tail: vec![zero; values],
            age: REFRESH,
            prepared: false,
            tau: vec![zero; values / LANES],
            cell_sigma: vec![zero; values / LANES],
            group_sigma: vec![zero; ops.groups.len() * stride / LANES],
            split: [1.0; 3],
            chain: None,
            links,
            present: (0..stride).map(|t| T::from_f64(if t < frames { 1.0 } else { 0.0 })).collect(),
        }
    }

    /// Returns the same iterate in another precision.
    pub(crate) fn converted<U: Float>(&self, ops: &Operators<U>) -> State<U> {
        let mut new =
            State::new(ops, self.frames, !self.time_dual.is_empty(), !self.bound_dual.is_empty());
        let pairs = [
            (&mut new.image, &self.image),
            (&mut new.dual, &self.dual),
            (&mut new.time_dual, &self.time_dual),
            (&mut new.bound_dual, &self.bound_dual),
            (&mut new.candidate, &self.candidate),
            (&mut new.tau, &self.tau),
            (&mut new.cell_sigma, &self.cell_sigma),
            (&mut new.group_sigma, &self.group_sigma),
            (&mut new.links, &self.links),
        ];
        for (to, from) in pairs {
            to.iter_mut().zip(from).for_each(|(to, from)| *to = U::from_f64(from.to_f64()));
        }
        new.split = self.split;
        new.is_centred = self.is_centred;
        new.chain = self.chain.as_ref().map(|_| Chain::new(self.frames));
        new
    }

    /// Computes the means of all frames.
    pub(crate) fn centre(&mut self, unknowns: usize) {
        self.means.fill(0.0);
        for row in self.image.chunks_exact(self.stride).take(unknowns) {
            let share = 1.0 / unknowns as f64;
            self.means.iter_mut().zip(row).for_each(|(mean, x)| *mean += share * x.to_f64());
        }
    }

    /// Invalidates the prepared arrays after a change of the steps or other inputs of an iteration.
    pub(crate) fn disturb(&mut self) {
        self.age = REFRESH;
        self.prepared = false;
    }

    /// Returns the number of blocks of frames that share their steps.
    pub(crate) fn blocks(&self) -> usize {
        self.stride / LANES
    }

    /// Returns whether a frame is linked to the next one.
    pub(crate) fn is_linked(&self, frame: usize) -> bool {
        !self.time_dual.is_empty() && self.links[frame] > T::default()
    }

    /// Sets image and duals to zero.
    pub(crate) fn clear(&mut self) {
        self.age = REFRESH;
        self.prepared = false;
        let zero = T::default();
        self.image.fill(zero);
        self.dual.fill(zero);
        self.time_dual.fill(zero);
        self.bound_dual.fill(zero);
    }
}
