//! The first frames of an epoch, which become its reference.

use crate::frames::{left_out, of_frames, steady};
use crate::scene::LEAST_REFERENCE_FRAMES;
use eit_hw::{Frame, Unit};

/// While frames change as if the skin were touched, the reference waits up to this many times its length.
const PATIENCE: usize = 10;

/// Collects frames until there are enough of the untouched skin.
#[derive(Debug, Clone)]
pub(super) struct ReferenceFrames {
    wanted: usize,
    frames: Vec<Frame>,
    /// Number of frames received, ...
    came: usize,
    /// ... and number of outliers among them.
    others: usize,
    /// Largest relative change of the voltages, if the skin did not rest.
    unrest: Option<f64>,
    /// Numbers of the frames to take, ascending, if they are known; ...
    named: Vec<u64>,
    /// ... and what to say about those that did not come.
    missing: Option<String>,
}

impl ReferenceFrames {
    pub(crate) fn new(wanted: usize) -> Self {
        Self {
            wanted,
            frames: Vec::with_capacity(wanted),
            came: 0,
            others: 0,
            unrest: None,
            named: Vec::new(),
            missing: None,
        }
    }

    /// Takes the frames with these numbers and no others.
    pub(crate) fn of_named(wanted: usize, mut named: Vec<u64>) -> Self {
        named.sort_unstable();
        named.dedup();
        Self { named, ..Self::new(wanted) }
    }

    /// Adds a frame; returns whether there are enough. Outliers (damaged frames, those before a
    /// gain was set) are left out. While the others change as if something touched the skin, the
    /// older half of them is dropped.
    pub(crate) fn take(&mut self, frame: &Frame) -> bool {
        if let Some(last) = self.named.last() {
            let is_named = self.named.binary_search(&frame.sequence).is_ok();
            self.frames.extend(is_named.then(|| frame.clone()));
            if frame.sequence < *last {
                return false;
            }
            let (came, named) = (self.frames.len(), self.named.len());
            if came < named {
                self.missing = Some(format!(
                    "{} of the {named} reference frames of the recording are missing",
                    named - came
                ));
            }
            let is_enough = came >= LEAST_REFERENCE_FRAMES;
            if !is_enough {
                // as if the recording named none
                (self.named, self.came) = (Vec::new(), came);
            }
            return is_enough;
        }
        self.frames.push(frame.clone());
        self.came += 1;
        if self.frames.len() < self.wanted {
            return false;
        }
        let is_patient = self.came < PATIENCE * self.wanted;
        let all = of_frames(&self.frames, Unit::Volt);
        let is_good = |f: usize, i: usize| all.quality[(f, i)].is_good();
        let others = steady::others(all.values.view(), is_good);
        if is_patient && !others.is_empty() && 2 * others.len() < self.wanted {
            self.others += others.len();
            let mut frame = 0..;
            self.frames.retain(|_| !frame.next().is_some_and(|f| others.contains(&f)));
            return false;
        }
        let unrest = steady::unrest(all.values.view(), is_good);
        if let (true, Some(change)) = (is_patient, unrest) {
            self.unrest = Some(self.unrest.unwrap_or(0.0).max(change));
            self.frames.drain(..self.wanted.div_ceil(2));
            return false;
        }
        true
    }

    /// Relative change of the voltages, if the skin did not rest.
    pub(crate) fn unrest(&self) -> Option<f64> {
        self.unrest
    }

    /// Number of frames still needed.
    pub(crate) fn left(&self) -> usize {
        let wanted = if self.named.is_empty() { self.wanted } else { self.named.len() };
        wanted.saturating_sub(self.frames.len()).max(1)
    }

    /// Returns the frames and notes about them, and starts again.
    pub(crate) fn finish(&mut self) -> (Vec<Frame>, Vec<String>) {
        let Self { wanted, frames, came, others, unrest, missing, .. } =
            std::mem::replace(self, Self::new(self.wanted));
        let mut notes = Vec::from_iter(missing);
        if others > 0 {
            notes.push(left_out(others));
        }
        if let Some(change) = unrest.filter(|_| came < PATIENCE * wanted) {
            notes.push(format!(
                "the reference was taken {} frames later: until then frames changed by {:.1} % of the voltages, as if \
                 the skin were touched or let go",
                came - wanted - others,
                100.0 * change
            ));
        }
        // the frames themselves are looked at again with the measurements that are used
        (frames, notes)
    }
}
