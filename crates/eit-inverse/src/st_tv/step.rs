//! Step map: the step size of each unknown.
//!
//! ```text
//! g     = gradient of the image, dilated by two, its largest value over a block of frames
//! tau   = c sqrt(max(g, floor X) / X)          X: largest value of the image
//! sigma = s / max tau over the unknowns of the difference,   separate s for space, time and bounds
//! ```
//!
//! with `|D|^2 s_space + 4 s_time + s_bounds = 1` (exact steps in time: `|D|^2 s_space + s_time = 1`), so that `|Sigma^1/2 [D; D_t; I] T^1/2| <= 1`. Steps
//! are large where the image has gradients and small where it is flat. `c` is a fraction of the value
//! that balances the norms of image and dual variables in the metric of the map, so no
//! problem-specific tuning is needed.

use super::float::Float;
use super::kernel::LANES;
use super::operators::Operators;
use super::problem::Problem;
use super::state::{PAD, State};
use std::ops::Range;

/// Fraction of the balanced step that works best at the start, on the reference problems; a factor of
/// two either way costs a tenth of the iterations.
const SHARE: f64 = 0.6;

/// Returns `|D|^2` including the temporal links and the bounds, for `sigma tau |D|^2 = 1`.
pub(crate) fn norm_squared<T: Float>(ops: &Operators<T>, state: &State<T>) -> f64 {
    // a basis without differences (one pixel) and without bounds has no dual step
    squared_norms(ops, state).iter().sum::<f64>().max(1.0)
}

/// Returns the step that balances image and dual variables, from their squared norms; `None` if either
/// is zero.
fn balanced(image: f64, dual: f64, norm_squared: f64) -> Option<f64> {
    let step = SHARE * (image / dual / norm_squared).sqrt();
    (step > 0.0 && step.is_finite()).then_some(step)
}

/// Returns the squared norms of the regularised least-squares images of all frames, and of the forces
/// of their data.
pub(crate) fn linear_image(problem: &Problem<'_>) -> [f64; 2] {
    let (mut image, mut force) = (0.0, 0.0);
    for (target, &mode) in problem.targets.iter().zip(problem.mode_of) {
        let mode = &problem.modes[mode];
        let rank = problem.singular.len();
        for (k, s) in problem.singular.iter().enumerate() {
            // the operator of a frame without masked channels is diagonal
            let rows = if mode.is_whole { k..k + 1 } else { 0..mode.rows };
            let pull: f64 = rows.map(|i| mode.transposed[i * rank + k] * target.values[i]).sum();
            image += (pull / (s * s + 1e-3)).powi(2);
            force += pull.powi(2);
        }
    }
    [image, force]
}

/// Returns a first guess of the step, from the least-squares image and the largest dual variables.
pub(crate) fn guess<T: Float>(
    problem: &Problem<'_>,
    ops: &Operators<T>,
    state: &State<T>,
) -> Option<f64> {
    let [image, force] = linear_image(problem);
    let square = |radii: &[T]| radii.iter().map(|r| r.to_f64().powi(2)).sum::<f64>();
    let frames = state.frames as f64;
    let mut dual = frames * square(&ops.radius) * problem.lambda_space.powi(2);
    if !state.time_dual.is_empty() && state.chain.is_none() {
        dual += frames * square(&ops.time_radius) * problem.lambda_time.powi(2);
    }
    // limits very large weights: the duals need at most the force of the data times the skin's width
    let dual = dual.min(force * ops.unknowns as f64);
    balanced(image, dual, norm_squared(ops, state))
}

/// Smallest gradient in the step map, relative to the largest value of the image.
pub(crate) const FLOOR: f64 = 2e-3;

/// Size of the steps of a map.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MapSize {
    /// Fraction of the balanced steps.
    pub(crate) share: f64,
    /// Smallest gradient, relative to the largest value of the image; usually [`FLOOR`].
    pub(crate) floor: f64,
}

/// Smallest share of the squared dual norm assigned to each of space, time and bounds.
const LEAST_SHARE: f64 = 0.02;

/// Returns the balanced step of an iterate.
pub(crate) fn measure<T: Float>(ops: &Operators<T>, state: &State<T>) -> Option<f64> {
    let square = |values: &[T]| values.iter().map(|v| v.to_f64().powi(2)).sum::<f64>();
    let image = square(&state.image);
    let rest = match state.chain {
        Some(_) => (0..ops.unknowns).map(|p| merged_square(state, p, 0..state.stride)).sum(),
        None => square(&state.time_dual) + square(&state.bound_dual),
    };
    let dual = square(&state.dual) + rest;
    balanced(image, dual, norm_squared(ops, state))
}

/// Sets one step for all unknowns.
pub(crate) fn set_uniform<T: Float>(ops: &Operators<T>, state: &mut State<T>, tau: f64) {
    let blocks = state.blocks();
    state.tau[..ops.unknowns * blocks].fill(T::from_f64(tau));
    state.split = even_split(ops, state);
    set_sigma(ops, state);
}

/// Multiplies all steps.
pub(crate) fn scale<T: Float>(ops: &Operators<T>, state: &mut State<T>, factor: f64) {
    let factor = T::from_f64(factor);
    state.tau.iter_mut().for_each(|tau| *tau = factor * *tau);
    set_sigma(ops, state);
}

/// Sets the steps from the gradient of the image. Returns false and changes nothing if the image or the
/// duals are zero or not finite.
pub(crate) fn set_map<T: Float>(
    ops: &Operators<T>,
    state: &mut State<T>,
    scratch: &mut MapScratch<T>,
    steps: MapSize,
) -> bool {
    let blocks = state.blocks();
    let size = state.image.iter().fold(T::default(), |most, x| most.max(x.abs()));
    if !(size > T::default() && size.to_f64().is_finite()) {
        return false;
    }
    scratch.gradient(ops, state);
    scratch.before.copy_from_slice(&state.tau);
    let per_size = 1.0 / size.to_f64();
    for (tau, g) in state.tau[..ops.unknowns * blocks].iter_mut().zip(&scratch.cells) {
        *tau = T::from_f64((g.to_f64() * per_size).max(steps.floor).sqrt());
    }
    let Some(factor) = balance(ops, state) else {
        state.tau.copy_from_slice(&scratch.before);
        return false;
    };
    scale(ops, state, steps.share * factor);
    true
}

/// Computes `Sigma` from `T`.
fn set_sigma<T: Float>(ops: &Operators<T>, state: &mut State<T>) {
    let blocks = state.blocks();
    let State { tau, cell_sigma, group_sigma, split: [space, time, _], .. } = state;
    let cells = cell_sigma[..ops.unknowns * blocks].iter_mut();
    cells.zip(&*tau).for_each(|(s, tau)| *s = T::from_f64(*time / tau.to_f64()));
    for (group, sigmas) in ops.groups.iter().zip(group_sigma.chunks_exact_mut(blocks)) {
        for (block, s) in sigmas.iter_mut().enumerate() {
            let largest = largest_tau(tau, group.unknowns, blocks, block);
            *s = T::from_f64(*space / largest);
        }
    }
}

pub(crate) fn largest_tau<T: Float>(
    tau: &[T],
    unknowns: [u32; 3],
    blocks: usize,
    block: usize,
) -> f64 {
    let own = unknowns.map(|p| tau[p as usize * blocks + block].to_f64());
    own[0].max(own[1]).max(own[2])
}

/// Returns the squared norms of the differences in space and time and of the bounds; 0 for absent terms.
fn squared_norms<T: Float>(ops: &Operators<T>, state: &State<T>) -> [f64; 3] {
    if state.chain.is_some() {
        return [ops.norm_squared, 1.0, 0.0];
    }
    let time = if state.time_dual.is_empty() { 0.0 } else { 4.0 };
    let bounds = if state.bound_dual.is_empty() { 0.0 } else { 1.0 };
    [ops.norm_squared, time, bounds]
}

/// Returns equal `sigma tau` for space, time and bounds.
fn even_split<T: Float>(ops: &Operators<T>, state: &State<T>) -> [f64; 3] {
    [1.0 / squared_norms(ops, state).iter().sum::<f64>().max(1.0); 3]
}

/// Returns the squared norm of `D_t' q_t + p` of an unknown over a range of frames.
fn merged_square<T: Float>(state: &State<T>, unknown: usize, frames: Range<usize>) -> f64 {
    let at = unknown * state.stride;
    let value = |t: usize| {
        let time = state.time_dual[PAD + at + t - 1] - state.time_dual[PAD + at + t];
        let bound = state.bound_dual.get(at + t).copied().unwrap_or_default();
        (time + bound).to_f64()
    };
    frames.map(|t| value(t).powi(2)).sum()
}

/// Splits `sum |.|^2 sigma tau <= 1` between the duals of space, time and bounds according to their
/// norms, and returns the factor that balances image and duals.
///
/// ```text
/// min  sum_i N_i / s_i  with  sum_i c_i s_i = 1:     s_i = sqrt(N_i / c_i) / sum_j sqrt(c_j N_j)
/// ```
///
/// with `N_i` the squared norms of the duals, weighted by `tau`, and `c_i` the squared operator norms.
fn balance<T: Float>(ops: &Operators<T>, state: &mut State<T>) -> Option<f64> {
    let (stride, blocks) = (state.stride, state.blocks());
    let square = |row: &[T]| row.iter().map(|v| v.to_f64().powi(2)).sum::<f64>();
    let (mut image, mut carried) = (0.0, [0.0; 3]);
    if state.is_centred {
        state.centre(ops.unknowns);
    }
    for p in 0..ops.unknowns {
        for block in 0..blocks {
            let at = p * stride + block * LANES..p * stride + (block + 1) * LANES;
            let tau = state.tau[p * blocks + block].to_f64();
            let means = &state.means[block * LANES..][..LANES];
            let row = state.image[at.clone()].iter().zip(means);
            image += row.map(|(x, mean)| (x.to_f64() - mean).powi(2)).sum::<f64>() / tau;
            if state.chain.is_some() {
                carried[1] += tau * merged_square(state, p, block * LANES..(block + 1) * LANES);
                continue;
            }
            if !state.time_dual.is_empty() {
                carried[1] += tau * square(&state.time_dual[PAD..][at.clone()]);
            }
            if !state.bound_dual.is_empty() {
                carried[2] += tau * square(&state.bound_dual[at]);
            }
        }
    }
    for (index, group) in ops.groups.iter().enumerate() {
        for block in 0..blocks {
            let tau = largest_tau(&state.tau, group.unknowns, blocks, block);
            for c in 0..ops.components {
                let at = (index * ops.components + c) * stride + block * LANES;
                carried[0] += tau * square(&state.dual[at..at + LANES]);
            }
        }
    }
    let norms = squared_norms(ops, state);
    let all: f64 = carried.iter().sum();
    if !(all > 0.0 && all.is_finite()) {
        return None;
    }
    // duals that are zero now may become non-zero later
    let carried = carried.map(|n| n.max(LEAST_SHARE * all));
    let sum: f64 = carried.iter().zip(&norms).map(|(n, c)| (n * c).sqrt()).sum();
    for ((s, n), c) in state.split.iter_mut().zip(&carried).zip(&norms) {
        *s = if *c > 0.0 { (n / c).sqrt() / sum } else { 1.0 };
    }
    let terms = carried.iter().zip(&norms).zip(&state.split);
    let dual: f64 = terms.map(|((n, c), s)| if *c > 0.0 { n / s } else { 0.0 }).sum();
    let factor = (image / dual).sqrt();
    (factor > 0.0 && factor.is_finite()).then_some(factor)
}

/// Memory for a step map.
#[derive(Debug, Clone)]
pub(crate) struct MapScratch<T> {
    /// Gradient of each unknown and of each group, in blocks of frames.
    cells: Vec<T>,
    groups: Vec<T>,
    /// Previous steps, restored if no map can be computed.
    before: Vec<T>,
}

impl<T: Float> MapScratch<T> {
    pub(crate) fn new(ops: &Operators<T>, state: &State<T>) -> Self {
        let zero = T::default();
        Self {
            cells: vec![zero; ops.unknowns * state.blocks()],
            groups: vec![zero; ops.groups.len() * state.blocks()],
            before: state.tau.clone(),
        }
    }

    /// Computes the largest differences of the image, dilated by two groups.
    fn gradient(&mut self, ops: &Operators<T>, state: &State<T>) {
        let (stride, blocks) = (state.stride, state.blocks());
        for (group, out) in ops.groups.iter().zip(self.groups.chunks_exact_mut(blocks)) {
            let [a, b, c] = group.unknowns.map(|p| &state.image[p as usize * stride..][..stride]);
            for (block, out) in out.iter_mut().enumerate() {
                let mut most = T::default();
                for t in block * LANES..(block + 1) * LANES {
                    for w in &group.weights {
                        let d = w[0] * a[t] + w[1] * b[t] + w[2] * c[t];
                        most = most.max(d.abs());
                    }
                }
                *out = most;
            }
        }
        self.cells.fill(T::default());
        for round in 0..3 {
            for (group, own) in ops.groups.iter().zip(self.groups.chunks_exact(blocks)) {
                for p in group.unknowns {
                    let cells = &mut self.cells[p as usize * blocks..][..blocks];
                    cells.iter_mut().zip(own).for_each(|(c, g)| *c = c.max(*g));
                }
            }
            if round == 2 {
                break;
            }
            for (group, own) in ops.groups.iter().zip(self.groups.chunks_exact_mut(blocks)) {
                for p in group.unknowns {
                    let cells = &self.cells[p as usize * blocks..][..blocks];
                    own.iter_mut().zip(cells).for_each(|(g, c)| *g = g.max(*c));
                }
            }
        }
    }
}
