//! Recovery of electrodes.

use super::{FaultMonitor, Suspect};
use crate::faults::FaultKind;
use crate::faults::contradictions::Contradictions;

/// Time for which a faulty electrode must behave normally before it is used again, seconds.
const HEALED_S: f64 = 1.0;
/// Relative change over that time below which a gain has stopped drifting.
const STILL: f64 = 1e-3;

impl FaultMonitor {
    /// Readmits electrodes that have behaved normally for long enough.
    pub(super) fn heal(&mut self, values: &[f64], reference: &[f64], time_s: f64) {
        for e in 0..self.suspects.len() {
            let Some(fault) = self.suspects[e].fault else { continue };
            let gain = self.gain_of(e, values, reference);
            let before = self.suspects[e].gain;
            let mut of_e = self.wiring.of_electrode[e].iter();
            let behaves = match fault.kind {
                FaultKind::Contradicts => {
                    let is_right = |wrong| self.wrong_part(wrong, e).is_some_and(|part| part < 0.1);
                    let has_jumped = self.suspects[e].has_jumped;
                    is_right(&self.contradictions) && (!has_jumped || is_right(&self.jumps))
                }
                FaultKind::Stuck => of_e.any(|&i| self.history.span(i) > 0.0),
                FaultKind::Flagged => of_e.any(|&i| !self.is_missing[i]),
                FaultKind::Drifts => (gain - before).abs() < STILL,
            };
            let suspect = &mut self.suspects[e];
            let since = match (behaves, suspect.good_since_s) {
                (true, Some(since)) => since,
                _ => {
                    (suspect.good_since_s, suspect.gain) = (Some(time_s), gain);
                    time_s
                }
            };
            if time_s - since >= HEALED_S {
                *suspect = Suspect::default();
                // two of its neighbours may have healed at the same time
                for &i in &self.wiring.of_electrode[e] {
                    if !self.healed.contains(&i) {
                        self.healed.push(i);
                    }
                }
            }
        }
    }

    /// Fraction of a faulty electrode's measurements that are wrong: of those without another faulty
    /// electrode, else of all. `None` if too few remain; the electrode then does not recover.
    fn wrong_part(&self, wrong: &Contradictions, electrode: usize) -> Option<f64> {
        let is_out = |e: usize| self.suspects[e].fault.is_some();
        let Self { wiring, is_missing, .. } = self;
        let alone = wrong.wrong_part(wiring, electrode, is_missing, is_out);
        alone.or_else(|| wrong.wrong_part(wiring, electrode, is_missing, |_| false))
    }

    /// Median ratio of an electrode's measurements to their reference.
    fn gain_of(&mut self, electrode: usize, values: &[f64], reference: &[f64]) -> f64 {
        self.gains.clear();
        let ratios = self.wiring.of_electrode[electrode].iter().map(|&i| values[i] / reference[i]);
        self.gains.extend(ratios.filter(|r| r.is_finite()));
        if self.gains.is_empty() {
            return f64::NAN;
        }
        let middle = self.gains.len() / 2;
        *self.gains.select_nth_unstable_by(middle, f64::total_cmp).1
    }

    /// Skips a bad frame, which neither blames nor heals: it does not count towards the recovery time.
    pub(super) fn pass_over(&mut self, time_s: f64) {
        let passed_s = self.before_s.map_or(0.0, |before_s| time_s - before_s);
        for suspect in &mut self.suspects {
            suspect.good_since_s = suspect.good_since_s.map(|since_s| since_s + passed_s);
        }
    }
}
