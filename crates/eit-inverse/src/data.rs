//! Difference data of frames and the choice of measurements.

mod channels;
mod difference;

pub(crate) use channels::Channels;
pub use difference::{DifferenceData, DifferenceKind, FrameStatus};
