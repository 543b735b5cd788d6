//! Where frames come from, and what is told besides them.

use std::time::Duration;

use super::setup::Setup;
use crate::error::HwError;
use crate::frame::Frame;

/// Where frames come from: an instrument, or a recording that is played.
pub trait FrameSource {
    /// Who it is and what it sends.
    fn setup(&self) -> &Setup;

    /// The next event; `None` where none came in time, or there is no more.
    ///
    /// # Errors
    /// Once, why it has ended.
    fn next_event(&mut self, timeout: Duration) -> Result<Option<Event>, HwError>;

    /// Gives a frame's memory back.
    fn recycle(&mut self, frame: Frame);

    /// Counts so far.
    fn statistics(&self) -> Statistics;

    /// Number of frames that are ready to be taken at once: above 0, the consumer is behind. A recording is
    /// never ahead of its consumer: 0.
    fn frames_waiting(&self) -> usize {
        0
    }

    /// Whether no event will come any more.
    fn is_over(&self) -> bool;
}

/// What a session tells.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// A frame in protocol order; give it back with [`FrameSource::recycle`] to spare an allocation.
    Frame(Frame),
    /// So many frames were lost before the next one.
    Gap {
        /// How many.
        frames: u64,
    },
    /// The instrument or driver says something.
    Notice(String),
    /// No frame has come for so long, though the connection stands. Told once for each silence, after
    /// [`SessionSettings::silence_s`](crate::driver::SessionSettings::silence_s).
    Silent {
        /// For how long.
        for_s: f64,
    },
    /// The instrument is gone; it is looked for.
    Disconnected {
        /// What happened.
        reason: String,
    },
    /// The instrument was found again and set up anew, or its count of frames has begun anew, as after a
    /// brown-out. A reference frame of another epoch does not
    /// hold: contacts and gains may have changed.
    Reconnected {
        /// The new epoch, that of the frames that follow.
        epoch: u32,
    },
}

/// What a session has seen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Frames received.
    pub frames: u64,
    /// Frames that the instrument sent or should have sent and that were not received, as far as
    /// its counter or a cut frame shows.
    pub lost: u64,
    /// Received frames dropped because the consumer was slow.
    pub dropped: u64,
    /// Frames with a flag on some measurement.
    pub flagged: u64,
    /// Bytes received.
    pub bytes: u64,
    /// Bytes that were no message.
    pub damaged_bytes: u64,
    /// Times that the instrument was found again.
    pub reconnections: u32,
    /// Seconds without a frame, those of each silence that was told.
    pub silent_s: f64,
}
