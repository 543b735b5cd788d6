//! Faults of electrodes while the skin is in use: open, shorted, noisy, stuck, drifting.
//!
//! A linear passive skin is reciprocal: driving `[a, b]` and measuring `[m, n]` gives the same change as the
//! reverse, whatever touches it. A violation of reciprocity therefore indicates a fault. The electrode with
//! the largest fraction of violating measurements is taken to be faulty, and the rest is examined again
//! without it. Channels that repeat exactly while others change are stuck. A drifting gain is reciprocal; the
//! touch detector reports the electrode whose gain explains the frame ([`FaultMonitor::blame`]).
//!
//! A frame is bad (a dropped or damaged packet) if it has no valid value, or more violations than faults of a
//! third of the electrodes explain. A bad frame is discarded whole and blames no electrode, unless five of
//! the second kind come in a row.
//!
//! The monitor needs a few operations per measurement and electrode, and does not allocate after set-up.

mod contradictions;
mod flagged;
mod history;
mod monitor;
mod protocol;
mod reference;
mod stream;

pub use monitor::FaultMonitor;
pub(crate) use reference::of_reference;
pub use stream::StreamMonitor;
pub(crate) use stream::of_frames;

use eit_fem::Protocol;

/// Returns the measurements of each electrode among those given.
pub(crate) fn of_electrode(protocol: &Protocol, measured: &[bool]) -> Vec<Vec<usize>> {
    protocol::Wiring::new(protocol, measured).of_electrode
}

/// Kind of electrode fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub enum FaultKind {
    /// Its measurements violate reciprocity or are dead: open, shorted or noisy.
    Contradicts,
    /// Its measurements repeat exactly while others change.
    Stuck,
    /// Its gain drifts: a contact that gets worse.
    Drifts,
    /// The instrument flags most of its measurements.
    Flagged,
}

impl FaultKind {
    /// Describes the fault for people, to follow "electrode 5 ".
    pub fn description(self) -> &'static str {
        match self {
            Self::Contradicts => "contradicts the others: open, shorted or noisy",
            Self::Stuck => "is stuck: its measurements repeat exactly",
            Self::Drifts => "drifts: its contact gets worse",
            Self::Flagged => "is flagged by the instrument",
        }
    }
}

/// An electrode that is excluded because of a fault.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ElectrodeFault {
    /// Electrode index, from 0.
    pub electrode: usize,
    /// What is wrong with the electrode.
    pub kind: FaultKind,
    /// Time of the frame in which the fault was found, seconds.
    pub since_s: f64,
}

/// Describes faults for people, one line for each electrode and kind.
pub fn fault_lines(faults: &[ElectrodeFault]) -> Vec<String> {
    let is_same =
        |a: &ElectrodeFault, b: &ElectrodeFault| (a.electrode, a.kind) == (b.electrode, b.kind);
    let is_first = |k: &usize| !faults[..*k].iter().any(|fault| is_same(fault, &faults[*k]));
    let line = |k: usize| {
        let again: Vec<_> =
            faults[k + 1..].iter().filter(|fault| is_same(fault, &faults[k])).collect();
        let more = match again[..] {
            [] => String::new(),
            [once] => format!(", and again from {:.2} s on", once.since_s),
            [first, ..] => {
                format!(", and {} times again, first from {:.2} s on", again.len(), first.since_s)
            }
        };
        faults[k].description() + &more
    };
    (0..faults.len()).filter(is_first).map(line).collect()
}

impl ElectrodeFault {
    /// Describes the fault for people; electrodes are numbered from 1.
    pub fn description(&self) -> String {
        let Self { electrode, kind, since_s } = self;
        format!(
            "electrode {} {}; excluded from {since_s:.2} s on",
            electrode + 1,
            kind.description()
        )
    }

    /// Returns what a report in JSON holds of the fault; electrodes are numbered from 1.
    pub fn json(&self) -> impl serde::Serialize + use<> {
        #[derive(serde::Serialize)]
        struct Reported {
            electrode: usize,
            fault: &'static str,
            since_s: f64,
        }
        Reported {
            electrode: self.electrode + 1,
            fault: self.kind.description(),
            since_s: self.since_s,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_listed_once_an_electrode() {
        let fault =
            |electrode, since_s| ElectrodeFault { electrode, kind: FaultKind::Drifts, since_s };
        let lines = fault_lines(&[fault(6, 2.5), fault(2, 3.0), fault(6, 4.0), fault(6, 5.0)]);
        assert_eq!(
            lines,
            [
                "electrode 7 drifts: its contact gets worse; excluded from 2.50 s on, and 2 times again, first from 4.00 s on",
                "electrode 3 drifts: its contact gets worse; excluded from 3.00 s on"
            ]
        );
        assert!(
            fault_lines(&[fault(6, 2.5), fault(6, 4.0)])[0].ends_with("and again from 4.00 s on")
        );
    }
}
