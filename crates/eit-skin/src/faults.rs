//! Electrodes that fail while the skin is in use: open, shorted, noisy, stuck, drifting.
//!
//! A linear passive skin is reciprocal: driving `[a, b]` and measuring `[m, n]` gives the same change
//! as the other way round, whatever touches it. What breaks that is a fault, and the electrode with
//! the largest part of broken measurements has it; the rest is looked at again without it. Channels
//! that repeat themselves exactly while others move are stuck. A gain that drifts is reciprocal: there
//! the detector of touches says whose gain explains the frame ([`FaultMonitor::blame`]).
//!
//! A frame without a single good value, or one in which more contradicts than a third of the
//! electrodes explain, is a bad frame (a packet that was dropped or damaged): it is left out whole, and
//! blames nobody unless five of the second kind come in a row.
//!
//! Costs a few operations for each measurement and electrode, and allocates nothing after set-up.

mod contradictions;
mod flagged;
mod history;
mod monitor;
mod protocol;
mod reference;
mod stream;

pub use monitor::FaultMonitor;
pub(crate) use reference::of_reference;
pub use stream::{StreamMonitor, of_frames};

use serde_json::{Value, json};

/// What is wrong with an electrode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum FaultKind {
    /// Its measurements contradict their reciprocals, or are dead: open, shorted or noisy.
    Contradicts,
    /// Its measurements repeat themselves while others change.
    Stuck,
    /// Its gain drifts away: a contact that gets worse.
    Drifts,
    /// The instrument flags most of its measurements.
    Flagged,
}

impl FaultKind {
    /// For people, after "electrode 5 ".
    pub fn words(self) -> &'static str {
        match self {
            Self::Contradicts => "contradicts the others: open, shorted or noisy",
            Self::Stuck => "is stuck: its measurements repeat themselves",
            Self::Drifts => "drifts: its contact gets worse",
            Self::Flagged => "is flagged by the instrument",
        }
    }
}

/// An electrode that is left out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElectrodeFault {
    /// Electrode, from 0.
    pub electrode: usize,
    /// What is wrong.
    pub kind: FaultKind,
    /// Time of the frame in which it was found, seconds.
    pub since_s: f64,
}

impl ElectrodeFault {
    /// For people; electrodes are numbered from 1.
    pub fn words(&self) -> String {
        let Self { electrode, kind, since_s } = self;
        format!("electrode {} {}; left out from {since_s:.2} s on", electrode + 1, kind.words())
    }

    /// For programs; electrodes are numbered from 1.
    pub fn json(&self) -> Value {
        json!({
            "electrode": self.electrode + 1,
            "fault": self.kind.words(),
            "since_s": self.since_s,
        })
    }
}
