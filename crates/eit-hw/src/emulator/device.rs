//! What every emulated instrument does, and when its frames are due.

use std::time::Duration;

use crate::frame::Quadruple;

/// Gives the values of a frame: its number, the quadruples, the values to fill (real and imaginary
/// parts alternating where the device is complex).
pub type ValueSource = Box<dyn FnMut(u64, &[Quadruple], &mut [f64]) + Send>;

/// One protocol from the instrument's side. Times are since the emulator has started.
pub trait Device: Send {
    /// Takes bytes of the host and appends the answers to `out`.
    fn receive(&mut self, bytes: &[u8], now: Duration, out: &mut Vec<u8>);

    /// Appends what is due.
    fn poll(&mut self, now: Duration, out: &mut Vec<u8>);

    /// It was unplugged, or has lost power, and forgets its set-up.
    fn power_cycle(&mut self);
}

/// When frames are due.
#[derive(Clone, Debug)]
pub(super) struct Pace {
    period: Duration,
    next: Duration,
}

impl Pace {
    /// `frame_rate_hz` is taken to be at least one frame in an hour and at most 100 000 a second.
    pub(super) fn new(frame_rate_hz: f64, now: Duration) -> Self {
        let period_s = (1.0 / frame_rate_hz).clamp(1e-5, 3600.0);
        Self { period: Duration::from_secs_f64(period_s), next: now }
    }

    /// When a frame is due that is; the next one is a period later. Several may be due at once.
    pub(super) fn due(&mut self, now: Duration) -> Option<Duration> {
        if now < self.next {
            return None;
        }
        let due = self.next;
        self.next += self.period;
        // a computer that slept does not send all at once
        if self.next + Duration::from_secs(1) < now {
            self.next = now;
        }
        Some(due)
    }
}
