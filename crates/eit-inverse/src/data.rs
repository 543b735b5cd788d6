//! Difference data of frames, and the measurements of them that count.

mod channels;
mod difference;

pub(crate) use channels::Channels;
pub use difference::{DifferenceData, DifferenceKind, FrameStatus};
