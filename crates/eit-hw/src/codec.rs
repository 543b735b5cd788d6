//! Codecs: bytes to events and back, without input or output.
//!
//! Each decoder takes bytes as they arrive, in pieces of any size, and calls back with events. The
//! events do not depend on how the bytes are cut into pieces. Memory is bounded, garbage is counted
//! and passed over, and no bytes make a decoder panic.

pub mod eits1;
pub mod sciospec;
pub mod text;
