//! Classical methods for reconstructing sequences of difference data, used as baselines.
//!
//! | method | temporal prior | flops per frame |
//! |---|---|---|
//! | [`OneStepGaussNewton`](crate::OneStepGaussNewton) | none: frames are independent | `2 r (m + n)` |
//! | [`TimePrior`] | exponentially decaying correlation | `2 r (m + n) + 10 r` |
//! | [`AbsoluteGaussNewton`] | none; non-linear model | per step `m^2 n` and the prior's `J P` |
//!
//! for `m` used measurements, `n` elements and `r <= m` independent measurements. The first two
//! are linear and direct. In all of them the hyperparameter lambda has the same meaning as in
//! [`OneStepGaussNewton`](crate::OneStepGaussNewton): noise of covariance `lambda^2 s W^-1` and a
//! prior of covariance `P`, with the scale `s` of the Jacobian. A lambda chosen there (for noise
//! figure 1, for example) can be used here.

mod absolute;
mod markov;
mod modes;
mod one_step;
mod solver;
mod time_prior;

pub use absolute::{AbsoluteFrameReport, AbsoluteGaussNewton, AbsoluteSettings};
pub use solver::{
    Certificate, DifferenceFrames, ImageSequence, SequenceReport, SequenceSolver, SequenceStatus,
    TracePoint,
};
pub use time_prior::{TimePrior, TimePriorSettings};
