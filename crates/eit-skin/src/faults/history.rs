//! The last frames: which measurements moved, and which electrodes repeat themselves exactly.

use super::protocol::Wiring;

/// Frames that a stuck electrode repeats itself.
const STUCK_FRAMES: usize = 5;
/// Part of the other channels that must move meanwhile, ...
const MOVING: f64 = 0.4;
/// ... by so many steps of the converter.
const MOVING_STEPS: f64 = 3.0;

/// The last frames of a stream.
#[derive(Debug, Clone)]
pub(super) struct History {
    /// `[slot][measurement]`; the oldest is written over.
    values: Vec<f64>,
    measurements: usize,
    /// Frames so far.
    frames: usize,
    is_moving: Vec<bool>,
    /// Electrodes.
    is_stuck: Vec<bool>,
}

impl History {
    pub fn new(measurements: usize, electrodes: usize) -> Self {
        Self {
            values: vec![0.0; STUCK_FRAMES * measurements],
            measurements,
            frames: 0,
            is_moving: vec![false; measurements],
            is_stuck: vec![false; electrodes],
        }
    }

    /// Remembers a frame of as many values as there are measurements.
    pub fn push(&mut self, values: &[f64]) {
        let from = self.frames % STUCK_FRAMES * self.measurements;
        self.values[from..from + self.measurements].copy_from_slice(values);
        self.frames += 1;
    }

    /// Looks which electrodes repeat themselves while others move. `step_v`: of the converter.
    pub fn look_for_stuck(&mut self, wiring: &Wiring, used: &[bool], step_v: f64) {
        if self.frames < STUCK_FRAMES {
            return;
        }
        for (i, &used) in used.iter().enumerate() {
            self.is_moving[i] = used && self.span(i) > MOVING_STEPS * step_v;
        }
        let all_used = used.iter().filter(|used| **used).count();
        let all_moving = self.is_moving.iter().filter(|moving| **moving).count();
        for (e, of_e) in wiring.of_electrode.iter().enumerate() {
            let own = of_e.iter().filter(|&&i| self.is_moving[i]).count();
            let others = all_used - of_e.len();
            let is_moving = (all_moving - own) as f64 > MOVING * others as f64;
            let is_still = !of_e.is_empty() && of_e.iter().all(|&i| self.span(i) == 0.0);
            self.is_stuck[e] = is_moving && is_still;
        }
    }

    /// Whether an electrode was stuck when last looked for.
    pub fn is_stuck(&self, electrode: usize) -> bool {
        self.is_stuck[electrode]
    }

    /// By how much a measurement went in the last frames; values that are no numbers do not count.
    /// Below zero where there are none.
    pub fn span(&self, measurement: usize) -> f64 {
        // values of no measurements have no chunks
        let frames = self.values.chunks_exact(self.measurements.max(1)).take(self.frames);
        let (low, high) = frames
            .map(|frame| frame[measurement])
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        high - low
    }
}
