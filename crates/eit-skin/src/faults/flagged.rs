//! Electrodes whose measurements the instrument flags.

use super::protocol::Wiring;

/// An electrode is flagged if more than this fraction of its measurements is, ...
const FLAGGED: f64 = 0.9;
/// ... in this many consecutive frames (a truncated packet flags its missing values for one frame),
/// ...
const FLAGGED_FRAMES: usize = 5;
/// ... and at most this fraction of the measurements without such an electrode.
const FLAGGED_ELSEWHERE: f64 = 0.5;

/// Which electrodes are flagged, and for how long.
#[derive(Debug, Clone)]
pub(super) struct Flagged {
    /// Whether the current frame flags each electrode.
    is_flagged: Vec<bool>,
    /// Number of consecutive frames that flagged it.
    frames: Vec<usize>,
}

impl Flagged {
    pub(crate) fn new(electrodes: usize) -> Self {
        Self { is_flagged: vec![false; electrodes], frames: vec![0; electrodes] }
    }

    /// Processes a frame. If most other measurements are flagged too, the frame neither counts nor
    /// interrupts a run.
    pub(crate) fn push(&mut self, wiring: &Wiring, used: &[bool], is_missing: &[bool]) {
        for (flagged, of_e) in self.is_flagged.iter_mut().zip(&wiring.of_electrode) {
            let missing = of_e.iter().filter(|&&i| is_missing[i]).count();
            *flagged = !of_e.is_empty() && missing as f64 > FLAGGED * of_e.len() as f64;
        }
        let (mut all, mut missing) = (0_usize, 0_usize);
        for (i, electrodes) in wiring.of_measurement.iter().enumerate() {
            if used[i] && !electrodes.iter().any(|&e| self.is_flagged[e]) {
                all += 1;
                missing += usize::from(is_missing[i]);
            }
        }
        if all == 0 || missing as f64 > FLAGGED_ELSEWHERE * all as f64 {
            return;
        }
        for (frames, flagged) in self.frames.iter_mut().zip(&self.is_flagged) {
            *frames = if *flagged { *frames + 1 } else { 0 };
        }
    }

    /// Returns whether an electrode has been flagged for long enough and is flagged in the current frame.
    pub(crate) fn is_faulty(&self, electrode: usize) -> bool {
        self.is_flagged[electrode] && self.frames[electrode] >= FLAGGED_FRAMES
    }
}
