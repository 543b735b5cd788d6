//! What a driver decodes from an instrument's bytes.

use crate::frame::Quality;

/// One frame as the instrument sends it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RawFrame<'a> {
    /// Values or their real parts, in the instrument's layout.
    pub values: &'a [f64],
    /// Imaginary parts; empty for real values.
    pub imaginary: &'a [f64],
    /// Flags set by the instrument or its protocol.
    pub quality: &'a [Quality],
    /// The instrument's frame counter, if it has one; does not wrap.
    pub counter: Option<u64>,
    /// The instrument's clock in seconds, from an arbitrary origin; does not wrap.
    pub device_time_s: Option<f64>,
}

/// What a driver decodes from an instrument's bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Decoded<'a> {
    /// A complete frame.
    Frame(RawFrame<'a>),
    /// A frame of which too much is missing or unreadable; it counts as lost.
    TruncatedFrame,
    /// Bytes that belong to no valid message.
    Damaged {
        /// Number of bytes if known, otherwise 1.
        bytes: u64,
    },
    /// A text message from the instrument.
    Notice(&'a str),
    /// The frame counter has restarted, or jumped farther than frames can have been lost. The
    /// instrument's set-up is still valid.
    Renumbered,
    /// The instrument has restarted and lost its set-up.
    Restarted,
}
