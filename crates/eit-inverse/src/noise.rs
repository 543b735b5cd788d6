//! Noise of the data, estimated from quiet frames, and nuisance parameters.

mod estimate;
mod nuisance;

pub use estimate::{noise_std_of_quiet_frames, smallest_step};
pub use nuisance::NuisanceParameters;
