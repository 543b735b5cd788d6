//! Recorded files in memory, and selection of a protocol's measurements.

mod file;
mod format;
pub(crate) mod hint;
mod layout;
mod map;
mod note;
mod orientation;
mod select;

pub(crate) use file::Contents;
pub use file::Recording;
pub use format::Format;
pub use hint::CountHint;
pub use layout::{Layout, Unit};
pub use map::FrameMap;
pub use note::{Note, SkipReason, Skipped, SkippedFrame};
pub use orientation::FrameOrientation;
pub use select::{Component, MeasuredFrames};
