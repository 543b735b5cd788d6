//! What a driver decodes from the bytes of an instrument.

use crate::frame::Quality;

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
    /// The count of frames has begun anew, or jumped farther than frames can have been lost; the set-up
    /// holds.
    Renumbered,
    /// The instrument has restarted and lost its set-up.
    Restarted,
}
