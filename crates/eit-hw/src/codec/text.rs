//! Frames as lines of numbers, as sent by boards with a serial monitor.
//!
//! [`TextFormat`] defines the layout of a frame; there are presets for public boards. Incomplete
//! frames are skipped and counted. Without a checksum or counter, no such format can reveal a digit
//! lost within a line, or the loss of exactly one frame's lines.

mod decoder;
mod event;
mod format;
pub(crate) mod line;
mod number;
mod preset;

pub(crate) use decoder::PAUSES;
pub(crate) use format::MAX_VALUES;
pub use format::{Framing, MAX_LINE_BYTES, TextFormat};
pub use number::Number;
pub use {decoder::Decoder, event::Event, event::Fault};
