//! How far images and duals travel, from which long runs balance their steps.
//!
//! ```text
//! ratio^2 = |x - x_0|^2_{T^-1} / |q - q_0|^2_{Sigma^-1}      over all duals q
//! ```
//!
//! Steps are balanced if both travel equally far. The norms of image and duals, from which a step map is
//! balanced, say nothing of that where the image has far to go under a small force: in a direction that the
//! constraints of the data leave free, or that few channels see. Applegate et al. (*Practical large-scale linear
//! programming using primal-dual hybrid gradient*, NeurIPS 2021, section 3.3) balance their steps likewise.

use super::float::Float;
use super::kernel::LANES;
use super::operators::Operators;
use super::state::{PAD, State};
use super::step::largest_tau;
use std::ops::Range;

/// Images and duals of an earlier iterate.
pub(crate) struct Travel<T> {
    image: Vec<T>,
    dual: Vec<T>,
    time_dual: Vec<T>,
    bound_dual: Vec<T>,
}

impl<T: Float> Travel<T> {
    /// Starts from the current iterate.
    pub(crate) fn from(state: &State<T>) -> Self {
        Self {
            image: state.image.clone(),
            dual: state.dual.clone(),
            time_dual: state.time_dual.clone(),
            bound_dual: state.bound_dual.clone(),
        }
    }

    /// Starts again from the current iterate.
    fn restart(&mut self, state: &State<T>) {
        self.image.copy_from_slice(&state.image);
        self.dual.copy_from_slice(&state.dual);
        self.time_dual.copy_from_slice(&state.time_dual);
        self.bound_dual.copy_from_slice(&state.bound_dual);
    }

    /// Returns `ratio` since the start or the last call, in the metric of the current steps: 1 if nothing moved,
    /// infinite if only the image did.
    pub(crate) fn ratio(&mut self, ops: &Operators<T>, state: &State<T>) -> f64 {
        let (mut image, mut dual) = (0.0, 0.0);
        for p in 0..ops.unknowns {
            for block in 0..state.blocks() {
                let tau = state.tau[p * state.blocks() + block].to_f64();
                let at = p * state.stride + block * LANES;
                image += moved(&state.image, &self.image, at) / tau;
                dual += tau * self.of_links(state, at..at + LANES);
            }
        }
        for (index, group) in ops.groups.iter().enumerate() {
            for block in 0..state.blocks() {
                let tau = largest_tau(&state.tau, group.unknowns, state.blocks(), block);
                for c in 0..ops.components {
                    let at = (index * ops.components + c) * state.stride + block * LANES;
                    dual += tau / state.split[0] * moved(&state.dual, &self.dual, at);
                }
            }
        }
        self.restart(state);
        match (image / dual).sqrt() {
            ratio if ratio.is_nan() => 1.0,
            ratio => ratio,
        }
    }

    /// Returns the squared distance that the duals of an unknown in time and of its bounds travelled, over their
    /// `sigma tau`.
    fn of_links(&self, state: &State<T>, at: Range<usize>) -> f64 {
        let [_, time, bounds] = state.split;
        if state.chain.is_some() {
            // exact steps change their sum
            let sum = |time: &[T], bound: &[T], at: usize| {
                let link = (time[PAD + at - 1] - time[PAD + at]).to_f64();
                link + bound.get(at).map_or(0.0, |p| p.to_f64())
            };
            let change = |at: usize| {
                sum(&state.time_dual, &state.bound_dual, at)
                    - sum(&self.time_dual, &self.bound_dual, at)
            };
            return at.map(|at| change(at).powi(2)).sum::<f64>() / time;
        }
        let mut sum = 0.0;
        if !state.time_dual.is_empty() {
            sum += moved(&state.time_dual, &self.time_dual, PAD + at.start) / time;
        }
        if !state.bound_dual.is_empty() {
            sum += moved(&state.bound_dual, &self.bound_dual, at.start) / bounds;
        }
        sum
    }
}

/// Returns the squared distance between the frames of a block.
fn moved<T: Float>(now: &[T], before: &[T], at: usize) -> f64 {
    let pairs = now[at..at + LANES].iter().zip(&before[at..at + LANES]);
    pairs.map(|(now, before)| (now.to_f64() - before.to_f64()).powi(2)).sum()
}
