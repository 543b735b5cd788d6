//! Dual variables of the terms of a problem but its data.

use super::differences::{Differences, for_basis};
use super::float::Float;
use super::lanes::{Lane, Project, each, largest, load, splat};
use super::operators::Operators;
use super::problem::Problem;

/// Arrays are `[frame][group]` or `[frame][cell]` in the layout of [`super::differences`].
#[derive(Debug, Clone)]
pub(crate) struct Duals<T> {
    pub(crate) cells: usize,
    pub(crate) groups: usize,
    /// `q`, the dual of the gradient, by component.
    pub(crate) flow: [Vec<T>; 2],
    /// `q_t`, the dual of the link to the frame before, between two rows of zeros; empty without links.
    pub(crate) links: Vec<T>,
    /// `p`, the joint dual of anchor and bounds; empty without both.
    pub(crate) held: Vec<T>,
}

impl<T: Project> Duals<T> {
    pub(crate) fn new(ops: &Operators<T>, problem: &Problem<'_>, held: bool) -> Self {
        let (frames, cells, groups) = (problem.frames(), ops.cells(), ops.groups);
        let zeros =
            |is_used: bool, count: usize| vec![T::default(); if is_used { count } else { 0 }];
        Self {
            cells,
            groups,
            flow: std::array::from_fn(|_| zeros(true, frames * groups)),
            links: zeros(problem.linked(), (frames + 1) * cells),
            held: zeros(held, frames * cells),
        }
    }

    /// Copies duals, times a factor; those that either side lacks stay.
    pub(crate) fn take<U: Float>(&mut self, other: &Duals<U>, factor: f64) {
        let from = [&other.flow[0], &other.flow[1], &other.links, &other.held];
        self.arrays().into_iter().zip(from).for_each(|(to, from)| convert(from, factor, to));
    }

    pub(crate) fn scale(&mut self, factor: f64) {
        let factor = T::from_f64(factor);
        self.arrays().into_iter().flatten().for_each(|v| *v = *v * factor);
    }

    pub(crate) fn arrays(&mut self) -> [&mut Vec<T>; 4] {
        let [first, second] = &mut self.flow;
        [first, second, &mut self.links, &mut self.held]
    }

    /// Returns `q` of a frame.
    #[inline(always)]
    pub(crate) fn flow_of(&self, frame: usize) -> [&[T]; 2] {
        let own = frame * self.groups..(frame + 1) * self.groups;
        [&self.flow[0][own.clone()], &self.flow[1][own]]
    }

    /// Computes `D' q + p + other + D_t' q_t` on a block of cells of a frame, whose first is `here`.
    #[inline(always)]
    pub(crate) fn pull<D: Differences<T>>(
        &self,
        differences: &D,
        q: [&[T]; 2],
        (block, at, here): (usize, usize, usize),
        other: Lane<T>,
    ) -> Lane<T> {
        let mut pull = differences.adjoint(q, block, at);
        if !self.held.is_empty() {
            let p = load(&self.held, here);
            pull = each!(|l| pull[l] + p[l]);
        }
        pull = each!(|l| pull[l] + other[l]);
        if !self.links.is_empty() {
            let (own, next) = (load(&self.links, here), load(&self.links, here + self.cells));
            pull = each!(|l| pull[l] + (own[l] - next[l]));
        }
        pull
    }

    /// Returns the largest ratio of a dual of space or time to its radius; infinite if one with radius zero is not zero.
    pub(crate) fn largest_ratio(&self, ops: &Operators<T>, space: f64, time: f64) -> f64 {
        for_basis!(ops, |differences| self.ratio(ops, differences, space, time))
    }

    #[inline(always)]
    fn ratio<D: Differences<T>>(
        &self,
        ops: &Operators<T>,
        differences: &D,
        space: f64,
        time: f64,
    ) -> f64 {
        let zero = T::default();
        let (space, time, [first, second]) = (T::from_f64(space), T::from_f64(time), &self.flow);
        let mut most = splat(zero);
        for base in (0..first.len()).step_by(self.groups.max(1)) {
            for &at in differences.group_blocks() {
                let (a, b) = (load(first, base + at), load(second, base + at));
                let radius = differences.group_radius(at);
                most = each!(|l| {
                    let norm = a[l].mul_add(a[l], b[l] * b[l]).sqrt();
                    let ratio = norm / (space * radius[l]);
                    if norm > zero && ratio > most[l] { ratio } else { most[l] }
                });
            }
        }
        for base in (0..self.links.len()).step_by(self.cells) {
            for &at in &ops.places.blocks {
                let (q, radius) = (load(&self.links, base + at), differences.cell_radius(at));
                most = each!(|l| {
                    let ratio = q[l].abs() / (time * radius[l]);
                    if q[l] != zero && ratio > most[l] { ratio } else { most[l] }
                });
            }
        }
        largest(&most).to_f64()
    }

    /// Returns `D_t' q_t + p`.
    pub(crate) fn merged(&self, at: usize) -> f64 {
        let held = self.held.get(at).copied().unwrap_or_default();
        ((self.links[at] - self.links[at + self.cells]) + held).to_f64()
    }
}

/// Copies numbers of either type, times a factor.
pub(crate) fn convert<T: Float, U: Float>(from: &[U], factor: f64, to: &mut [T]) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to = T::from_f64(factor * from.to_f64()));
}
