//! Step map: the step size of each unknown, shared by the frames of a span.
//!
//! ```text
//! g     = gradient of the images, dilated by two, and what else is expected to change
//! tau   = c sqrt(max(g, floor X) / X)          X: scale of the images
//! sigma = s / max tau over the unknowns of the difference,   separate s for space, time, and anchor and bounds
//! ```
//!
//! with `|D|^2 s_space + 4 s_time + s_held = 1` (exact steps in time: `|D|^2 s_space + s_time = 1`), so that
//! `|Sigma^1/2 [D; D_t; I] T^1/2| <= 1`. Steps are large where the images have gradients and small where they are
//! flat. `c` comes from the weight of a problem (causal frames), or is a fraction of the value that balances the norms
//! of images and duals in the metric of the map.

use super::differences::{Differences, for_basis};
use super::lanes::{Lane, Project, each, largest, load, splat, store};
use super::operators::Operators;
use super::problem::Problem;
use super::state::{SPAN, State};

/// Fraction of the balanced step that works best at the start, on the reference problems; a factor of
/// two either way costs a tenth of the iterations.
const SHARE: f64 = 0.6;

/// Smallest gradient in the step map, relative to the largest value of the image.
pub(crate) const FLOOR: f64 = 2e-3;

/// Smallest share of the squared dual norm assigned to each of space, time, and anchor and bounds.
const LEAST_SHARE: f64 = 0.02;

/// Returns the step that balances images and dual variables, from their squared norms; `None` if either
/// is zero.
fn balanced(image: f64, dual: f64, norm_squared: f64) -> Option<f64> {
    let step = SHARE * (image / dual / norm_squared).sqrt();
    (step > 0.0 && step.is_finite()).then_some(step)
}

/// Returns the squared norms of the regularised least-squares images of all frames, and of the forces
/// of their data.
fn linear_image(problem: &Problem<'_>) -> [f64; 2] {
    let singular = &problem.skin.singular;
    let (mut image, mut force) = (0.0, 0.0);
    let mut pull = vec![0.0; singular.len()];
    for (frame, target) in problem.targets.iter().enumerate() {
        problem.mode(frame).apply_transposed(&target.values, &mut pull);
        for (pull, s) in pull.iter().zip(singular) {
            image += (pull / (s * s + 1e-3)).powi(2);
            force += pull.powi(2);
        }
    }
    [image, force]
}

/// Returns a first guess of the step, from the least-squares images and the largest dual variables.
pub(crate) fn guess<T: Project>(
    problem: &Problem<'_>,
    ops: &Operators<T>,
    state: &State<T>,
) -> Option<f64> {
    let [image, force] = linear_image(problem);
    let frames = state.frames as f64;
    let [space, time] = ops.radius_norms;
    let mut dual = frames * (space * problem.lambda_space).powi(2);
    if problem.linked() && state.chain.is_none() {
        dual += frames * (time * problem.lambda_time).powi(2);
    }
    // limits very large weights: the duals need at most the force of the data times the skin's width
    let dual = dual.min(force * ops.unknowns() as f64);
    balanced(image, dual, total_norm(ops, state))
}

/// Returns the balanced step of an iterate.
pub(crate) fn measure<T: Project>(ops: &Operators<T>, state: &State<T>) -> Option<f64> {
    let square = |values: &[T]| values.iter().map(|v| v.to_f64().powi(2)).sum::<f64>();
    let image = state.images().map(|x| x.to_f64().powi(2)).sum();
    let duals = &state.duals;
    let space = square(&duals.flow[0]) + square(&duals.flow[1]);
    let rest = match state.chain {
        Some(_) => weighted(state.frames, state.cells, |at| duals.merged(at), |_| 1.0),
        None => square(&duals.links) + square(&duals.held),
    };
    balanced(image, space + rest, total_norm(ops, state))
}

/// Returns the squared norms of the differences in space and time, and of anchor and bounds; 0 for absent terms.
fn squared_norms<T: Project>(ops: &Operators<T>, state: &State<T>) -> [f64; 3] {
    if state.chain.is_some() {
        return [ops.norm_squared, 1.0, 0.0];
    }
    let time = if state.duals.links.is_empty() { 0.0 } else { 4.0 };
    let held = if state.duals.held.is_empty() { 0.0 } else { 1.0 };
    [ops.norm_squared, time, held]
}

fn total_norm<T: Project>(ops: &Operators<T>, state: &State<T>) -> f64 {
    // a basis without differences (one pixel) and without bounds has no dual step
    squared_norms(ops, state).iter().sum::<f64>().max(1.0)
}

/// Sets one step for all unknowns.
pub(crate) fn set_uniform<T: Project>(ops: &Operators<T>, state: &mut State<T>, tau: f64) {
    let tau = T::from_f64(tau);
    for own in state.tau.chunks_exact_mut(state.cells) {
        own.iter_mut().zip(&ops.inside).for_each(|(own, inside)| *own = *inside * tau);
    }
    set_even(ops, state);
}

/// Sets `Sigma` with equal `sigma tau` for space, time, and anchor and bounds.
pub(crate) fn set_even<T: Project>(ops: &Operators<T>, state: &mut State<T>) {
    state.split = [1.0 / total_norm(ops, state); 3];
    set_sigma(ops, state);
}

/// Sets a share of the balanced steps from the gradient of the images, with a smallest gradient relative to the
/// largest value. Returns false and changes nothing if the images or the duals are zero or not finite.
pub(crate) fn set_map<T: Project>(
    ops: &Operators<T>,
    state: &mut State<T>,
    scratch: &mut MapScratch<T>,
    [share, floor]: [f64; 2],
) -> bool {
    let size = state.size();
    if !(size > 0.0 && size.is_finite()) {
        return false;
    }
    scratch.before.copy_from_slice(&state.tau);
    scratch.clear();
    scratch.take(state.images());
    scratch.raise_to_gradient(ops, state.frames);
    scratch.set_tau(state, ops, size, floor, 1.0);
    let split = std::mem::replace(&mut state.split, [1.0; 3]);
    set_sigma(ops, state);
    let factor = balance(ops, state);
    match factor {
        Some(factor) => {
            let factor = T::from_f64(share * factor);
            state.tau.iter_mut().for_each(|tau| *tau = factor * *tau);
        }
        None => {
            state.split = split;
            state.tau.copy_from_slice(&scratch.before);
        }
    }
    set_sigma(ops, state);
    factor.is_some()
}

/// Returns the sum of the squares of `value`, `[frame][length]`, times the weight of the step of its span.
pub(crate) fn weighted(
    frames: usize,
    length: usize,
    value: impl Fn(usize) -> f64,
    weight: impl Fn(usize) -> f64,
) -> f64 {
    let mut sum = 0.0;
    for frame in 0..frames {
        let (first, step) = (frame * length, frame / SPAN * length);
        for i in 0..length {
            let value = value(first + i);
            // padding has no step
            if value != 0.0 {
                sum += value * value * weight(step + i);
            }
        }
    }
    sum
}

/// Splits `sum |.|^2 sigma tau <= 1` between the duals of space, time, and anchor and bounds according to their
/// norms, and returns the factor that balances images and duals.
///
/// ```text
/// min  sum_i N_i / s_i  with  sum_i c_i s_i = 1:     s_i = sqrt(N_i / c_i) / sum_j sqrt(c_j N_j)
/// ```
///
/// with `N_i` the squared norms of the duals, weighted by `tau`, and `c_i` the squared operator norms. The steps must
/// be those of a split of 1.
fn balance<T: Project>(ops: &Operators<T>, state: &mut State<T>) -> Option<f64> {
    let State { frames, cells, groups, origin, change, duals, tau, .. } = &*state;
    let (frames, cells) = (*frames, *cells);
    let x = |at: usize| (origin[at] + change[at]).to_f64();
    let mean = |frame: usize| {
        let own = ops.places.cells.iter().map(|cell| x(frame * cells + cell));
        own.sum::<f64>() / ops.unknowns() as f64
    };
    let means: Vec<f64> = (0..if state.is_centred { frames } else { 0 }).map(mean).collect();
    let deviation = |at: usize| x(at) - means.get(at / cells).unwrap_or(&0.0);
    let image = weighted(frames, cells, deviation, |step| state.cell_step[step].to_f64());
    let tau = |step: usize| tau[step].to_f64();
    let per_sigma = |step: usize| 1.0 / state.group_step[step].to_f64();
    let of_flow = |q: &[T]| weighted(frames, *groups, |at| q[at].to_f64(), per_sigma);
    let space = of_flow(&duals.flow[0]) + of_flow(&duals.flow[1]);
    let carried = match state.chain {
        Some(_) => [space, weighted(frames, cells, |at| duals.merged(at), tau), 0.0],
        None => {
            let of = |q: &[T]| {
                let known = if q.is_empty() { 0 } else { frames };
                weighted(known, cells, |at| q[at].to_f64(), tau)
            };
            [space, of(&duals.links), of(&duals.held)]
        }
    };
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
    /// Scale of the expected changes, `[span][cell]`.
    scale: Vec<T>,
    images: Vec<T>,
    spread: Vec<T>,
    groups: Vec<T>,
    /// Previous steps, restored if no map can be computed.
    before: Vec<T>,
}

impl<T: Project> MapScratch<T> {
    pub(crate) fn new(state: &State<T>) -> Self {
        Self {
            scale: state.tau.clone(),
            images: state.origin.clone(),
            spread: vec![T::default(); state.cells],
            groups: vec![T::default(); state.groups],
            before: state.tau.clone(),
        }
    }

    /// Resets the scale.
    pub(crate) fn clear(&mut self) {
        self.scale.fill(T::default());
    }

    /// Raises the scale of a single frame to at least `share` times the absolute values, over cells.
    pub(crate) fn raise(&mut self, values: &[T], share: f64) {
        let share = T::from_f64(share);
        for (scale, value) in self.scale.iter_mut().zip(values) {
            *scale = scale.max(share * value.abs());
        }
    }

    /// Takes images, over cells.
    pub(crate) fn take(&mut self, images: impl Iterator<Item = T>) {
        self.images.iter_mut().zip(images).for_each(|(own, x)| *own = x);
    }

    /// Raises the scale to at least the dilated gradient of the images.
    pub(crate) fn raise_to_gradient(&mut self, ops: &Operators<T>, frames: usize) {
        for_basis!(ops, |differences| self.dilate(ops, differences, frames));
    }

    /// Sets `tau = factor sqrt(max(scale, floor size) / size)`; returns the largest.
    pub(crate) fn set_tau(
        &self,
        state: &mut State<T>,
        ops: &Operators<T>,
        size: f64,
        floor: f64,
        factor: f64,
    ) -> f64 {
        let (floor, factor) = (T::from_f64(floor), T::from_f64(factor));
        let per_size = T::from_f64(1.0 / size);
        let mut most: Lane<T> = splat(T::default());
        for span in 0..state.spans() {
            for &at in &ops.places.blocks {
                let here = span * state.cells + at;
                let (g, inside) = (load(&self.scale, here), load(&ops.inside, at));
                let own = each!(|l| inside[l] * (factor * (g[l] * per_size).max(floor).sqrt()));
                store(&mut state.tau, here, own);
                most = each!(|l| most[l].max(own[l]));
            }
        }
        largest(&most).to_f64()
    }

    /// Computes the largest differences of the images of each span, dilated by two groups.
    #[inline(always)]
    fn dilate<D: Differences<T>>(&mut self, ops: &Operators<T>, differences: &D, frames: usize) {
        let Self { scale, images, spread, groups, .. } = self;
        let cells = ops.cells();
        for (span, scale) in scale.chunks_exact_mut(cells).enumerate() {
            groups.fill(T::default());
            for frame in span * SPAN..frames.min((span + 1) * SPAN) {
                let image = &images[frame * cells..][..cells];
                for &at in differences.group_blocks() {
                    let ([a, b], old) = (differences.difference(image, at), load(groups, at));
                    store(groups, at, each!(|l| old[l].max(a[l].abs().max(b[l].abs()))));
                }
            }
            for round in 0..3 {
                for (block, &at) in ops.places.blocks.iter().enumerate() {
                    store(spread, at, differences.cell_largest(groups, block, at));
                }
                if round < 2 {
                    for &at in differences.group_blocks() {
                        store(groups, at, differences.group_largest(spread, at));
                    }
                }
            }
            for &at in &ops.places.blocks {
                let (old, new) = (load(scale, at), load(spread, at));
                store(scale, at, each!(|l| old[l].max(new[l])));
            }
        }
    }
}

/// Computes `1 / tau` of the cells and `Sigma` of the groups.
fn set_sigma<T: Project>(ops: &Operators<T>, state: &mut State<T>) {
    for_basis!(ops, |differences| sigma(ops, differences, state));
}

#[inline(always)]
fn sigma<T: Project, D: Differences<T>>(ops: &Operators<T>, differences: &D, state: &mut State<T>) {
    let space = T::from_f64(state.split[0]);
    // smaller than any step: groups and cells without an unknown
    let tiny = T::from_f64(f64::from(f32::MIN_POSITIVE).sqrt());
    let State { cells, groups, tau, cell_step, group_step, .. } = state;
    let spans = tau.chunks_exact(*cells).zip(cell_step.chunks_exact_mut(*cells));
    for ((tau, cell), group) in spans.zip(group_step.chunks_exact_mut((*groups).max(1))) {
        for &at in &ops.places.blocks {
            let (own, inside) = (load(tau, at), load(&ops.inside, at));
            store(cell, at, each!(|l| inside[l] / own[l].max(tiny)));
        }
        for &at in differences.group_blocks() {
            let own = differences.group_largest(tau, at);
            store(group, at, each!(|l| space / own[l].max(tiny)));
        }
    }
}
