//! The clock of another computer, from messages that carry its time.

/// Time for which the least delay is kept, seconds: clocks drift apart by some 50 millionths.
const PERIOD_S: f64 = 5.0;
/// A delay that differs from the least one by more than this means that a clock was set, seconds.
const STEP_S: f64 = 5.0;

/// Least delay between sending and arrival, each by its own clock: the difference of the clocks
/// plus the fastest transfer through the network. That transfer, some tenths of a millisecond on a
/// wired network, is the error.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ClockOffset {
    /// Least delay of this period and of the one before.
    least: [Option<f64>; 2],
    began_s: f64,
}

impl ClockOffset {
    /// Takes the times of a message, seconds: when it was sent by the other clock, and when it arrived by this
    /// one.
    pub(super) fn observe(&mut self, sent_s: f64, arrived_s: f64) {
        let delay = arrived_s - sent_s;
        let is_step = self.offset_s().is_some_and(|least| (delay - least).abs() > STEP_S);
        if is_step {
            *self = Self::default();
        }
        if arrived_s - self.began_s > PERIOD_S || arrived_s < self.began_s {
            self.least = [None, self.least[0]];
            self.began_s = arrived_s;
        }
        let least = self.least[0].map_or(delay, |least| least.min(delay));
        self.least[0] = Some(least);
    }

    /// Returns the offset to add to the other clock's times, seconds; `None` before the first message.
    pub(super) fn offset_s(&self) -> Option<f64> {
        match self.least {
            [Some(now), Some(before)] => Some(now.min(before)),
            [now, before] => now.or(before),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Delays of 1 to 11 ms on a clock that is 2 s behind: the offset is 2.001 s.
    #[test]
    fn the_least_delay_is_the_offset() {
        let mut clock = ClockOffset::default();
        for message in 0..500 {
            let sent = 100.0 + 0.01 * f64::from(message);
            let delay = 1e-3 + 1e-3 * f64::from((message * 7) % 11);
            clock.observe(sent - 2.0, sent + delay);
        }
        assert!((clock.offset_s().unwrap() - 2.001).abs() < 1e-9);
    }

    /// A clock that drifts is followed within two periods, and one that is set at once.
    #[test]
    fn drift_and_steps_are_followed() {
        let mut clock = ClockOffset::default();
        (0..3000).for_each(|message| {
            let sent = 0.01 * f64::from(message);
            clock.observe(sent, sent + 1e-3 + 1e-4 * sent);
        });
        // at the end the true offset is 4 ms; it grew by 0.1 ms a second
        assert!((clock.offset_s().unwrap() - 4e-3).abs() < 1.1e-3);
        clock.observe(1000.0, 30.0);
        assert_eq!(clock.offset_s(), Some(-970.0));
    }
}
