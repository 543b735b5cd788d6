//! The last frames: which measurements moved, and which repeat themselves exactly.

/// The last frames of a stream.
#[derive(Debug, Clone)]
pub(super) struct History {
    /// `[slot][measurement]`; the oldest is written over.
    values: Vec<f64>,
    measurements: usize,
    slots: usize,
    /// Frames so far.
    frames: usize,
}

impl History {
    pub fn new(slots: usize, measurements: usize) -> Self {
        Self { values: vec![0.0; slots * measurements], measurements, slots, frames: 0 }
    }

    /// Remembers a frame of as many values as there are measurements.
    pub fn push(&mut self, values: &[f64]) {
        let from = self.frames % self.slots * self.measurements;
        self.values[from..from + self.measurements].copy_from_slice(values);
        self.frames += 1;
    }

    pub fn is_full(&self) -> bool {
        self.frames >= self.slots
    }

    /// By how much a measurement went in the last frames; values that are no numbers do not count.
    /// Below zero where there are none.
    pub fn span(&self, measurement: usize) -> f64 {
        let frames = self.values.chunks_exact(self.measurements).take(self.frames);
        let (low, high) = frames
            .map(|frame| frame[measurement])
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        high - low
    }
}
