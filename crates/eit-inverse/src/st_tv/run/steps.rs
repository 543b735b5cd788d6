//! Iterations of a run, and the steps that they take.

use super::super::certificate::LARGEST_WEIGHT;
use super::super::float::Float;
use super::super::schedule::{CLOCK, MEASURE_AT, SMOOTHING};
use super::super::state::Weights;
use super::super::step::{self, MapSize};
use super::super::travel::Travel;
use super::{Limits, Run};
use crate::InverseError;

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
/// Number of iterations after which the smoothing decreases, so that it vanishes if the gap takes long to reach.
const SMOOTH: f64 = 400.0;

impl<T: Float> Run<'_, T> {
    /// Iterates until `self.done` is `until`; returns true if a limit was reached first.
    pub(super) fn improve(&mut self, until: usize, limits: Limits) -> Result<bool, InverseError> {
        while self.done < until {
            self.set_steps()?;
            let clock = self.done.is_multiple_of(CLOCK);
            let late = clock && self.progress.start.elapsed().as_secs_f64() >= limits.seconds;
            let ended = late || self.done + 1 >= limits.iterations;
            self.iterate(ended || self.done + 1 == until);
            if ended {
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
        if step::set_map(self.ops, &mut self.state, &mut self.map, steps) {
            self.mapped = true;
            let size = self.state.image.iter().fold(0.0_f64, |most, x| most.max(x.to_f64().abs()));
            let fading = (SMOOTH / self.done as f64).powi(2).min(1.0);
            self.smoothing = SMOOTHING * self.target_gap * size * fading;
            // an infeasible image's error still exceeds the margin
            self.data.fading = if self.is_feasible { fading } else { 1.0 };
            self.set_data()?;
        }
        Ok(())
    }

    /// Returns the step of a problem without any duals: nothing but the rounding of the data step limits it.
    pub(super) fn free_step(&self) -> Option<f64> {
        let state = &self.state;
        let duals = [&state.dual, &state.time_dual, &state.bound_dual];
        let strongest = self.task.problem().singular.first()?;
        let is_free = duals.iter().all(|dual| dual.is_empty());
        is_free.then_some(ROUNDING / T::EPSILON / strongest.powi(2))
    }

    pub(super) fn set_uniform(&mut self, tau: f64) -> Result<(), InverseError> {
        step::set_uniform(self.ops, &mut self.state, tau);
        self.set_data()
    }

    /// Recomputes the data steps for the current step map.
    pub(super) fn set_data(&mut self) -> Result<(), InverseError> {
        let Self { task, ops, data, state, .. } = self;
        state.disturb();
        data.set_map(task.solver.arch, &task.problem(), ops, state)
    }

    /// Increases the steps if the image travels further than the duals, and decreases them in the opposite case.
    pub(super) fn balance(&mut self) {
        let Some(travel) = &mut self.travel else {
            self.travel = Some(Travel::from(&self.state));
            return;
        };
        let ratio = travel.ratio(self.ops, &self.state);
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

    /// Performs one iteration.
    fn iterate(&mut self, keep: bool) {
        let Self { task, ops, state, data, .. } = self;
        let weights = Weights {
            lambda_space: task.lambda_space.min(LARGEST_WEIGHT),
            lambda_time: task.lambda_time.min(LARGEST_WEIGHT),
            bounds: task.bounds,
            smoothing: self.smoothing,
        };
        state.iterate(task.solver.arch, ops, &weights, data, keep);
        self.done += 1;
    }
}
