//! Iterations of a stream on one frame.

use super::super::certificate::{Effort, Iterate, LARGEST_WEIGHT};
use super::super::schedule::{CLOCK, FLOW_STEPS, LEAN, MAP_EVERY, MEASURE_AT, POWER, SMOOTHING};
use super::super::settings::StreamSettings;
use super::super::single_frame::Outcome;
use super::super::state::Weights;
use super::super::step::{self, MapSize};
use super::StTvStream;
use crate::{InverseError, SequenceStatus};
use std::time::Instant;

/// Steps of the map relative to balanced ones: a compromise between fast convergence of the image and of
/// the bound.
const SHARE: f64 = 0.4;
/// Additional factor on the steps with bounds, whose duals need large changes, as in a causal frame.
const BOUNDED_SHARE: f64 = 0.3;
/// Number of iterations of a push after which the smoothing decreases.
const SMOOTH: f64 = 120.0;
/// Iterations after rest at which maps are computed.
const MAP_AT: [usize; 3] = [24, 48, 96];
/// Effort of a bound, as for a whole sequence but with half as many rounds.
const ROUNDS: usize = 6;
const SLACK: f64 = 0.3;
/// Steps of the flow for a bound that keeps the data dual.
const PLAIN_FLOW_STEPS: usize = 50;
/// Growth of the squared linear images since the last map that makes the map useless. A new touch has
/// appeared where its steps are small, and the steps are determined as after rest.
const ONSET: f64 = 4.0;
/// Iterations of a push after which the map is stale. A new one is computed then, and whenever the
/// iterations have doubled.
const STALE: usize = 150;
/// Iterations before the first evaluation of the first push, and minimum of any first round.
pub(super) const FIRST_ROUND: usize = 20;
/// First round of a push as a fraction of the iterations of the previous push, because evaluations are
/// expensive; and length of later rounds as a fraction of all iterations so far.
const BEGIN: f64 = 0.85;
const GROWTH: f64 = 0.15;

impl StTvStream {
    /// Alternates rounds of iterations and evaluations.
    pub(super) fn iterate(&mut self, start: Instant) -> Result<Outcome, InverseError> {
        self.resting = false;
        let StreamSettings { target_gap, max_iterations, deadline, .. } = self.settings;
        let deadline = deadline.map_or(f64::INFINITY, |d| d.as_secs_f64());
        let mut outcome = Outcome {
            status: SequenceStatus::Converged,
            iterations: 0,
            primal: f64::INFINITY,
            lower_bound: f64::NEG_INFINITY,
        };
        self.set_first_steps()?;
        let mut round = self.expected.max(FIRST_ROUND);
        let mut next_map = STALE;
        // time of an evaluation; unknown before the first one
        let mut look_s = 0.0;
        loop {
            let count = round.min(max_iterations - outcome.iterations);
            let done = self.run(count, start, deadline - look_s)?;
            outcome.iterations += done;
            let before = Instant::now();
            let last = [outcome.primal, outcome.lower_bound];
            self.look(&mut outcome);
            look_s = before.elapsed().as_secs_f64();
            // if the gap is below the target, the next push can use fewer iterations
            let spare = (outcome.gap() / target_gap).powf(1.0 / POWER).clamp(0.5, 1.0);
            // capped, because a sudden event does not predict the frame after it
            self.expected = ((outcome.iterations as f64 * BEGIN * spare) as usize).min(STALE);
            round = ((outcome.iterations as f64 * GROWTH) as usize).max(CLOCK);
            if outcome.gap() <= target_gap {
                return Ok(outcome);
            }
            if done < count || start.elapsed().as_secs_f64() >= deadline {
                return Ok(Outcome { status: SequenceStatus::Deadline, ..outcome });
            }
            if outcome.iterations >= max_iterations {
                return Ok(Outcome { status: SequenceStatus::IterationCap, ..outcome });
            }
            // With bounds a new map within a frame slows convergence: the frame after a release takes 1037
            // iterations without new maps, more than 2000 with them.
            if outcome.iterations >= next_map && self.frame.bounds.is_none() {
                next_map = 2 * outcome.iterations;
                let raised = outcome.lower_bound - last[1];
                self.rebalance(raised, last[0] - outcome.primal);
                self.set_map()?;
            }
        }
    }

    /// Sets the steps of the first iterations: uniform after rest and after an onset, otherwise those of the
    /// frame before, and a new map now and then.
    fn set_first_steps(&mut self) -> Result<(), InverseError> {
        let [linear, _] = step::linear_image(&self.frame.problem(&self.solver));
        if linear > ONSET * self.mapped {
            self.since_rest = 0;
            self.expected = FIRST_ROUND;
        }
        self.mapped = if self.since_rest == 0 { linear } else { self.mapped };
        self.spent = 0;
        self.boost = 1.0;
        let is_cold = self.since_rest < MAP_AT[MAP_AT.len() - 1];
        if self.since_rest == 0 {
            let problem = self.frame.problem(&self.solver);
            let step = step::guess(&problem, &self.solver.single, &self.state).unwrap_or(1.0);
            return self.set_uniform(step);
        }
        if !is_cold && self.pushed.is_multiple_of(MAP_EVERY) {
            self.mapped = linear;
            return self.set_map();
        }
        self.assign()
    }

    /// Lengthens the steps if the bound has improved far more than the image since the last look, and
    /// shortens them in the opposite case.
    fn rebalance(&mut self, raised: f64, fallen: f64) {
        if raised > 8.0 * fallen {
            self.boost = (self.boost * 1.5).min(16.0);
        } else if fallen > 8.0 * raised {
            self.boost = (self.boost / 1.5).max(1.0 / 16.0);
        }
    }

    /// Evaluates the candidate and computes a lower bound; keeps the best of each.
    fn look(&mut self, outcome: &mut Outcome) {
        let Self { solver, frame, evaluation, state, data, flow, .. } = self;
        let problem = frame.problem(solver);
        let primal = evaluation.primal(solver.arch, &problem, state);
        if primal < outcome.primal || outcome.primal == f64::INFINITY {
            outcome.primal = primal;
            self.best.copy_from_slice(&evaluation.image);
            self.best_residual.copy_from_slice(&evaluation.residual);
        }
        let iterate = Iterate { ops: &solver.single, state, data };
        let target_gap = self.settings.target_gap;
        let (slack, lean) = (SLACK * target_gap, LEAN * target_gap);
        let effort = match self.is_plain {
            true => Effort::plain(PLAIN_FLOW_STEPS, target_gap),
            false => Effort { rounds: ROUNDS, steps: FLOW_STEPS, slack, lean },
        };
        let bound = evaluation.lower_bound(solver.arch, &problem, iterate, flow, effort);
        if bound <= outcome.lower_bound {
            self.is_plain = !self.is_plain;
        }
        outcome.lower_bound = outcome.lower_bound.max(bound);
    }

    /// Runs up to `count` iterations until the deadline and returns their number, at least one. The last
    /// iteration stores its image as the candidate.
    fn run(&mut self, count: usize, start: Instant, deadline: f64) -> Result<usize, InverseError> {
        let [lambda_space, lambda_time] = self.frame.weights.map(|w| w.min(LARGEST_WEIGHT));
        for k in 0..count {
            if MEASURE_AT.contains(&self.since_rest) {
                if let Some(step) = step::measure(&self.solver.single, &self.state) {
                    self.set_uniform(step)?;
                }
            } else if MAP_AT.contains(&self.since_rest) {
                self.set_map()?;
            }
            self.since_rest += 1;
            self.spent += 1;
            let clock = (k + 1).is_multiple_of(CLOCK);
            let late = clock && start.elapsed().as_secs_f64() >= deadline;
            let (bounds, smoothing) = (self.frame.bounds, self.smoothing);
            let weights = Weights { lambda_space, lambda_time, bounds, smoothing };
            let Self { solver, state, data, .. } = self;
            let last = late || k + 1 == count;
            state.iterate(solver.arch, &solver.single, &weights, data, last);
            if late {
                return Ok(k + 1);
            }
        }
        Ok(count)
    }

    fn set_uniform(&mut self, step: f64) -> Result<(), InverseError> {
        self.smoothing = 0.0;
        step::set_uniform(&self.solver.single, &mut self.state, step);
        self.set_data()
    }

    /// Computes a step map from the current image.
    fn set_map(&mut self) -> Result<(), InverseError> {
        let Self { solver, state, map, frame, .. } = self;
        let bounded = if frame.bounds.is_some() { BOUNDED_SHARE } else { 1.0 };
        let steps = MapSize { share: bounded * self.boost * SHARE, floor: step::FLOOR };
        if step::set_map(&solver.single, state, map, steps) {
            let size = state.image.iter().fold(0.0_f32, |most, x| most.max(x.abs()));
            let fading = (SMOOTH / self.spent.max(1) as f64).powi(2).min(1.0);
            self.smoothing = SMOOTHING * self.settings.target_gap * f64::from(size) * fading;
        }
        self.set_data()
    }

    /// Recomputes the data steps for the current step map.
    fn set_data(&mut self) -> Result<(), InverseError> {
        let Self { solver, frame, state, data, .. } = self;
        state.disturb();
        data.set_map(solver.arch, &frame.problem(solver), &solver.single, state)
    }

    /// Assigns the data steps for the channels and data of the frame.
    fn assign(&mut self) -> Result<(), InverseError> {
        let Self { solver, frame, state, data, .. } = self;
        state.disturb();
        data.assign(solver.arch, &frame.problem(solver), &solver.single, state)
    }
}
