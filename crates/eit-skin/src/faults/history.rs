//! The most recent frames: which measurements changed, and which electrodes repeat exactly.

use super::protocol::Wiring;

/// Number of frames over which a stuck electrode repeats exactly.
const STUCK_FRAMES: usize = 5;
/// Fraction of the other channels that must change during that time, ...
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
    /// Number of consecutive frames, up to the last one, that repeat the one before.
    repeated: usize,
    /// Smallest change of a measurement from one frame to the next so far, volts: the converter's step or less.
    least_change_v: f64,
    is_moving: Vec<bool>,
    /// Whether each electrode is stuck.
    is_stuck: Vec<bool>,
}

impl History {
    pub(crate) fn new(measurements: usize, electrodes: usize) -> Self {
        Self {
            values: vec![0.0; STUCK_FRAMES * measurements],
            measurements,
            frames: 0,
            repeated: 0,
            least_change_v: f64::INFINITY,
            is_moving: vec![false; measurements],
            is_stuck: vec![false; electrodes],
        }
    }

    /// Stores a frame, which has one value per measurement.
    pub(crate) fn push(&mut self, values: &[f64], used: &[bool]) {
        let before = (self.frames + STUCK_FRAMES - 1) % STUCK_FRAMES * self.measurements;
        let before = &self.values[before..before + self.measurements];
        let (mut any, mut repeats) = (false, self.frames > 0);
        for ((a, b), _) in values.iter().zip(before).zip(used).filter(|(_, used)| **used) {
            (any, repeats) = (true, repeats && a == b);
            let change = (a - b).abs();
            if self.frames > 0 && change > 0.0 {
                self.least_change_v = self.least_change_v.min(change);
            }
        }
        self.repeated = if any && repeats { self.repeated + 1 } else { 0 };
        let from = self.frames % STUCK_FRAMES * self.measurements;
        self.values[from..from + self.measurements].copy_from_slice(values);
        self.frames += 1;
    }

    /// Finds electrodes that repeat exactly while others change. `step_v` is the step of the
    /// converter; if it is 0 because quiet frames do not show it, the smallest change so far is
    /// used.
    pub(crate) fn look_for_stuck(&mut self, wiring: &Wiring, used: &[bool], step_v: f64) {
        if self.frames < STUCK_FRAMES {
            return;
        }
        let step_v = match step_v > 0.0 || self.least_change_v.is_infinite() {
            true => step_v,
            false => self.least_change_v,
        };
        for (i, &used) in used.iter().enumerate() {
            self.is_moving[i] = used && self.span(i) > MOVING_STEPS * step_v;
        }
        let all_used = used.iter().filter(|used| **used).count();
        let all_moving = self.is_moving.iter().filter(|moving| **moving).count();
        for (e, of_e) in wiring.of_electrode.iter().enumerate() {
            let own = of_e.iter().filter(|&&i| self.is_moving[i]).count();
            let others = all_used - of_e.len();
            let is_moving = (all_moving - own) as f64 > MOVING * others as f64;
            let is_still = !of_e.is_empty() && of_e.iter().all(|&i| self.repeats(i));
            self.is_stuck[e] = is_moving && is_still;
        }
    }

    /// Returns the number of frames in a row that repeat the one before exactly, up to the last one.
    pub(crate) fn repeated(&self) -> usize {
        self.repeated
    }

    /// Returns whether an electrode was stuck at the last search.
    pub(crate) fn is_stuck(&self, electrode: usize) -> bool {
        self.is_stuck[electrode]
    }

    /// Whether a measurement has the same value in all stored frames; not if it is missing in one.
    fn repeats(&self, measurement: usize) -> bool {
        let frames = self.values.chunks_exact(self.measurements.max(1)).take(self.frames);
        let mut values = frames.map(|frame| frame[measurement]);
        let first = values.next();
        first.is_some_and(|first| values.all(|value| value == first))
    }

    /// Range of a measurement over the stored frames, ignoring NaN; negative if there is no value.
    pub(crate) fn span(&self, measurement: usize) -> f64 {
        // `chunks_exact` does not accept a length of 0
        let frames = self.values.chunks_exact(self.measurements.max(1)).take(self.frames);
        let (low, high) = frames
            .map(|frame| frame[measurement])
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        high - low
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Eight measurements, the first four of electrode 0, the others of electrode 1.
    fn stuck(step_v: f64, value: impl Fn(usize, usize) -> f64) -> bool {
        let wiring = Wiring {
            of_electrode: vec![(0..4).collect(), (4..8).collect()],
            of_measurement: (0..8).map(|i| vec![i / 4]).collect(),
            reciprocal: (0..8).collect(),
        };
        let mut history = History::new(8, 2);
        for frame in 0..2 * STUCK_FRAMES {
            let values: Vec<f64> = (0..8).map(|i| value(frame, i)).collect();
            history.push(&values, &[true; 8]);
        }
        history.look_for_stuck(&wiring, &[true; 8], step_v);
        history.is_stuck(0)
    }

    /// An electrode that repeats exactly while the other changes by many steps is stuck, unless the
    /// others change by single steps of a converter of unknown step, or values are missing.
    #[test]
    fn stuck_is_who_repeats_while_others_change_by_steps() {
        let far = |frame: usize, i: usize| if i < 4 { 1.0 } else { (frame * frame) as f64 };
        assert!(stuck(0.0, far) && stuck(1.0, far));
        let near = |frame: usize, i: usize| if i < 4 { 1.0 } else { (frame % 2) as f64 };
        assert!(!stuck(0.0, near));
        let lost =
            |frame: usize, i: usize| if i < 4 && frame > 5 { f64::NAN } else { far(frame, i) };
        assert!(!stuck(1.0, lost));
    }
}
