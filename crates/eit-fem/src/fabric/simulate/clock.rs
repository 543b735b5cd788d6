//! Times of the instants at which a skin is solved.

/// Times in frames since the start, at a frame rate that may change.
#[derive(Debug, Clone, Copy)]
pub(super) struct Clock {
    pub rate_hz: f64,
    /// Number of instants per frame, and which of them is at the frame's time.
    pub per_frame: usize,
    pub middle: usize,
    /// Time of the next frame by this rate, and how many instants have passed since.
    start: f64,
    passed: usize,
}

impl Clock {
    pub(super) fn new(rate_hz: f64, per_frame: usize) -> Self {
        Self { rate_hz, per_frame, middle: (per_frame - 1) / 2, start: 0.0, passed: 0 }
    }

    /// Time of the instant `ahead` of the next one, in frames.
    pub(super) fn time(&self, ahead: usize) -> f64 {
        let frames = (self.passed + ahead) as f64 - self.middle as f64;
        self.start + frames / self.per_frame as f64
    }

    /// Number of instants before the instant `ahead` of the next one; a fraction once the rate has changed.
    pub(super) fn instants(&self, ahead: usize) -> f64 {
        self.start * self.per_frame as f64 + (self.passed + ahead) as f64
    }

    pub(super) fn pass(&mut self, instants: usize) {
        self.passed += instants;
    }

    /// Changes the rate after the last instant.
    pub(super) fn set_rate(&mut self, rate_hz: f64) {
        if rate_hz == self.rate_hz {
            return;
        }
        if self.passed > 0 || self.start != 0.0 {
            let last = self.time(0) - 1.0 / self.per_frame as f64;
            let first = last * rate_hz / self.rate_hz + 1.0 / self.per_frame as f64;
            self.start = first + self.middle as f64 / self.per_frame as f64;
            self.passed = 0;
        }
        self.rate_hz = rate_hz;
    }
}
