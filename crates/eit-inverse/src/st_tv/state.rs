//! What an iteration changes: image, dual variables, and what is kept between iterations.

use super::float::Float;
use super::kernel::LANES;
use super::operators::{BLOCK, Operators};

/// Over-relaxation.
pub(crate) const RHO: f64 = 1.9;

/// Zeros before and after the arrays whose neighbours in time are read across row ends.
pub(crate) const PAD: usize = LANES;

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

/// The iterate of one sequence.
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
    pub(crate) work: Vec<T>,
    /// `x^` of the last iteration that was asked to keep it.
    pub(crate) candidate: Vec<T>,
    /// `V' w`, then `c' - V' w`.
    pub(crate) coefficients: Vec<T>,
    /// Those of the next `w` while they are summed.
    pub(crate) next: Vec<T>,
    /// Ranks below are the head, see the module.
    pub(crate) head: usize,
    /// Force of the tail, `V (s y)`, of blocks of unknowns; not used where there is no tail.
    pub(crate) tail: Vec<T>,
    /// Iterations since the tail was brought up to date.
    pub(crate) age: usize,
    /// The primal step for which `work` holds `w` and `coefficients` its coefficients.
    pub(crate) prepared: Option<f64>,
    /// 1 for frames whose change to the next one counts, `[stride]`.
    pub(crate) links: Vec<T>,
    /// 1 for frames, 0 for padding, which has no bounds: it would leave zero where they exclude it,
    /// `[stride]`.
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
}
