//! The most recent frames: which measurements changed, and which electrodes repeat exactly.

use super::protocol::Wiring;

/// Number of frames over which a stuck electrode repeats exactly.
const STUCK_FRAMES: usize = 5;
/// Fraction of the other channels that must change meanwhile, ...
const MOVING: f64 = 0.4;
/// ... by more than this many steps of the converter.
const MOVING_STEPS: f64 = 3.0;

/// The most recent frames of a stream.
#[derive(Debug, Clone)]
pub(super) struct History {
    /// `[slot][measurement]`, a ring buffer.
    values: Vec<f64>,
    measurements: usize,
    /// Number of frames so far.
    frames: usize,
    /// Number of the last ones that repeat the one before.
    repeated: usize,
    is_moving: Vec<bool>,
    /// Whether each electrode is stuck.
    is_stuck: Vec<bool>,
}

impl History {
    pub fn new(measurements: usize, electrodes: usize) -> Self {
        Self {
            values: vec![0.0; STUCK_FRAMES * measurements],
            measurements,
            frames: 0,
            repeated: 0,
            is_moving: vec![false; measurements],
            is_stuck: vec![false; electrodes],
        }
    }

    /// Stores a frame, which has one value per measurement.
    pub fn push(&mut self, values: &[f64], used: &[bool]) {
        let before = (self.frames + STUCK_FRAMES - 1) % STUCK_FRAMES * self.measurements;
        let before = &self.values[before..before + self.measurements];
        let mut pairs = values.iter().zip(before).zip(used).filter(|(_, used)| **used).peekable();
        let repeats = self.frames > 0 && pairs.peek().is_some() && pairs.all(|((a, b), _)| a == b);
        self.repeated = if repeats { self.repeated + 1 } else { 0 };
        let from = self.frames % STUCK_FRAMES * self.measurements;
        self.values[from..from + self.measurements].copy_from_slice(values);
        self.frames += 1;
    }

    /// Finds electrodes that repeat exactly while others change. `step_v`: step of the converter.
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

    /// Returns the number of frames in a row that repeat the one before exactly, up to the last one.
    pub fn repeated(&self) -> usize {
        self.repeated
    }

    /// Returns whether an electrode was stuck at the last search.
    pub fn is_stuck(&self, electrode: usize) -> bool {
        self.is_stuck[electrode]
    }

    /// Range of a measurement over the stored frames, ignoring NaN; negative if there is no value.
    pub fn span(&self, measurement: usize) -> f64 {
        // `chunks_exact` does not accept a length of 0
        let frames = self.values.chunks_exact(self.measurements.max(1)).take(self.frames);
        let (low, high) = frames
            .map(|frame| frame[measurement])
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        high - low
    }
}
