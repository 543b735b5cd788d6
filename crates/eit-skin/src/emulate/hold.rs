//! An emulated skin that nobody touches before the program is ready.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

const HELD: u64 = u64::MAX;
const RELEASED: u64 = HELD - 1;

/// Holds an emulated instrument, which plays its first frames again and again until it is released: as somebody waits with a touch
/// until the reference has been taken.
#[derive(Debug, Clone)]
pub struct Hold {
    first: u64,
    /// By how many frames the others are late, once they are played.
    late: Arc<AtomicU64>,
}

impl Hold {
    /// Holds the first frames, at least one.
    pub fn of_first(frames: u64) -> Self {
        Self { first: frames.max(1), late: Arc::new(AtomicU64::new(HELD)) }
    }

    /// Plays the others from the next frame on.
    pub fn release(&self) {
        let _ = self.late.compare_exchange(HELD, RELEASED, Ordering::Relaxed, Ordering::Relaxed);
    }

    /// Returns the frame of the file that was sent with this number; `None` of one that was held.
    pub fn frame(&self, number: u64) -> Option<u64> {
        let frame = number.checked_sub(self.late.load(Ordering::Relaxed))?;
        (frame >= self.first).then_some(frame)
    }

    /// Returns the frame to send with the next number.
    pub(super) fn next(&self, number: u64) -> u64 {
        if self.late.load(Ordering::Relaxed) == RELEASED {
            // an instrument that has begun again may have sent fewer frames
            self.late.store(number.saturating_sub(self.first), Ordering::Relaxed);
        }
        self.frame(number).unwrap_or(number % self.first)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_follow_a_release() {
        let hold = Hold::of_first(3);
        let played =
            |numbers: std::ops::Range<u64>| numbers.map(|n| hold.next(n)).collect::<Vec<_>>();
        assert_eq!(played(0..8), [0, 1, 2, 0, 1, 2, 0, 1]);
        hold.release();
        assert_eq!(played(8..11), [3, 4, 5]);
        hold.release();
        assert_eq!([7, 8, 10].map(|number| hold.frame(number)), [None, Some(3), Some(5)]);
    }
}
