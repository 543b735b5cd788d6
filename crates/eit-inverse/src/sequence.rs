//! Classical methods that turn difference data of a sequence into images: what newer ones are
//! measured against.
//!
//! | method | prior in time | one frame costs, flops |
//! |---|---|---|
//! | [`OneStepGaussNewton`](crate::OneStepGaussNewton) | none: each frame alone | `2 r (m + n)` |
//! | [`TimePrior`] | correlation that decays exponentially | `2 r (m + n) + 10 r` |
//! | [`KalmanSmoother`] | random walk | the same |
//! | [`KalmanFilter`] | random walk, the past alone | the same |
//! | [`AbsoluteGaussNewton`] | none; the model is not linearised | per step `m^2 n` and the prior's `J P` |
//!
//! for `m` used measurements, `n` elements and `r <= m` independent measurements. The first four
//! are linear and direct. All share the meaning of the hyperparameter lambda with
//! [`OneStepGaussNewton`](crate::OneStepGaussNewton): noise of variance `lambda^2 s W^-1` against a
//! prior of covariance `P`, with the scale `s` of the Jacobian, so a lambda chosen there (for noise
//! figure 1, say) serves here.

mod absolute;
mod kalman;
mod markov;
mod modes;
mod one_step;
mod solver;
mod time_prior;

pub use absolute::{AbsoluteFrameReport, AbsoluteGaussNewton, AbsoluteSettings};
pub use kalman::{KalmanFilter, KalmanSettings, KalmanSmoother};
pub use solver::{
    Certificate, DifferenceFrames, ImageSequence, SequenceReport, SequenceSolver, SequenceStatus,
    TracePoint,
};
pub use time_prior::{TimePrior, TimePriorSettings};
