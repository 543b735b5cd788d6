//! Electrodes that fail while the skin is in use: open, shorted, noisy, stuck, drifting.
//!
//! A linear passive skin is reciprocal: driving `[a, b]` and measuring `[m, n]` gives the same change
//! as the other way round, whatever touches it. What breaks that is a fault, and the electrode with
//! the largest part of broken measurements has it; the rest is looked at again without it. Channels
//! that repeat themselves exactly while others move are stuck. A gain that drifts is reciprocal: there
//! the detector of touches says whose gain explains the frame ([`FaultMonitor::blame`]).
//!
//! Costs a few operations for each measurement and electrode, and allocates nothing after the first
//! frames.

use eit_fem::Protocol;
use serde_json::{Value, json};
use std::collections::HashMap;

/// Frames that a stuck electrode repeats itself.
const STUCK_FRAMES: usize = 5;
/// Part of the other channels that must move meanwhile, ...
const MOVING: f64 = 0.4;
/// ... by so many steps of the converter.
const MOVING_STEPS: f64 = 3.0;
/// Part of an electrode's reciprocal pairs that must be wrong for it to be faulty.
const FAULTY: f64 = 0.5;
/// A pair is wrong where its halves differ by so many standard deviations of the noise ...
const WRONG_STD: f64 = 10.0;
/// ... this part of their change, since gains of real channels are not equal, ...
const WRONG_PART: f64 = 0.25;
/// ... and this part of their reference, since real channels drift apart.
const WRONG_DRIFT: f64 = 1e-3;
/// A measurement below this part of its reference is dead.
const DEAD: f64 = 0.02;
/// Frames in a row that must blame an electrode's gain.
const BLAMED_FRAMES: usize = 3;
/// An electrode is faulty from the start where its measurements' noise is this many times the median
/// noise and ...
const NOISY_TIMES: f64 = 30.0;
/// ... this part of the median voltage.
const NOISY_PART: f64 = 0.01;
/// Time for which a faulty electrode must behave to be used again, seconds.
const HEALED_S: f64 = 1.0;
/// Relative change over that time below which a gain has stopped drifting.
const STILL: f64 = 1e-3;

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

/// An electrode under suspicion.
#[derive(Debug, Clone, Copy, Default)]
struct Suspect {
    fault: Option<ElectrodeFault>,
    /// Frames in a row that blame its gain.
    votes: usize,
    /// Since when it behaves, seconds.
    good_since_s: Option<f64>,
    /// Median of its measurements over their reference at that time.
    gain: f64,
}

/// Looks for faulty electrodes in frame after frame.
#[derive(Debug, Clone)]
pub struct FaultMonitor {
    /// Electrodes of each measurement.
    electrodes_of: Vec<Vec<usize>>,
    of_electrode: Vec<Vec<usize>>,
    /// Reciprocal of each measurement; itself where there is none.
    reciprocal: Vec<usize>,
    used: Vec<bool>,
    std_v: Vec<f64>,
    step_v: f64,
    suspects: Vec<Suspect>,
    /// The last frames, the newest last.
    history: Vec<Vec<f64>>,
    is_wrong: Vec<bool>,
    is_missing: Vec<bool>,
    is_moving: Vec<bool>,
    healed: Vec<usize>,
    faults: Vec<ElectrodeFault>,
    lasting: Vec<ElectrodeFault>,
    gains: Vec<f64>,
}

impl FaultMonitor {
    /// For frames of a protocol: which measurements count, the noise of a frame's voltages and the
    /// converter's step (0 where unknown), volts.
    pub fn new(protocol: &Protocol, used: &[bool], std_v: &[f64], step_v: f64) -> Self {
        let electrodes_of = electrodes_of(protocol);
        let mut of_electrode = vec![Vec::new(); protocol.electrodes()];
        for (i, electrodes) in electrodes_of.iter().enumerate() {
            electrodes.iter().filter(|_| used[i]).for_each(|&e| of_electrode[e].push(i));
        }
        Self {
            suspects: vec![Suspect::default(); of_electrode.len()],
            electrodes_of,
            of_electrode,
            reciprocal: reciprocal(protocol),
            used: used.to_vec(),
            std_v: std_v.to_vec(),
            step_v,
            history: Vec::with_capacity(STUCK_FRAMES),
            is_wrong: vec![false; used.len()],
            is_missing: vec![false; used.len()],
            is_moving: vec![false; used.len()],
            healed: Vec::new(),
            faults: Vec::new(),
            lasting: Vec::new(),
            gains: Vec::new(),
        }
    }

    /// Faults that last as long as the reference, whose measurements do not count: listed with the others.
    pub fn with_lasting(mut self, faults: &[ElectrodeFault]) -> Self {
        self.lasting = faults.to_vec();
        self.leave_out();
        self
    }

    /// Measurements that involve each electrode and count.
    pub fn of_electrode(&self) -> &[Vec<usize>] {
        &self.of_electrode
    }

    /// Reciprocal of each measurement; itself where there is none.
    pub fn reciprocal(&self) -> &[usize] {
        &self.reciprocal
    }

    /// Takes a frame `[measurement]`, volts, with the reference it is held against. Afterwards
    /// [`is_missing`](Self::is_missing) says what to leave out of it.
    pub fn push(
        &mut self,
        values: &[f64],
        reference: &[f64],
        is_good: impl Fn(usize) -> bool,
        time_s: f64,
    ) {
        for (i, missing) in self.is_missing.iter_mut().enumerate() {
            *missing = self.used[i] && !(is_good(i) && values[i].is_finite());
        }
        self.compare(values, reference);
        self.remember(values);
        self.look_for_flagged(time_s);
        self.look_for_stuck(time_s);
        self.look_for_contradictions(time_s);
        self.heal(values, reference, time_s);
        self.leave_out();
    }

    /// The detector of touches says whose gain explains the frame far better than touches do.
    pub fn blame(&mut self, electrode: Option<usize>, time_s: f64) {
        for (e, suspect) in self.suspects.iter_mut().enumerate() {
            suspect.votes = if electrode == Some(e) { suspect.votes + 1 } else { 0 };
            if suspect.votes >= BLAMED_FRAMES && suspect.fault.is_none() {
                suspect.fault =
                    Some(ElectrodeFault { electrode: e, kind: FaultKind::Drifts, since_s: time_s });
                suspect.good_since_s = None;
            }
        }
        self.leave_out();
    }

    /// Whether a measurement of the last frame is to be left out: it is bad, or its electrode is.
    pub fn is_missing(&self, measurement: usize) -> bool {
        self.is_missing[measurement]
    }

    /// Electrodes that are left out now, by ascending number.
    pub fn faults(&self) -> &[ElectrodeFault] {
        &self.faults
    }

    /// Measurements that came back with the last frame, and whose reference nobody knows.
    pub fn healed(&self) -> &[usize] {
        &self.healed
    }

    /// Marks what contradicts its reciprocal, or is dead.
    fn compare(&mut self, values: &[f64], reference: &[f64]) {
        for i in 0..values.len() {
            let twin = self.reciprocal[i];
            self.is_wrong[i] = false;
            if !self.used[i] || self.is_missing[i] {
                continue;
            }
            let is_dead = |k: usize| {
                let floor = WRONG_STD * self.std_v[k];
                reference[k].abs() > 3.0 * floor
                    && values[k].abs() < (DEAD * reference[k].abs()).max(floor)
            };
            let mut wrong = is_dead(i);
            if twin != i && self.used[twin] && !self.is_missing[twin] {
                let [a, b] = [i, twin].map(|k| values[k] - reference[k]);
                let noise = self.std_v[i].hypot(self.std_v[twin]);
                let size = reference[i].abs().max(reference[twin].abs());
                let allowed =
                    WRONG_STD * noise + WRONG_PART * a.abs().max(b.abs()) + WRONG_DRIFT * size;
                wrong |= (a - b).abs() > allowed || is_dead(twin);
            }
            self.is_wrong[i] = wrong;
        }
    }

    fn remember(&mut self, values: &[f64]) {
        if self.history.len() < STUCK_FRAMES {
            self.history.push(values.to_vec());
        } else {
            self.history.rotate_left(1);
            if let Some(last) = self.history.last_mut() {
                last.copy_from_slice(values);
            }
        }
    }

    /// By how much a measurement went in the last frames.
    fn span(&self, measurement: usize) -> f64 {
        let values = self.history.iter().map(|frame| frame[measurement]);
        let (low, high) = values
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        high - low
    }

    fn look_for_flagged(&mut self, time_s: f64) {
        for e in 0..self.suspects.len() {
            let all = self.of_electrode[e].len();
            let flagged = self.of_electrode[e].iter().filter(|&&i| self.is_missing[i]).count();
            if all > 0 && flagged as f64 > 0.9 * all as f64 {
                self.condemn(e, FaultKind::Flagged, time_s);
            }
        }
    }

    fn look_for_stuck(&mut self, time_s: f64) {
        if self.history.len() < STUCK_FRAMES {
            return;
        }
        for i in 0..self.used.len() {
            self.is_moving[i] = self.used[i] && self.span(i) > MOVING_STEPS * self.step_v;
        }
        let all_used = self.used.iter().filter(|used| **used).count();
        let all_moving = self.is_moving.iter().filter(|moving| **moving).count();
        for e in 0..self.suspects.len() {
            let of_e = &self.of_electrode[e];
            let own = of_e.iter().filter(|&&i| self.is_moving[i]).count();
            let others = all_used - of_e.len();
            let is_moving = (all_moving - own) as f64 > MOVING * others as f64;
            if is_moving && !of_e.is_empty() && of_e.iter().all(|&i| self.span(i) == 0.0) {
                self.condemn(e, FaultKind::Stuck, time_s);
            }
        }
    }

    /// The electrode with the largest part of wrong pairs goes, until none has half of its own wrong.
    fn look_for_contradictions(&mut self, time_s: f64) {
        loop {
            let mut worst = None;
            let mut most = FAULTY;
            for e in 0..self.suspects.len() {
                let part = self.wrong_part(e);
                if self.suspects[e].fault.is_none() && part >= most {
                    (worst, most) = (Some(e), part.next_up());
                }
            }
            let Some(e) = worst else { return };
            self.condemn(e, FaultKind::Contradicts, time_s);
        }
    }

    /// Part of an electrode's measurements that are wrong, those of other faulty electrodes left out.
    fn wrong_part(&self, electrode: usize) -> f64 {
        let (mut wrong, mut all) = (0, 0);
        for &i in &self.of_electrode[electrode] {
            let is_other = |e: &usize| *e != electrode && self.suspects[*e].fault.is_some();
            if self.is_missing[i] || self.electrodes_of[i].iter().any(is_other) {
                continue;
            }
            all += 1;
            wrong += usize::from(self.is_wrong[i]);
        }
        // a few measurements that are left say little
        if all < 4 { 0.0 } else { f64::from(wrong as u32) / f64::from(all as u32) }
    }

    fn condemn(&mut self, electrode: usize, kind: FaultKind, since_s: f64) {
        let suspect = &mut self.suspects[electrode];
        suspect.good_since_s = None;
        suspect.fault.get_or_insert(ElectrodeFault { electrode, kind, since_s });
    }

    /// Takes electrodes back that have behaved for a while.
    fn heal(&mut self, values: &[f64], reference: &[f64], time_s: f64) {
        self.healed.clear();
        for e in 0..self.suspects.len() {
            let Some(fault) = self.suspects[e].fault else { continue };
            let gain = self.gain_of(e, values, reference);
            let before = self.suspects[e].gain;
            let behaves = match fault.kind {
                FaultKind::Contradicts => self.wrong_part(e) < 0.1,
                FaultKind::Stuck => self.of_electrode[e].iter().any(|&i| self.span(i) > 0.0),
                FaultKind::Flagged => self.of_electrode[e].iter().any(|&i| !self.is_missing[i]),
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
                self.healed.extend_from_slice(&self.of_electrode[e]);
            }
        }
    }

    /// Median of an electrode's measurements over their reference.
    fn gain_of(&mut self, electrode: usize, values: &[f64], reference: &[f64]) -> f64 {
        self.gains.clear();
        let ratios = self.of_electrode[electrode].iter().map(|&i| values[i] / reference[i]);
        self.gains.extend(ratios.filter(|r| r.is_finite()));
        if self.gains.is_empty() {
            return f64::NAN;
        }
        let middle = self.gains.len() / 2;
        *self.gains.select_nth_unstable_by(middle, f64::total_cmp).1
    }

    /// Measurements of faulty electrodes, and pairs that contradict themselves alone.
    fn leave_out(&mut self) {
        self.faults.clear();
        self.faults.extend_from_slice(&self.lasting);
        self.faults.extend(self.suspects.iter().filter_map(|suspect| suspect.fault));
        for i in 0..self.used.len() {
            let faulty = |e: &usize| self.suspects[*e].fault.is_some();
            if self.is_wrong[i] || self.electrodes_of[i].iter().any(faulty) {
                self.is_missing[i] = true;
            }
        }
        let Self { healed, is_missing, .. } = self;
        healed.retain(|&i| !is_missing[i]);
    }
}

/// Electrodes that float while the reference is taken, from the noise of its frames: they are left out
/// until a new reference is taken. And their measurements.
pub(crate) fn of_reference(
    protocol: &Protocol,
    used: &[bool],
    std_v: &[f64],
    reference_v: &[f64],
) -> (Vec<ElectrodeFault>, Vec<usize>) {
    let median = |values: &[f64]| {
        let of_used = values.iter().zip(used).filter(|(_, used)| **used);
        let mut sorted: Vec<f64> =
            of_used.map(|(value, _)| value.abs()).filter(|value| value.is_finite()).collect();
        sorted.sort_unstable_by(f64::total_cmp);
        sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
    };
    let limit = (NOISY_TIMES * median(std_v)).max(NOISY_PART * median(reference_v));
    let mut monitor = FaultMonitor::new(protocol, used, std_v, 0.0);
    for (i, wrong) in monitor.is_wrong.iter_mut().enumerate() {
        *wrong = used[i] && std_v[i] > limit;
    }
    monitor.look_for_contradictions(0.0);
    monitor.is_wrong.fill(false);
    monitor.leave_out();
    let left_out = (0..used.len()).filter(|&i| monitor.is_missing[i]).collect();
    (monitor.faults, left_out)
}

/// Electrodes of each measurement that carry current or are measured; all-electrode patterns blame
/// nobody.
fn electrodes_of(protocol: &Protocol) -> Vec<Vec<usize>> {
    let (stimulations, patterns) = (protocol.stimulations_a(), protocol.measurement_patterns());
    let of = |row: ndarray::ArrayView1<'_, f64>| -> Vec<usize> {
        let involved: Vec<usize> = (0..row.len()).filter(|&e| row[e] != 0.0).collect();
        if involved.len() > 2 { Vec::new() } else { involved }
    };
    let measurement = |&[s, m]: &[u32; 2]| {
        let mut electrodes = of(stimulations.row(s as usize));
        electrodes.extend(of(patterns.row(m as usize)));
        electrodes.sort_unstable();
        electrodes.dedup();
        electrodes
    };
    protocol.data().iter().map(measurement).collect()
}

/// The measurement with drive and measurement exchanged, with the same sign; itself where there is
/// none.
fn reciprocal(protocol: &Protocol) -> Vec<usize> {
    let Some(quadruples) = protocol.quadruples() else {
        return (0..protocol.measurements()).collect();
    };
    let index: HashMap<[u32; 4], usize> =
        quadruples.iter().enumerate().map(|(i, q)| (*q, i)).collect();
    let twin = |(i, [a, b, m, n]): (usize, &[u32; 4])| {
        let candidates = [[*m, *n, *a, *b], [*n, *m, *b, *a]];
        candidates.iter().find_map(|q| index.get(q)).copied().unwrap_or(i)
    };
    let found: Vec<usize> = quadruples.iter().enumerate().map(twin).collect();
    (0..found.len()).map(|i| if found[found[i]] == i { found[i] } else { i }).collect()
}
