//! Drivers of instruments: identify, configure, read back, start, frames, stop.
//!
//! A [`Driver`] knows one protocol; a [`Session`] owns the connection, decodes on a thread of its
//! own, puts frames into protocol order with their quality, and finds a lost instrument again.
//! Each driver conforms to public sources and none was verified on hardware.

mod decoded;
mod diagnosis;
mod eits1;
mod interface;
mod quality;
mod queue;
mod replay;
mod sciospec;
mod session;
pub(crate) mod setup;
mod source;
mod text;

pub use decoded::{Decoded, RawFrame};
pub use eits1::Eits1;
pub use interface::{Driver, identify};
pub use queue::Overflow;
pub use replay::{Pace, Replay};
pub use sciospec::{Gain, PairWidth, Polarity, Range, Sciospec, SciospecSettings};
pub use session::{Backoff, Session, SessionSettings};
pub use setup::{Identity, Limits, Setup};
pub use source::{Event, FrameSource, Statistics};
pub use text::{Board, Heard, Step, listen};
