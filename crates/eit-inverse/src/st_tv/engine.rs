//! Iterate, steps and certificate of a problem in one floating-point type.

use super::bound::Bound;
use super::certificate::{Certificate, Effort};
use super::fit::DataSteps;
use super::lanes::Project;
use super::operators::Operators;
use super::problem::Problem;
use super::record::Record;
use super::state::State;
use super::step::MapScratch;
use crate::InverseError;

/// Iterations from which every second bound keeps the data dual: on one of 6 000 random problems (a pixel, five frames,
/// masked channels, data constraints) the others had not reached a gap of 3e-2 after 20 000 iterations.
const ALTERNATE_FROM: usize = 2000;

/// What the solution of a problem changes.
#[derive(Debug, Clone)]
pub(crate) struct Engine<T: Project> {
    pub(crate) state: State<T>,
    pub(crate) data: DataSteps<T>,
    pub(crate) map: MapScratch<T>,
    pub(crate) certificate: Certificate<T>,
    /// Whether the next bound keeps the data dual: changes after a bound no better than the best, and in long runs.
    pub(crate) is_plain: bool,
    /// Duration of an evaluation, seconds.
    pub(crate) look_seconds: f64,
}

impl<T: Project> Engine<T> {
    /// Allocates memory, initially for `steps` different data steps.
    pub(crate) fn new(problem: &Problem<'_>, ops: &Operators<T>, steps: usize) -> Self {
        let state = State::new(ops, problem);
        Self {
            data: DataSteps::new(problem, ops, steps),
            map: MapScratch::new(&state),
            certificate: Certificate::new(ops, problem),
            state,
            is_plain: false,
            look_seconds: 0.0,
        }
    }

    /// Computes the data steps of the current step map.
    pub(crate) fn set_data(
        &mut self,
        problem: &Problem<'_>,
        ops: &Operators<T>,
    ) -> Result<(), InverseError> {
        self.data.set_map(problem, ops, &self.state)?;
        self.set_tail(ops, None);
        Ok(())
    }

    /// Sets the force of the tail, see [`DataSteps::set_tail`].
    pub(crate) fn set_tail(&mut self, ops: &Operators<T>, residual: Option<&[f64]>) {
        self.data.set_tail(ops, &mut self.state, residual);
    }

    /// Computes a lower bound from the iterate and images near the optimum, over cells, whose largest value is `size`.
    pub(crate) fn prove(
        &mut self,
        problem: &Problem<'_>,
        ops: &Operators<T>,
        record: &mut Record,
        (images, size): (&[f64], f64),
        effort: Effort,
    ) -> Bound {
        let Self { state, data, certificate, .. } = self;
        for (frame, own) in certificate.dual.chunks_exact_mut(ops.padded).enumerate() {
            data.dual(state, frame, own);
        }
        let bound = certificate.bound(problem, ops, state, (images, size), effort);
        if !record.take_bound(bound.value) || record.iterations >= ALTERNATE_FROM {
            self.is_plain = !self.is_plain;
        }
        bound
    }
}
