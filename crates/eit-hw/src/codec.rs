//! Codecs: convert bytes to events and back, without I/O.
//!
//! Each decoder takes bytes as they arrive, in pieces of any size, and calls back with events,
//! which do not depend on how the bytes are split into pieces. Memory is bounded, garbage is
//! counted and skipped, and no input makes a decoder panic.

pub mod eits1;
pub mod sciospec;
pub mod text;
