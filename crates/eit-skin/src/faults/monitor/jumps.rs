//! Electrodes whose measurements have jumped, in frames that nothing explains.
//!
//! Reciprocity finds an electrode that does not conduct any more only where measurements have a reciprocal, and not if it
//! conducts worse: that is reciprocal too.

use super::{FaultMonitor, check_time};
use crate::error::SkinError;
use crate::faults::FaultKind;

/// Number of consecutive frames in which an electrode's measurements must have jumped; a single
/// frame is not enough.
const FRAMES: usize = 2;

impl FaultMonitor {
    /// Sets whether touches, or their absence, explain the last frame. In an unexplained frame,
    /// electrodes whose measurements have changed by far more than touches could are faulty.
    ///
    /// # Errors
    ///
    /// A time that is not finite. The monitor is then unchanged.
    pub(crate) fn doubt(&mut self, is_explained: bool, time_s: f64) -> Result<(), SkinError> {
        check_time(time_s)?;
        let Self { jumps, wiring, suspects, is_missing, used, .. } = self;
        let is_out = |e: usize| suspects[e].fault.is_some();
        let is_doubtful = !is_explained && !self.is_bad;
        if is_doubtful {
            jumps.accuse(wiring, is_missing, is_out);
        }
        let counts = |i: usize| used[i] && !is_missing[i];
        let is_theirs = is_doubtful && jumps.is_explained(wiring, counts, is_out);
        for (e, votes) in self.jumped_frames.iter_mut().enumerate() {
            *votes = if is_theirs && jumps.accused().contains(&e) { *votes + 1 } else { 0 };
        }
        for e in 0..self.suspects.len() {
            if self.jumped_frames[e] >= FRAMES && self.suspects[e].fault.is_none() {
                self.suspects[e].has_jumped = true;
                self.condemn(e, FaultKind::Contradicts, time_s);
            }
        }
        self.leave_out();
        Ok(())
    }
}
