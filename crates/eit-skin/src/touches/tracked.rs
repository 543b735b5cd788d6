//! Touches that are found in each frame by itself, with ids that last; electrodes are left out while they fail.

#[cfg(feature = "learn")]
use super::finder::PressTouch;
use super::finder::Source;
use crate::error::SkinError;
use crate::faults::{ElectrodeFault, FaultMonitor};
#[cfg(feature = "learn")]
use crate::learn::LocalSheet;
use eit_inverse::touch::{DetectedTouch, DetectorStep, Touch, TouchTracker};
use std::fmt::Debug;

/// Finds the touches of a frame.
pub(super) trait Detector: Debug + Clone + Send + Sync + 'static {
    /// Takes a frame `[measurement]`, volts. Measurements of faulty electrodes are missing for longer than single bad values.
    fn push(
        &mut self,
        values: &[f64],
        is_faulty: impl Fn(usize) -> bool,
        is_missing: impl Fn(usize) -> bool,
        dt_s: f64,
    ) -> Result<DetectorStep, SkinError>;

    /// Touches of the last frame.
    fn found(&self) -> &[DetectedTouch];

    /// The reference that the next frame is compared with, `[measurement]`.
    fn reference_v(&self) -> &[f64];

    fn set_reference(&mut self, measurement: usize, value: f64);

    /// Takes back what the reference has learnt from the last frames: an electrode was faulty.
    fn take_back_reference(&mut self);

    /// The point of the skin nearest to a point; the point itself if touches are on the skin anyway.
    fn nearest_on_skin(&self, point_m: [f64; 3]) -> [f64; 3] {
        point_m
    }
}

/// A detector with ids and a monitor of electrodes.
#[derive(Debug, Clone)]
pub(super) struct Tracked<D> {
    detector: D,
    tracker: TouchTracker,
    monitor: FaultMonitor,
    used: Vec<bool>,
    /// Whether the reference frame resembles the model, without which it explains frames by chance; `None` if touches are not
    /// found by the model.
    is_alike: Option<bool>,
    /// Measurements that have recovered and wait for a frame without touches, to set their reference.
    waiting: Vec<bool>,
    /// The sheet under a touch.
    #[cfg(feature = "learn")]
    local: LocalSheet,
    /// Reference of the current frame.
    reference: Vec<f64>,
    step: Option<DetectorStep>,
}

impl<D: Detector> Tracked<D> {
    pub(super) fn new(
        detector: D,
        tracker: TouchTracker,
        monitor: FaultMonitor,
        used: &[bool],
        is_alike: Option<bool>,
    ) -> Self {
        Self {
            reference: detector.reference_v().to_vec(),
            detector,
            tracker,
            monitor,
            used: used.to_vec(),
            is_alike,
            waiting: vec![false; used.len()],
            #[cfg(feature = "learn")]
            local: LocalSheet::default(),
            step: None,
        }
    }

    /// Strengths of single presses are those on an even sheet.
    #[cfg(feature = "learn")]
    pub(super) fn on_sheet(self, local: LocalSheet) -> Self {
        Self { local, ..self }
    }

    /// Takes the values of recovered measurements as their reference, once nothing touches the skin.
    fn readmit(&mut self, values: &[f64]) {
        // after an outage of the instrument old references hold
        let is_outage = 2 * self.monitor.healed().len() > self.used.len();
        self.monitor.healed().iter().for_each(|&i| self.waiting[i] = !is_outage);
        // a frame that nothing was seen in, or that nothing explains, is not one without a finger
        let is_seen = self.step.is_none_or(|step| step.rows > 0 && step.is_explained);
        if !(is_seen && self.detector.found().is_empty()) {
            return;
        }
        // the reference of a recovered measurement is unknown; under a finger it would take on the error of the fit
        for i in (0..self.used.len()).filter(|&i| !self.monitor.is_missing(i)) {
            if std::mem::take(&mut self.waiting[i]) {
                self.detector.set_reference(i, values[i]);
            }
        }
    }
}

impl<D: Detector> Source for Tracked<D> {
    fn push(
        &mut self,
        values: &[f64],
        is_good: &dyn Fn(usize) -> bool,
        [time_s, dt_s]: [f64; 2],
    ) -> Result<(), SkinError> {
        let faults = self.monitor.faults().len();
        self.monitor.push(values, self.detector.reference_v(), is_good, time_s)?;
        if self.monitor.faults().len() > faults {
            self.detector.take_back_reference();
        }
        self.readmit(values);
        let Self { detector, tracker, monitor, used, waiting, reference, .. } = self;
        reference.copy_from_slice(detector.reference_v());
        let is_faulty = |i: usize| {
            let of_electrode = monitor.of_electrode();
            let is_of = |fault: &ElectrodeFault| of_electrode[fault.electrode].contains(&i);
            !used[i] || monitor.faults().iter().any(is_of)
        };
        let is_missing = |i: usize| monitor.is_missing(i) || waiting[i];
        let is_whole =
            monitor.faults().is_empty() && (0..used.len()).all(|i| !used[i] || !is_missing(i));
        let step = detector.push(values, is_faulty, is_missing, dt_s)?;
        let faults = monitor.faults().len();
        monitor.blame(step.blamed, time_s)?;
        // a model that does not explain the reference explains no frame
        monitor.doubt(step.is_explained || self.is_alike != Some(true), time_s)?;
        if monitor.faults().len() > faults {
            // the next frame is the first one without it
            detector.take_back_reference();
        }
        match step.rows {
            0 => tracker.push_unseen(time_s)?,
            _ => tracker.push(detector.found(), time_s, is_whole)?,
        };
        tracker.place(|point_m| detector.nearest_on_skin(point_m));
        self.step = Some(step);
        // what touches do not explain may be anything
        if self.is_alike == Some(false) || !self.is_explained() {
            self.tracker.invalidate(|_| true);
        }
        Ok(())
    }

    fn touches(&self) -> &[Touch] {
        self.tracker.touches()
    }

    fn invalidate(&mut self, is_doubted: &dyn Fn(&Touch) -> bool) {
        self.tracker.invalidate(is_doubted);
    }

    #[cfg(feature = "learn")]
    fn strongest(
        &self,
        values: &[f64],
        reference_v: &[f64],
        period_s: f64,
    ) -> Result<Option<PressTouch>, SkinError> {
        let mut detector = self.detector.clone();
        reference_v.iter().enumerate().for_each(|(i, v)| detector.set_reference(i, *v));
        let step = detector.push(values, |i| !self.used[i], |_| false, period_s)?;
        if !step.is_explained || self.is_alike == Some(false) {
            return Ok(None);
        }
        let strength = |touch: &&DetectedTouch| touch.strength_s_m2.abs();
        let touches = detector.found().iter();
        let strongest = touches.max_by(|a, b| strength(a).total_cmp(&strength(b)));
        Ok(strongest.map(|touch| PressTouch {
            position_m: touch.position_m,
            even_strength_s_m2: strength(&touch) / self.local.ratio_at(touch.position_m),
        }))
    }

    fn faults(&self) -> &[ElectrodeFault] {
        self.monitor.faults()
    }

    fn is_missing(&self, measurement: usize) -> bool {
        let is_waiting = self.waiting.get(measurement).copied().unwrap_or(false);
        self.monitor.is_missing(measurement) || is_waiting
    }

    fn is_frozen(&self) -> bool {
        self.monitor.is_frozen()
    }

    fn is_explained(&self) -> bool {
        let explains = |s: DetectorStep| s.rows > 0 && s.is_explained && s.blamed.is_none();
        self.step.is_none_or(explains)
    }

    fn step(&self) -> Option<DetectorStep> {
        self.step
    }

    fn reference(&self) -> &[f64] {
        &self.reference
    }

    #[cfg(feature = "learn")]
    fn set_reference(&mut self, reference_v: &[f64]) -> Result<(), SkinError> {
        reference_v.iter().enumerate().for_each(|(i, v)| self.detector.set_reference(i, *v));
        Ok(())
    }

    fn next_id(&self) -> u64 {
        self.tracker.next_id()
    }

    fn set_next_id(&mut self, id: u64) {
        self.tracker.set_next_id(id);
    }

    fn boxed(&self) -> Box<dyn Source> {
        Box::new(self.clone())
    }
}
