//! What computes a step: our kernels, or burn. Both take the same parameters in the same order and
//! the same examples, so that optimiser, order, checkpoints and weights are one for all.

#[cfg(feature = "burn")]
mod autodiff;
mod choice;
mod own;
mod stepper;
mod steps;

pub use choice::Engine;
pub use stepper::Stepper;
