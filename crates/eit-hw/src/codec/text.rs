//! Frames as lines of numbers, as boards with a serial monitor send them.
//!
//! What makes a frame is set in [`TextFormat`]; there are presets for the public boards. A frame
//! that is not whole is passed over and counted. What no such format can show, since it has neither
//! checksum nor counter: a digit lost within a line, and a cut of exactly one frame's lines.

mod decoder;
mod format;
mod number;
mod preset;

pub use decoder::{Decoder, Event, Fault};
pub use format::{Framing, MAX_LINE_BYTES, MAX_VALUES, TextFormat};
pub use number::Number;
