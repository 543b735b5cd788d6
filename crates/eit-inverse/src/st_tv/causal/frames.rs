//! Frames of a stream: what one keeps for the next.

use super::super::engine::Engine;
use super::super::operators::Operators;
use super::super::problem::Problem;
use super::super::record::Record;
use super::super::schedule::{SINGLE_PRECISION_GAP, SMOOTHING};
use super::frame::{BOUNDED_STEP, Frame, Limits, Scale, is_nothing};
use super::proof::Proof;
use super::settings::CausalSettings;
use crate::{InverseError, SequenceStatus};
use std::time::Instant;

/// Number of frames of a steady stream between two step maps.
const MAP_EVERY: usize = 4;
/// An innovation larger than usual by this factor is an event, for which a new map is computed.
const EVENT: f64 = 1.5;
/// Number of `f32` iterations after which a frame continues in `f64`.
const GIVE_UP: usize = 400;

/// Engines in both floating-point types, the result of a frame, and what it keeps for the next.
#[derive(Debug, Clone)]
pub(super) struct Frames {
    single: Engine<f32>,
    double: Engine<f64>,
    pub(super) record: Record,
    pub(super) proof: Proof,
    scale: Scale,
    /// Running mean of the innovation, iterations of the last two frames, frames since the last map, and in all.
    usual: f64,
    recent: [usize; 2],
    map_age: usize,
    count: usize,
}

impl Frames {
    pub(super) fn new(problem: &Problem<'_>, single: &Operators<f32>) -> Self {
        Self {
            single: Engine::new(problem, single, 1),
            double: Engine::new(problem, &problem.skin.operators, 1),
            record: Record::new(problem),
            proof: Proof::new(problem),
            scale: Scale::default(),
            usual: 0.0,
            recent: [0; 2],
            map_age: MAP_EVERY,
            count: 0,
        }
    }

    /// Asks for a new step map.
    pub(super) fn renew_map(&mut self) {
        self.map_age = MAP_EVERY;
    }

    /// Discards the result of the last frame.
    pub(super) fn clear_result(&mut self) {
        self.record.clear();
        self.proof.clear();
    }

    /// Sets the duals to zero.
    pub(super) fn clear(&mut self) {
        self.single.state.clear();
        self.double.state.clear();
    }

    /// Changes the unit of the data to a larger one.
    pub(super) fn grow(&mut self, factor: f64, is_penalised: bool) {
        self.scale.image /= factor;
        if is_penalised {
            self.single.state.duals.scale(1.0 / factor);
            self.double.state.duals.scale(1.0 / factor);
        }
    }

    /// Counts a frame, and returns whether it needs a new step map: the last one is old, or the innovation is an event.
    fn needs_map(&mut self, problem: &Problem<'_>) -> bool {
        self.count += 1;
        self.map_age += 1;
        let rows = problem.modes[0].rows;
        let size = problem.beta(0)[..rows].iter().map(|b| b * b).sum::<f64>().sqrt();
        let is_event = size > EVENT * self.usual || self.count <= 2;
        let step = 0.1 * (size.min(2.0 * self.usual) - self.usual);
        self.usual = if self.count <= 2 { size } else { self.usual + step };
        self.map_age > MAP_EVERY || is_event
    }

    /// Evaluates the previous image, often the best one without motion, and the zero image; returns the status if
    /// either needs no iteration.
    fn try_known(&mut self, problem: &Problem<'_>) -> Option<SequenceStatus> {
        let record = &mut self.record;
        record.candidate.change.fill(0.0);
        record.candidate.evaluate::<f32>(problem, None);
        record.take();
        let is_nothing = is_nothing(problem, record);
        if !is_nothing && record.primal != 0.0 {
            return None;
        }
        record.lower_bound = 0.0;
        Some(if is_nothing { SequenceStatus::Stalled } else { SequenceStatus::Converged })
    }

    /// Solves a frame.
    pub(super) fn solve(
        &mut self,
        problem: &Problem<'_>,
        ops: &Operators<f32>,
        settings: &CausalSettings,
        start: Instant,
    ) -> Result<SequenceStatus, InverseError> {
        let is_stale = self.needs_map(problem);
        self.clear_result();
        self.scale.step = if problem.bounds.is_some() { BOUNDED_STEP } else { 1.0 };
        self.scale.smoothing = SMOOTHING * problem.target_gap * self.scale.image;
        if let Some(status) = self.try_known(problem) {
            return Ok(status);
        }
        let Self { single, double, record, proof, scale, .. } = self;
        let mut limits = Limits {
            iterations: settings.max_iterations,
            start,
            deadline: settings.deadline.map_or(f64::INFINITY, |d| d.as_secs_f64()),
            give_up: GIVE_UP,
            first_look: self.recent[0].min(self.recent[1]).saturating_sub(4),
        };
        let is_single = problem.target_gap >= SINGLE_PRECISION_GAP;
        let mut status = None;
        if is_single {
            let own = *scale;
            let mut frame = Frame { problem, ops, engine: single, scale: own, record, proof };
            frame.begin();
            if is_stale {
                frame.set_first_map()?;
                *scale = frame.scale;
                self.map_age = 1;
            }
            status = frame.run(&limits)?;
        }
        if status.is_none() {
            limits.give_up = usize::MAX;
            let (own, ops) = (*scale, &problem.skin.operators);
            let mut frame = Frame { problem, ops, engine: double, scale: own, record, proof };
            frame.begin();
            if is_single {
                frame.engine.state.take_iterate(&single.state);
            }
            frame.set_first_map()?;
            if !is_single {
                scale.image = frame.scale.image;
            }
            status = frame.run(&limits)?;
            if is_single {
                single.state.duals.take(&double.state.duals, 1.0);
                // the map in the other type belongs to an earlier iterate
                self.map_age = MAP_EVERY;
            }
        }
        self.recent = [self.recent[1], self.record.iterations];
        Ok(status.unwrap_or(SequenceStatus::IterationCap))
    }
}
