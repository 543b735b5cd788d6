//! Sources of frames, and the events they report.

use std::time::Duration;

use super::setup::Setup;
use crate::error::HwError;
use crate::frame::Frame;

/// A source of frames: an instrument or a replayed recording.
pub trait FrameSource {
    /// Returns the source's identity and the format of its frames.
    fn setup(&self) -> &Setup;

    /// Waits for the next event; returns `None` if none came in time or there are no more.
    ///
    /// # Errors
    /// Returns once why the source has ended.
    fn next_event(&mut self, timeout: Duration) -> Result<Option<Event>, HwError>;

    /// Returns a frame for reuse of its memory.
    fn recycle(&mut self, frame: Frame);

    /// Returns the counts so far.
    fn statistics(&self) -> Statistics;

    /// Returns the number of frames that can be taken without waiting; above 0 the consumer is behind. 0 for
    /// a recording, which waits for its consumer.
    fn frames_waiting(&self) -> usize {
        0
    }

    /// Returns whether no more events will come.
    fn is_over(&self) -> bool;

    /// Stops it; what has arrived can still be taken. Does nothing for a recording.
    fn stop(&mut self) {}
}

/// An event of a session.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// A frame in protocol order; return it with [`FrameSource::recycle`] to save an allocation.
    Frame(Frame),
    /// Frames were lost before the next one.
    Gap {
        /// Number of lost frames.
        frames: u64,
    },
    /// Received frames were dropped before the next event, because the consumer was slower than the
    /// instrument ([`Overflow::KeepLatest`](crate::driver::Overflow::KeepLatest)).
    Skipped {
        /// Number of dropped frames.
        frames: u64,
    },
    /// A message from the instrument or driver.
    Notice(String),
    /// No frame has come for some time, although the connection is open. Reported once per silence,
    /// after [`SessionSettings::silence_s`](crate::driver::SessionSettings::silence_s).
    Silent {
        /// Length of the silence so far, in seconds.
        for_s: f64,
        /// Number of bytes received meanwhile, if they still come: the instrument sends something that is no
        /// frame. 0 if nothing came for half of the silence.
        bytes: u64,
    },
    /// The instrument is lost; the session tries to reconnect.
    Disconnected {
        /// How the connection was lost, in words.
        reason: String,
    },
    /// The instrument was found again and set up, or its frame counter has restarted, as after a
    /// brown-out. A reference frame of another epoch is no longer valid: contacts and gains may
    /// have changed.
    Reconnected {
        /// Epoch of the frames that follow.
        epoch: u32,
    },
    /// A recording tells which frames were the reference of an epoch, usually before the first of them.
    Reference {
        /// Epoch of these frames.
        epoch: u32,
        /// Their sequence numbers.
        sequences: Vec<u64>,
        /// Number of the last frame that was not searched for touches; `None`: the last of these frames.
        until: Option<u64>,
    },
}

/// Counts kept by a session.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Statistics {
    /// Frames received.
    pub frames: u64,
    /// Frames that the instrument sent or should have sent but that were not received, as far as
    /// its counter or a truncated frame shows.
    pub lost: u64,
    /// Received frames dropped because the consumer was slow.
    pub dropped: u64,
    /// Frames with a flag on at least one measurement.
    pub flagged: u64,
    /// Bytes received.
    pub bytes: u64,
    /// Bytes that belong to no valid message.
    pub damaged_bytes: u64,
    /// Number of reconnections.
    pub reconnections: u32,
    /// Seconds without a frame, summed over all reported silences of an open connection.
    pub silent_s: f64,
    /// Seconds without a frame because the instrument was unplugged or was being set up again,
    /// summed: from the last frame before each lost connection to the first frame after it. Frames
    /// of this time are not among [`lost`](Self::lost).
    pub disconnected_s: f64,
}
