//! Electrodes that fail, frame by frame.

use super::contradictions::Contradictions;
use super::history::History;
use super::protocol::Wiring;
use super::{ElectrodeFault, FaultKind};
use crate::error::SkinError;
use eit_fem::Protocol;

/// Frames that a stuck electrode repeats itself.
const STUCK_FRAMES: usize = 5;
/// Part of the other channels that must move meanwhile, ...
const MOVING: f64 = 0.4;
/// ... by so many steps of the converter.
const MOVING_STEPS: f64 = 3.0;
/// Frames in a row that must blame an electrode's gain.
const BLAMED_FRAMES: usize = 3;
/// Time for which a faulty electrode must behave to be used again, seconds.
const HEALED_S: f64 = 1.0;
/// Relative change over that time below which a gain has stopped drifting.
const STILL: f64 = 1e-3;

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
    wiring: Wiring,
    used: Vec<bool>,
    std_v: Vec<f64>,
    step_v: f64,
    suspects: Vec<Suspect>,
    history: History,
    contradictions: Contradictions,
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
    ///
    /// # Errors
    ///
    /// Lists of another length than the protocol has measurements, a step that is below zero or no
    /// number.
    pub fn new(
        protocol: &Protocol,
        used: &[bool],
        std_v: &[f64],
        step_v: f64,
    ) -> Result<Self, SkinError> {
        let measurements = protocol.measurements();
        SkinError::check_measurements("used", used.len(), measurements)?;
        SkinError::check_measurements("std_v", std_v.len(), measurements)?;
        if !(step_v >= 0.0 && step_v.is_finite()) {
            let (key, must) = ("step_v", "finite and not below zero");
            return Err(SkinError::OutOfRange { key, value: step_v, must });
        }
        let wiring = Wiring::new(protocol, used);
        let electrodes = wiring.of_electrode.len();
        Ok(Self {
            suspects: vec![Suspect::default(); electrodes],
            used: used.to_vec(),
            std_v: std_v.to_vec(),
            step_v,
            history: History::new(STUCK_FRAMES, measurements),
            contradictions: Contradictions::new(measurements, electrodes),
            is_missing: vec![false; measurements],
            is_moving: vec![false; measurements],
            healed: Vec::with_capacity(measurements),
            faults: Vec::with_capacity(electrodes),
            lasting: Vec::new(),
            gains: Vec::with_capacity(measurements),
            wiring,
        })
    }

    /// Faults that last as long as the reference, whose measurements do not count: listed with the others.
    ///
    /// # Errors
    ///
    /// An electrode that the protocol does not have.
    pub fn with_lasting(mut self, faults: &[ElectrodeFault]) -> Result<Self, SkinError> {
        faults.iter().try_for_each(|fault| self.check_electrode(fault.electrode))?;
        self.lasting = faults.to_vec();
        self.faults.reserve(faults.len());
        self.leave_out();
        Ok(self)
    }

    /// Measurements that involve each electrode and count.
    pub fn of_electrode(&self) -> &[Vec<usize>] {
        &self.wiring.of_electrode
    }

    /// Reciprocal of each measurement; itself where there is none.
    pub fn reciprocal(&self) -> &[usize] {
        &self.wiring.reciprocal
    }

    /// Takes a frame `[measurement]`, volts, with the reference it is held against. Afterwards
    /// [`is_missing`](Self::is_missing) says what to leave out of it.
    ///
    /// # Errors
    ///
    /// A frame or reference of another length than the protocol has measurements, a time that is no
    /// number. The monitor is then as before.
    pub fn push(
        &mut self,
        values: &[f64],
        reference: &[f64],
        is_good: impl Fn(usize) -> bool,
        time_s: f64,
    ) -> Result<(), SkinError> {
        SkinError::check_measurements("the frame", values.len(), self.used.len())?;
        SkinError::check_measurements("the reference", reference.len(), self.used.len())?;
        check_time(time_s)?;
        for (i, missing) in self.is_missing.iter_mut().enumerate() {
            *missing = self.used[i] && !(is_good(i) && values[i].is_finite());
        }
        let Self { contradictions, wiring, std_v, used, is_missing, .. } = self;
        let counts = |i: usize| used[i] && !is_missing[i];
        contradictions.compare(&wiring.reciprocal, std_v, [values, reference], counts);
        self.history.push(values);
        self.look_for_flagged(time_s);
        self.look_for_stuck(time_s);
        self.look_for_contradictions(time_s);
        self.heal(values, reference, time_s);
        self.leave_out();
        Ok(())
    }

    /// The detector of touches says whose gain explains the frame far better than touches do.
    ///
    /// # Errors
    ///
    /// An electrode that the protocol does not have, a time that is no number. The monitor is then as
    /// before.
    pub fn blame(&mut self, electrode: Option<usize>, time_s: f64) -> Result<(), SkinError> {
        electrode.map_or(Ok(()), |e| self.check_electrode(e))?;
        check_time(time_s)?;
        for (e, suspect) in self.suspects.iter_mut().enumerate() {
            suspect.votes = if electrode == Some(e) { suspect.votes + 1 } else { 0 };
            if suspect.votes >= BLAMED_FRAMES && suspect.fault.is_none() {
                suspect.fault =
                    Some(ElectrodeFault { electrode: e, kind: FaultKind::Drifts, since_s: time_s });
                suspect.good_since_s = None;
            }
        }
        self.leave_out();
        Ok(())
    }

    /// Whether a measurement of the last frame is to be left out: it is bad, or its electrode is, or
    /// the protocol does not have it.
    pub fn is_missing(&self, measurement: usize) -> bool {
        self.is_missing.get(measurement).copied().unwrap_or(true)
    }

    /// Electrodes that are left out now, by ascending number.
    pub fn faults(&self) -> &[ElectrodeFault] {
        &self.faults
    }

    /// Measurements that came back with the last frame, and whose reference nobody knows.
    pub fn healed(&self) -> &[usize] {
        &self.healed
    }

    fn check_electrode(&self, electrode: usize) -> Result<(), SkinError> {
        let electrodes = self.suspects.len();
        match electrode < electrodes {
            true => Ok(()),
            false => Err(SkinError::NoSuchElectrode { electrode, electrodes }),
        }
    }

    fn look_for_flagged(&mut self, time_s: f64) {
        for e in 0..self.suspects.len() {
            let of_e = &self.wiring.of_electrode[e];
            let flagged = of_e.iter().filter(|&&i| self.is_missing[i]).count();
            if !of_e.is_empty() && flagged as f64 > 0.9 * of_e.len() as f64 {
                self.condemn(e, FaultKind::Flagged, time_s);
            }
        }
    }

    fn look_for_stuck(&mut self, time_s: f64) {
        if !self.history.is_full() {
            return;
        }
        for i in 0..self.used.len() {
            self.is_moving[i] = self.used[i] && self.history.span(i) > MOVING_STEPS * self.step_v;
        }
        let all_used = self.used.iter().filter(|used| **used).count();
        let all_moving = self.is_moving.iter().filter(|moving| **moving).count();
        for e in 0..self.suspects.len() {
            let of_e = &self.wiring.of_electrode[e];
            let own = of_e.iter().filter(|&&i| self.is_moving[i]).count();
            let others = all_used - of_e.len();
            let is_moving = (all_moving - own) as f64 > MOVING * others as f64;
            let is_still = of_e.iter().all(|&i| self.history.span(i) == 0.0);
            if is_moving && !of_e.is_empty() && is_still {
                self.condemn(e, FaultKind::Stuck, time_s);
            }
        }
    }

    fn look_for_contradictions(&mut self, time_s: f64) {
        let Self { contradictions, wiring, is_missing, suspects, .. } = self;
        let accused = contradictions.accuse(wiring, is_missing, |e| suspects[e].fault.is_some());
        for k in 0..accused.len() {
            let electrode = self.contradictions.accused()[k];
            self.condemn(electrode, FaultKind::Contradicts, time_s);
        }
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
            let mut of_e = self.wiring.of_electrode[e].iter();
            let behaves = match fault.kind {
                FaultKind::Contradicts => self.wrong_part(e) < 0.1,
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
                self.healed.extend_from_slice(&self.wiring.of_electrode[e]);
            }
        }
    }

    /// Part of a faulty electrode's measurements that are wrong.
    fn wrong_part(&self, electrode: usize) -> f64 {
        let is_out = |e: usize| self.suspects[e].fault.is_some();
        let Self { contradictions, wiring, is_missing, .. } = self;
        contradictions.wrong_part(wiring, electrode, is_missing, is_out).unwrap_or(0.0)
    }

    /// Median of an electrode's measurements over their reference.
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

    /// Measurements of faulty electrodes, and pairs that contradict themselves alone.
    fn leave_out(&mut self) {
        self.faults.clear();
        self.faults.extend_from_slice(&self.lasting);
        self.faults.extend(self.suspects.iter().filter_map(|suspect| suspect.fault));
        for i in 0..self.used.len() {
            let faulty = |e: &usize| self.suspects[*e].fault.is_some();
            let of_i = &self.wiring.of_measurement[i];
            if self.contradictions.is_wrong[i] || of_i.iter().any(faulty) {
                self.is_missing[i] = true;
            }
        }
        let Self { healed, is_missing, .. } = self;
        healed.retain(|&i| !is_missing[i]);
    }
}

fn check_time(time_s: f64) -> Result<(), SkinError> {
    match time_s.is_finite() {
        true => Ok(()),
        false => Err(SkinError::OutOfRange { key: "time_s", value: time_s, must: "finite" }),
    }
}
