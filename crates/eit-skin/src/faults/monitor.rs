//! Detects electrode faults frame by frame.

mod healing;
mod jumps;

use super::contradictions::Contradictions;
use super::flagged::Flagged;
use super::history::History;
use super::protocol::Wiring;
use super::{ElectrodeFault, FaultKind};
use crate::error::SkinError;
use eit_core::event;
use eit_fem::Protocol;
use ndarray::ArrayView2;

/// Number of consecutive bad frames after which electrodes are excluded nevertheless.
const GARBAGE_FRAMES: usize = 5;
/// Largest fraction of the measurements that touches can make jump in one frame. More have jumped
/// in a damaged frame, such as one with all values equal, at full scale or too large by a factor,
/// although it is reciprocal.
const JUMPED_AT_ONCE: f64 = 0.5;
/// Number of consecutive frames that must blame an electrode's gain: one is no proof, each more costs a
/// frame.
const BLAMED_FRAMES: usize = 2;

/// Fewest frames of the untouched skin that show whether frames repeat.
const LEAST_QUIET: usize = 16;
/// Number of consecutive repeats at which an instrument counts as frozen. Where 16 bits show the
/// noise, three of 2 786 simulated frames repeated the one before, none two in a row; where the
/// bits hide it, twelve in a row did, after two among the quiet frames.
const REPEATED: usize = 9;
/// The same if one quiet frame repeats the one before.
const REPEATED_AGAIN: usize = 2 * REPEATED;

/// Fault state of an electrode.
#[derive(Debug, Clone, Copy, Default)]
struct Suspect {
    fault: Option<ElectrodeFault>,
    /// Number of consecutive frames that blame its gain.
    votes: usize,
    /// Whether it is faulty because its measurements have jumped.
    has_jumped: bool,
    /// Time since when it behaves normally, seconds.
    good_since_s: Option<f64>,
    /// Median ratio of its measurements to their reference at that time.
    gain: f64,
}

/// Detects faulty electrodes frame by frame.
#[derive(Debug, Clone)]
pub struct FaultMonitor {
    wiring: Wiring,
    used: Vec<bool>,
    std_v: Vec<f64>,
    step_v: f64,
    suspects: Vec<Suspect>,
    /// Whether the last frame is discarded entirely.
    is_bad: bool,
    /// Number of consecutive frames with too many violations.
    garbage_frames: usize,
    /// Time of the last frame, seconds.
    before_s: Option<f64>,
    history: History,
    flagged: Flagged,
    contradictions: Contradictions,
    /// Measurements that have changed by more than touches could.
    jumps: Contradictions,
    /// Number of consecutive unexplained frames in which each electrode's measurements have jumped.
    jumped_frames: Vec<usize>,
    /// Number of consecutive repeats at which the instrument counts as frozen; `None` if unknown.
    frozen_from: Option<usize>,
    is_frozen: bool,
    is_missing: Vec<bool>,
    healed: Vec<usize>,
    faults: Vec<ElectrodeFault>,
    lasting: Vec<ElectrodeFault>,
    gains: Vec<f64>,
}

impl FaultMonitor {
    /// Creates a monitor for the frames of a protocol. `used` tells which measurements count; the
    /// noise of a frame's voltages and the converter's step (0 if unknown) are in volts.
    ///
    /// # Errors
    ///
    /// A list with the wrong length for the protocol; a step that is negative or not finite.
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
            is_bad: false,
            garbage_frames: 0,
            before_s: None,
            used: used.to_vec(),
            std_v: std_v.to_vec(),
            step_v,
            history: History::new(measurements, electrodes),
            flagged: Flagged::new(electrodes),
            contradictions: Contradictions::new(measurements, electrodes),
            jumps: Contradictions::new(measurements, electrodes),
            jumped_frames: vec![0; electrodes],
            frozen_from: None,
            is_frozen: false,
            is_missing: vec![false; measurements],
            healed: Vec::with_capacity(measurements),
            faults: Vec::with_capacity(electrodes),
            lasting: Vec::new(),
            gains: Vec::with_capacity(measurements),
            wiring,
        })
    }

    /// Adds faults that last as long as the reference, whose measurements do not count; they are
    /// listed with the others.
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

    /// Sets frames of the untouched skin, `[frame, measurement]`, with the instrument's own noise.
    /// If at most one of them repeats the one before, a long run of equal frames later on means
    /// that the instrument sends an old frame. Fewer than sixteen frames are ignored.
    ///
    /// # Errors
    ///
    /// Frames with another number of measurements.
    pub fn with_quiet_frames(mut self, quiet_v: ArrayView2<'_, f64>) -> Result<Self, SkinError> {
        SkinError::check_measurements("quiet_v", quiet_v.ncols(), self.used.len())?;
        let repeats = |f: usize| {
            (0..self.used.len()).all(|i| !self.used[i] || quiet_v[(f, i)] == quiet_v[(f - 1, i)])
        };
        let repeated = (1..quiet_v.nrows()).filter(|&f| repeats(f)).count();
        self.frozen_from = match (quiet_v.nrows() >= LEAST_QUIET, repeated) {
            (true, 0) => Some(REPEATED),
            (true, 1) => Some(REPEATED_AGAIN),
            _ => None,
        };
        Ok(self)
    }

    /// Sets the fraction of their reference by which reciprocal halves may differ.
    pub(super) fn with_wrong_drift(mut self, part: f64) -> Self {
        self.contradictions.wrong_drift = part;
        self
    }

    /// Returns the used measurements that involve each electrode.
    pub(crate) fn of_electrode(&self) -> &[Vec<usize>] {
        &self.wiring.of_electrode
    }

    /// Returns the reciprocal of each measurement; its own index if it has none.
    pub fn reciprocal(&self) -> &[usize] {
        &self.wiring.reciprocal
    }

    /// Processes a frame `[measurement]`, volts, with its reference. Afterwards
    /// [`is_missing`](Self::is_missing) tells which measurements to exclude.
    ///
    /// # Errors
    ///
    /// A frame or reference with the wrong length; a time that is not finite. The monitor is then
    /// unchanged.
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
        let Self { contradictions, jumps, history, wiring, std_v, used, is_missing, .. } = self;
        let counts = |i: usize| used[i] && !is_missing[i];
        contradictions.compare(&wiring.reciprocal, std_v, [values, reference], counts);
        jumps.compare_jumps(std_v, [values, reference], counts);
        history.push(values, used);
        self.healed.clear();
        self.is_frozen = self.frozen_from.is_some_and(|from| self.history.repeated() >= from);
        self.is_bad = self.is_frozen
            || !(0..self.used.len()).any(|i| self.used[i] && !self.is_missing[i])
            || self.is_garbage();
        if self.is_bad {
            self.pass_over(time_s);
        } else {
            self.condemn_all(time_s);
            self.heal(values, reference, time_s);
        }
        self.before_s = Some(time_s);
        self.leave_out();
        Ok(())
    }

    /// Returns whether the current frame is discarded entirely: it has no valid value, it repeats
    /// those before it ([`is_frozen`](Self::is_frozen)), or it has more violations than faults of a
    /// third of the electrodes explain, so that a damaged packet is more likely.
    pub fn is_bad(&self) -> bool {
        self.is_bad
    }

    /// Returns whether the last frames are exact repeats, which do not occur on the untouched skin:
    /// the instrument sends an old frame. Never true without frames of the untouched skin
    /// ([`with_quiet_frames`](Self::with_quiet_frames)).
    pub fn is_frozen(&self) -> bool {
        self.is_frozen
    }

    /// Reports the electrode, if any, whose gain explains the frame far better than touches do, as found by
    /// the touch detector.
    ///
    /// # Errors
    ///
    /// An electrode that the protocol does not have; a time that is not finite. The monitor is then
    /// unchanged.
    pub fn blame(&mut self, electrode: Option<usize>, time_s: f64) -> Result<(), SkinError> {
        electrode.map_or(Ok(()), |e| self.check_electrode(e))?;
        check_time(time_s)?;
        if self.is_bad {
            // a bad frame says nothing about any electrode
            return Ok(());
        }
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

    /// Returns whether to exclude a measurement of the last frame: it is bad, its electrode is faulty, or the
    /// protocol does not have it.
    pub fn is_missing(&self, measurement: usize) -> bool {
        self.is_missing.get(measurement).copied().unwrap_or(true)
    }

    /// Returns the electrodes that are excluded now: lasting faults first, then the others in ascending
    /// order.
    pub fn faults(&self) -> &[ElectrodeFault] {
        &self.faults
    }

    /// Returns the measurements that became valid again with the last frame; their reference is unknown.
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

    /// Returns whether there are too many violations for electrode faults to be the cause; only for the first
    /// few frames in a row.
    fn is_garbage(&mut self) -> bool {
        self.accuse();
        let Self { wiring, suspects, contradictions, jumps, is_missing, used, .. } = self;
        let counts = |i: usize| used[i] && !is_missing[i];
        let is_out = |e: usize| suspects[e].fault.is_some();
        // four open electrodes change as many, but are told by reciprocity
        let has_jumped =
            contradictions.accused().is_empty() && jumps.part_wrong(counts) > JUMPED_AT_ONCE;
        let is_garbage = has_jumped || !contradictions.is_explained(wiring, counts, is_out);
        self.garbage_frames = if is_garbage { self.garbage_frames + 1 } else { 0 };
        is_garbage && self.garbage_frames < GARBAGE_FRAMES
    }

    /// Looks for new faults in a frame that is not bad.
    fn condemn_all(&mut self, time_s: f64) {
        let Self { wiring, used, is_missing, history, flagged, .. } = self;
        flagged.push(wiring, used, is_missing);
        history.look_for_stuck(wiring, used, self.step_v);
        for e in 0..self.suspects.len() {
            if self.flagged.is_faulty(e) {
                self.condemn(e, FaultKind::Flagged, time_s);
            }
            if self.history.is_stuck(e) {
                self.condemn(e, FaultKind::Stuck, time_s);
            }
        }
        // again: stuck and flagged electrodes are excluded by now
        self.accuse();
        for k in 0..self.contradictions.accused().len() {
            let electrode = self.contradictions.accused()[k];
            self.condemn(electrode, FaultKind::Contradicts, time_s);
        }
    }

    fn accuse(&mut self) {
        let Self { contradictions, wiring, is_missing, suspects, .. } = self;
        contradictions.accuse(wiring, is_missing, |e| suspects[e].fault.is_some());
    }

    pub(super) fn condemn(&mut self, electrode: usize, kind: FaultKind, since_s: f64) {
        let suspect = &mut self.suspects[electrode];
        suspect.good_since_s = None;
        if suspect.fault.is_none() {
            let (number, why) = (electrode + 1, kind.description());
            event!(WARN, "left out an electrode", number = number, why = why, since_s = since_s);
        }
        suspect.fault.get_or_insert(ElectrodeFault { electrode, kind, since_s });
    }

    /// Marks measurements of faulty electrodes, and single pairs that violate reciprocity, as missing.
    pub(super) fn leave_out(&mut self) {
        self.faults.clear();
        self.faults.extend_from_slice(&self.lasting);
        self.faults.extend(self.suspects.iter().filter_map(|suspect| suspect.fault));
        for i in 0..self.used.len() {
            let faulty = |e: &usize| self.suspects[*e].fault.is_some();
            let of_i = &self.wiring.of_measurement[i];
            let is_bad = self.is_bad && self.used[i];
            if is_bad || self.contradictions.is_wrong[i] || of_i.iter().any(faulty) {
                self.is_missing[i] = true;
            }
        }
        let Self { healed, is_missing, .. } = self;
        healed.retain(|&i| !is_missing[i]);
    }
}

pub(super) fn check_time(time_s: f64) -> Result<(), SkinError> {
    match time_s.is_finite() {
        true => Ok(()),
        false => Err(SkinError::OutOfRange { key: "time_s", value: time_s, must: "finite" }),
    }
}
