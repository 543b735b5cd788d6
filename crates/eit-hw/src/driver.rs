//! Instrument drivers: identify, configure, read back, start, receive frames, stop.
//!
//! A [`Driver`] implements one protocol. A [`Session`] owns the connection, decodes on its own
//! thread, puts frames into protocol order with quality flags, and reconnects to a lost instrument.
//! Each driver follows public sources; none was verified on hardware.

mod decoded;
mod diagnosis;
mod eits1;
mod interface;
mod quality;
pub(crate) mod queue;
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
pub use replay::{Replay, pace::Pace};
pub use sciospec::{Gain, PairWidth, Polarity, Range, Sciospec, SciospecSettings};
pub use session::{Backoff, Session, SessionSettings};
pub use setup::{Identity, Limits, Setup};
pub use source::{Event, FrameSource, Statistics};
pub use text::{Board, Heard, Step, listen};
