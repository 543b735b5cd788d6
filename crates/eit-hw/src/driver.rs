//! Drivers of instruments: identify, configure, read back, start, frames, stop.
//!
//! A [`Driver`] knows one protocol; a [`Session`] owns the connection, decodes on a thread of its
//! own, puts frames into protocol order with their quality, and finds a lost instrument again.
//! Each driver conforms to public sources and none was verified on hardware.

mod diagnosis;
mod eits1;
mod quality;
mod queue;
mod replay;
mod sciospec;
mod session;
mod text;

pub use eits1::Eits1;
pub use quality::Limits;
pub use queue::{Overflow, Statistics};
pub use replay::{Pace, Replay};
pub use sciospec::{Gain, PairWidth, Polarity, Range, Sciospec, SciospecSettings};
pub use session::{Backoff, Event, Session, SessionSettings};
pub use text::{Board, Step};

use std::fmt;

use crate::error::HwError;
use crate::frame::{Frame, Quality};
use crate::recording::{Layout, Unit};
use crate::transport::Link;

/// Who answers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Name of the driver: `eits1`, `sciospec`, `text`.
    pub driver: &'static str,
    /// Kind of instrument.
    pub name: String,
    /// What tells it from others of its kind; empty where it does not say.
    pub serial: String,
}

impl fmt::Display for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.name)?;
        if self.serial.is_empty() { Ok(()) } else { write!(f, " {}", self.serial) }
    }
}

/// What an instrument that was set up will send.
#[derive(Clone, Debug, PartialEq)]
pub struct Setup {
    /// Who it is.
    pub identity: Identity,
    /// Electrodes of each value.
    pub layout: Layout,
    /// Values of a frame, in that layout.
    pub value_count: usize,
    /// Whether they are complex.
    pub complex: bool,
    /// Their unit.
    pub unit: Unit,
    /// Frames a second, where it is known.
    pub frame_rate_hz: Option<f64>,
    /// What values can be.
    pub limits: Limits,
}

/// One frame as an instrument sends it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RawFrame<'a> {
    /// Values, or their real parts, in the instrument's layout.
    pub values: &'a [f64],
    /// Imaginary parts; empty for real values.
    pub imaginary: &'a [f64],
    /// Flags that the instrument or its protocol gives.
    pub quality: &'a [Quality],
    /// The instrument's count of frames, where it counts; it does not wrap.
    pub counter: Option<u64>,
    /// The instrument's clock in seconds since a time of its own; it does not wrap.
    pub device_time_s: Option<f64>,
}

/// What a driver decodes from the bytes of an instrument.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Decoded<'a> {
    /// A whole frame.
    Frame(RawFrame<'a>),
    /// A frame that began, but of which too much is missing or unreadable; it counts as lost.
    TruncatedFrame,
    /// Bytes that belong to no valid message.
    Damaged {
        /// How many, where that is known, else 1.
        bytes: u64,
    },
    /// A text message from the instrument.
    Notice(&'a str),
    /// The instrument has restarted and lost its set-up.
    Restarted,
}

/// One protocol from the host's side. A [`Session`] calls it; both [`connect`](Self::connect) and
/// [`start`](Self::start) are called again after the instrument was lost.
pub trait Driver: Send {
    /// Name in the scene file.
    fn name(&self) -> &'static str;

    /// Stops an old stream, identifies the instrument, sets it up and reads back what it can.
    ///
    /// # Errors
    /// [`HwError::NoReply`], [`HwError::Refused`], [`HwError::ReadBack`], [`HwError::Lost`].
    fn connect(&mut self, link: &mut Link) -> Result<Setup, HwError>;

    /// Starts the frames.
    ///
    /// # Errors
    /// As [`connect`](Self::connect).
    fn start(&mut self, link: &mut Link) -> Result<(), HwError>;

    /// Takes bytes of the running stream.
    fn receive(&mut self, bytes: &[u8], on_decoded: &mut dyn FnMut(Decoded<'_>));

    /// Called at least every 20 ms while the stream runs, for instruments that are asked for each
    /// frame.
    ///
    /// # Errors
    /// [`HwError::Lost`].
    fn idle(&mut self, link: &mut Link) -> Result<(), HwError> {
        let _ = link;
        Ok(())
    }

    /// Stops the frames; no answer is waited for.
    ///
    /// # Errors
    /// [`HwError::Lost`].
    fn stop(&mut self, link: &mut Link) -> Result<(), HwError>;
}

/// Opens an instrument, asks who it is, sets it up, and closes it again.
///
/// # Errors
/// [`HwError`] of the connection or the set-up.
pub fn identify(driver: &mut dyn Driver, endpoint: &crate::Endpoint) -> Result<Setup, HwError> {
    connect(driver, &mut Link::open(endpoint)?)
}

/// [`Driver::connect`], with an error that says what came instead of an answer.
fn connect(driver: &mut dyn Driver, link: &mut Link) -> Result<Setup, HwError> {
    link.record_input();
    let setup = driver.connect(link).map_err(|error| diagnosis::explain(error, link));
    link.recorded_input();
    setup
}

/// Where frames come from: an instrument, or a recording that is played.
pub trait FrameSource {
    /// Who it is and what it sends.
    fn setup(&self) -> &Setup;

    /// The next event; `None` where none came in time, or there is no more.
    ///
    /// # Errors
    /// Once, why it has ended.
    fn next_event(&mut self, timeout: std::time::Duration) -> Result<Option<Event>, HwError>;

    /// Gives a frame's memory back.
    fn recycle(&mut self, frame: Frame);

    /// Counts so far.
    fn statistics(&self) -> Statistics;

    /// Whether no event will come any more.
    fn is_over(&self) -> bool;
}

impl FrameSource for Session {
    fn setup(&self) -> &Setup {
        Session::setup(self)
    }

    fn next_event(&mut self, timeout: std::time::Duration) -> Result<Option<Event>, HwError> {
        Session::next_event(self, timeout)
    }

    fn recycle(&mut self, frame: Frame) {
        Session::recycle(self, frame);
    }

    fn statistics(&self) -> Statistics {
        Session::statistics(self)
    }

    fn is_over(&self) -> bool {
        Session::is_over(self)
    }
}
