//! One reconstruction method on one simulated recording: images, cost and figures of merit.
//!
//! A recording is a sequence of fingers on a linear skin ([`simulate()`]), solved on a finer mesh than
//! that of the reconstruction ([`ReconstructionModel`]). A [`Solver`] is a method set up for it;
//! [`Scores`] compare its images with the truth.

mod model;
mod scores;
mod sequence;
mod solver;

pub use model::ReconstructionModel;
pub use scores::{GreitFigures, Scores, Truth};
pub use sequence::{
    FAST_M, Finger, FingerShape, SLOW_M, SequenceSettings, SequenceVoltages, SimulatedSequence,
    TouchSequence, simulate,
};
pub use solver::{BoundedMethod, ImageSequence, METHODS, SetUpCost, Solver};
