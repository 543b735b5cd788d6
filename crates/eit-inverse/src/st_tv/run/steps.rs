//! Iterations of a run, and the steps that they take.

use super::super::iterate::Pace;
use super::super::lanes::Project;
use super::super::schedule::{CLOCK, SMOOTHING};
use super::super::step::{self, MapSize};
use super::super::travel::Travel;
use super::{Limits, Run};
use crate::InverseError;

/// Over-relaxation factor.
const RHO: f64 = 1.9;
/// Most iterations between two evaluations, at which the force of the tail is updated.
const REFRESH: usize = 32;
/// Iterations at which the uniform step is updated, before the first step map.
const MEASURE_AT: [usize; 2] = [8, 16];
/// Iterations at which a step map is computed, and the factor between later ones.
pub(super) const MAP_AT: [usize; 3] = [24, 64, 150];
const MAP_GROWTH: f64 = 2.0;
/// Steps of the map relative to balanced ones. Smaller ones favour the image, larger ones the bound; a factor of
/// 1.7 either way costs a tenth of the iterations.
pub(super) const SHARE: f64 = 0.2;
/// Factors on the steps by which a long run follows the distances that images and duals travel: the square root
/// of their ratio, not less than `LEAST_CHANGE` and not more than `MOST_CHANGE` at a time, and within these limits in
/// all. Duals travel on where nothing depends on them, so that the lower limit is close: with 1/1024 the reference
/// problem of 32 x 32 took 3 924 iterations to 1e-5 instead of some 1 400. Of 300 000 random problems 7 reach the limit
/// of 20 000 iterations, without any of this 4 of 30 000. With bounds at 0 the reference problem takes 1 000 iterations
/// to 1e-3 instead of 2 183, with three of its channels 1 350 to 1e-2 instead of more than 20 000.
const MOST_CHANGE: f64 = 4.0;
const LEAST_CHANGE: f64 = 1.5;
const BOOSTS: [f64; 2] = [1.0 / 16.0, 1024.0];
/// Step without any duals, times the largest squared singular value and the accuracy of a number.
const ROUNDING: f64 = 1e-2;
/// Number of iterations after which the least step of the map grows in proportion to the iterations:
/// errors where the image is flat are the last to vanish, and small steps keep them.
const FLAT_FROM: f64 = 300.0;
/// Reduction of the radii of data constraints, relative to the target gap.
const MARGIN: f64 = 0.05;
/// Number of iterations after which the smoothing decreases, so that it vanishes if the gap takes long to reach.
const SMOOTH: f64 = 400.0;

impl<T: Project> Run<'_, T> {
    /// Iterates until `self.done` is `until`; returns true if a limit was reached first.
    pub(super) fn improve(&mut self, until: usize, limits: Limits) -> Result<bool, InverseError> {
        while self.done < until {
            if self.done >= self.evaluated + REFRESH {
                self.keep_image(false);
            }
            self.set_steps()?;
            let events =
                MEASURE_AT.iter().copied().chain([self.next_map, until, limits.iterations]);
            let event = events.filter(|&at| at > self.done).min().unwrap_or(until);
            let clock = (self.done + 1).next_multiple_of(CLOCK);
            let next = if limits.seconds.is_finite() { clock.min(event) } else { event };
            self.iterate(next.min(self.evaluated + REFRESH) - self.done);
            let late = self.progress.start.elapsed().as_secs_f64() >= limits.seconds;
            if late || self.done >= limits.iterations {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Updates the steps when due.
    fn set_steps(&mut self) -> Result<(), InverseError> {
        if !self.mapped
            && MEASURE_AT.contains(&self.done)
            && let Some(tau) = step::measure(self.ops, &self.state)
        {
            self.set_uniform(tau)?;
        }
        if self.done < self.next_map {
            return Ok(());
        }
        let later = MAP_AT.iter().find(|&&at| at > self.done);
        self.next_map = later.map_or((self.done as f64 * MAP_GROWTH) as usize, |&at| at);
        let steps = MapSize {
            share: SHARE * self.boost,
            floor: step::FLOOR * (self.done as f64 / FLAT_FROM).max(1.0),
        };
        let arch = self.task.solver.skin.arch;
        if step::set_map(arch, self.ops, &mut self.state, &mut self.map, steps) {
            self.mapped = true;
            let fading = (SMOOTH / self.done as f64).powi(2).min(1.0);
            self.smoothing = SMOOTHING * self.target_gap * self.state.size() * fading;
            // an infeasible image's error still exceeds the margin
            let fading = if self.is_feasible { fading } else { 1.0 };
            self.data.margin = self.margin() * fading;
            self.set_data()?;
        }
        Ok(())
    }

    /// Returns the reduction of the radii of data constraints: none without bounds.
    pub(super) fn margin(&self) -> f64 {
        if self.task.bounds.is_some() { MARGIN * self.target_gap.min(1.0) } else { 0.0 }
    }

    /// Returns the step of a problem without any duals: nothing but the rounding of the data step limits it.
    pub(super) fn free_step(&self) -> Option<f64> {
        let strongest = self.task.solver.skin.singular.first()?;
        let is_free = self.ops.norm_squared == 0.0
            && self.state.links.is_empty()
            && self.state.force.is_empty();
        is_free.then_some(ROUNDING / T::EPSILON / strongest.powi(2))
    }

    pub(super) fn set_uniform(&mut self, tau: f64) -> Result<(), InverseError> {
        step::set_uniform(self.task.solver.skin.arch, self.ops, &mut self.state, tau);
        self.set_data()
    }

    /// Recomputes the data steps for the current step map.
    pub(super) fn set_data(&mut self) -> Result<(), InverseError> {
        let problem = self.problem();
        let Self { ops, data, state, .. } = self;
        data.set_map(&problem, ops, state)?;
        data.set_tail(&problem, ops, state, None);
        Ok(())
    }

    /// Increases the steps if the image travels further than the duals, and decreases them in the opposite case.
    pub(super) fn balance(&mut self) {
        let Some(travel) = &mut self.travel else {
            self.travel = Some(Travel::from(&self.state));
            return;
        };
        let ratio = travel.ratio(&self.state);
        let factor = ratio.sqrt().clamp(1.0 / MOST_CHANGE, MOST_CHANGE);
        if (1.0 / LEAST_CHANGE..LEAST_CHANGE).contains(&factor) {
            return;
        }
        let boost = (self.boost * factor).clamp(BOOSTS[0], BOOSTS[1]);
        if boost != self.boost {
            self.boost = boost;
            // takes effect with the next map, which is due now
            self.next_map = self.done;
        }
    }

    /// Performs iterations; the last one's images are the candidate.
    fn iterate(&mut self, count: usize) {
        let problem = self.problem();
        let pace = Pace { smoothing: self.smoothing, rho: RHO };
        let Self { task, ops, state, data, .. } = self;
        state.iterate(task.solver.skin.arch, ops, &problem, data, pace, count);
        self.done += count;
    }
}
