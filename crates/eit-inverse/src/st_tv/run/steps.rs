//! Iterations of a run, and the steps that they take.

use super::super::engine::Engine;
use super::super::iterate::Pace;
use super::super::lanes::Project;
use super::super::schedule::{CLOCK, SMOOTHING};
use super::super::step;
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
    /// Performs iterations until there are `until` of them; returns true if a limit was reached first.
    pub(super) fn improve(&mut self, until: usize, limits: Limits) -> Result<bool, InverseError> {
        let until = until.min(limits.iterations);
        while self.record.iterations < until {
            if self.record.iterations >= self.schedule.evaluated + REFRESH {
                self.keep_image(false);
            }
            self.set_steps()?;
            let done = self.record.iterations;
            let mut next = until.min(self.schedule.evaluated + REFRESH);
            for at in MEASURE_AT.into_iter().chain([self.schedule.next_map]) {
                next = if at > done { next.min(at) } else { next };
            }
            if limits.seconds.is_finite() {
                next = next.min((done + 1).next_multiple_of(CLOCK));
            }
            let pace = Pace { smoothing: self.schedule.smoothing, rho: RHO };
            let Engine { state, data, .. } = &mut self.engine;
            state.iterate(self.ops, &self.problem, data, pace, next - done);
            self.record.iterations = next;
            if self.start.elapsed().as_secs_f64() >= limits.seconds {
                return Ok(true);
            }
        }
        Ok(self.record.iterations >= limits.iterations)
    }

    /// Updates the steps when due.
    fn set_steps(&mut self) -> Result<(), InverseError> {
        let done = self.record.iterations;
        if !self.schedule.is_mapped
            && MEASURE_AT.contains(&done)
            && let Some(tau) = step::measure(self.ops, &self.engine.state)
        {
            self.set_uniform(tau)?;
        }
        if done < self.schedule.next_map {
            return Ok(());
        }
        let later = MAP_AT.iter().find(|&&at| at > done);
        self.schedule.next_map = later.map_or((done as f64 * MAP_GROWTH) as usize, |&at| at);
        let floor = step::FLOOR * (done as f64 / FLAT_FROM).max(1.0);
        let Engine { state, map, .. } = &mut self.engine;
        if !step::set_map(self.ops, state, map, [SHARE * self.schedule.boost, floor]) {
            return Ok(());
        }
        self.schedule.is_mapped = true;
        let fading = (SMOOTH / done as f64).powi(2).min(1.0);
        self.schedule.smoothing = SMOOTHING * self.problem.target_gap * state.size() * fading;
        // an infeasible image's error still exceeds the margin
        let fading = if self.schedule.is_feasible { fading } else { 1.0 };
        self.engine.data.margin = self.margin() * fading;
        self.engine.set_data(&self.problem, self.ops)
    }

    /// Returns the reduction of the radii of data constraints: none without bounds.
    pub(super) fn margin(&self) -> f64 {
        self.problem.bounds.map_or(0.0, |_| MARGIN * self.problem.target_gap.min(1.0))
    }

    /// Returns the step of a problem without any duals: nothing but the rounding of the data step limits it.
    pub(super) fn free_step(&self) -> Option<f64> {
        let strongest = self.problem.skin.singular.first()?;
        let duals = &self.engine.state.duals;
        let is_free =
            self.ops.norm_squared == 0.0 && duals.links.is_empty() && duals.held.is_empty();
        is_free.then_some(ROUNDING / T::EPSILON / strongest.powi(2))
    }

    pub(super) fn set_uniform(&mut self, tau: f64) -> Result<(), InverseError> {
        step::set_uniform(self.ops, &mut self.engine.state, tau);
        self.engine.set_data(&self.problem, self.ops)
    }

    /// Increases the steps if the image travels further than the duals, and decreases them in the opposite case.
    pub(super) fn balance(&mut self) {
        let Some(travel) = &mut self.travel else {
            self.travel = Some(Travel::from(&self.engine.state));
            return;
        };
        let factor = travel.ratio(&self.engine.state).sqrt().clamp(1.0 / MOST_CHANGE, MOST_CHANGE);
        if (1.0 / LEAST_CHANGE..LEAST_CHANGE).contains(&factor) {
            return;
        }
        let boost = (self.schedule.boost * factor).clamp(BOOSTS[0], BOOSTS[1]);
        if boost != self.schedule.boost {
            self.schedule.boost = boost;
            // takes effect with the next map, which is due now
            self.schedule.next_map = self.record.iterations;
        }
    }
}
