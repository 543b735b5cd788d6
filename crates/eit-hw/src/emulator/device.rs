//! The interface of all emulated instruments, and the timing of their frames.

use std::time::Duration;

use crate::frame::Quadruple;

/// Computes the values of a frame from its number and the quadruples; fills the slice, in which
/// real and imaginary parts alternate if the device is complex.
pub type ValueSource = Box<dyn FnMut(u64, &[Quadruple], &mut [f64]) + Send>;

/// Device side of one protocol. Times are relative to the start of the emulator.
pub trait Device: Send {
    /// Processes bytes from the host and appends answers to `out`.
    fn receive(&mut self, bytes: &[u8], now: Duration, out: &mut Vec<u8>);

    /// Appends frames and messages that are due.
    fn poll(&mut self, now: Duration, out: &mut Vec<u8>);

    /// Clears the settings, as after being unplugged or losing power.
    fn power_cycle(&mut self);
}

/// Timing of frames.
#[derive(Clone, Debug)]
pub(super) struct Pace {
    period: Duration,
    next: Duration,
}

impl Pace {
    /// Clamps `frame_rate_hz` to one frame per hour at least and 100 000 per second at most.
    pub(super) fn new(frame_rate_hz: f64, now: Duration) -> Self {
        let period_s = (1.0 / frame_rate_hz).clamp(1e-5, 3600.0);
        Self { period: Duration::from_secs_f64(period_s), next: now }
    }

    /// Returns when the next frame was due, if it is due now, and advances by one period. Several
    /// frames may be due at once.
    pub(super) fn due(&mut self, now: Duration) -> Option<Duration> {
        if now < self.next {
            return None;
        }
        let due = self.next;
        self.next += self.period;
        // after the computer slept, missed frames are not sent all at once
        if self.next + Duration::from_secs(1) < now {
            self.next = now;
        }
        Some(due)
    }
}
