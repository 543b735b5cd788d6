//! Touches by the map that presses have taught, with ids from frame to frame.

use super::background;
use super::choices::Choices;
use super::finder::{PressTouch, Source, detector_settings, following_s, tracker_settings};
use super::model::VoltageNoise;
use crate::error::SkinError;
use crate::faults::{ElectrodeFault, FaultMonitor};
use crate::fitted::FittedFrames;
use crate::learn::{LearnedSkin, LearnedTouches, Quiet};
use crate::progress::Progress;
use eit_inverse::touch::{DetectorStep, LearntSettings, Touch, TouchTracker, TrackerSettings};

/// Finds touches on a skin that was learnt.
#[derive(Debug, Clone)]
pub(super) struct PressTouches {
    found: LearnedTouches,
    tracker: TouchTracker,
    monitor: FaultMonitor,
    used: Vec<bool>,
    /// Measurements that have recovered and wait for a frame without touches, to set their reference.
    waiting: Vec<bool>,
    step: Option<DetectorStep>,
}

impl PressTouches {
    pub(super) fn source(
        fitted: &FittedFrames,
        rate_hz: f64,
        learned: &LearnedSkin,
        noise: &VoltageNoise,
        monitor: FaultMonitor,
        progress: &mut Progress,
    ) -> Result<(Box<dyn Source>, Choices), SkinError> {
        let FittedFrames { skin, frames, .. } = fitted;
        let keys = &skin.skin.settings.touch;
        let std_v: Vec<f64> = noise.std_v.iter().map(|e| e * noise.with_reference).collect();
        let default = LearntSettings::default();
        let settings = LearntSettings {
            max_touches: keys.max_touches.unwrap_or(default.max_touches),
            following: following_s(keys).map(|s| (1.0 / (s * rate_hz)).min(1.0)),
            ..default
        };
        let quiet = Quiet { reference: &frames.reference, std_v: &std_v, rate_hz };
        let found =
            progress.stage("detector of touches", || learned.touches(skin, quiet, settings))?;
        let [rows, places, _] = found.sizes();
        let [low, high] = skin.skin.mesh.surface().bounds_m();
        let conductivity_s = skin.skin.conductivity_s / fitted.level();
        let tracker = TrackerSettings {
            // a place that is not known well is stated, not hidden
            max_position_std_m: (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max),
            errs_alike: true,
            ..tracker_settings(keys, conductivity_s)
        };
        let choices = Choices {
            noise: noise.source.clone(),
            presses: Some(found.presses),
            sheet: None,
            left_even: background::left_even(fitted),
            rows,
            places,
            blind: 0,
            radius_m: learned.bell_m,
            least_s_m2: detector_settings(keys, conductivity_s).least_s_m2,
        };
        let made = Self {
            tracker: TouchTracker::new(tracker)?,
            found,
            monitor,
            used: frames.used.clone(),
            waiting: vec![false; frames.used.len()],
            step: None,
        };
        Ok((Box::new(made), choices))
    }

    /// Takes the values of recovered measurements as their reference, once nothing touches the skin.
    fn readmit(&mut self, values: &[f64]) {
        // after an outage of the instrument old references hold
        let is_outage = 2 * self.monitor.healed().len() > self.used.len();
        self.monitor.healed().iter().for_each(|&i| self.waiting[i] = !is_outage);
        // a frame that nothing was seen in, or that nothing explains, is not one without a finger
        if !(self.is_explained() && self.found.found().is_empty()) {
            return;
        }
        // the reference of a recovered measurement is unknown; under a finger it would take on the error of the fit
        for i in (0..self.used.len()).filter(|&i| !self.monitor.is_missing(i)) {
            if std::mem::take(&mut self.waiting[i]) {
                self.found.set_reference(i, values[i]);
            }
        }
    }
}

impl Source for PressTouches {
    fn push(
        &mut self,
        values: &[f64],
        is_good: &dyn Fn(usize) -> bool,
        [time_s, _]: [f64; 2],
    ) -> Result<(), SkinError> {
        let faults = self.monitor.faults().len();
        self.monitor.push(values, self.found.reference_v(), is_good, time_s)?;
        if self.monitor.faults().len() > faults {
            self.found.forget_waiting();
        }
        self.readmit(values);
        let Self { found, tracker, monitor, used, waiting, .. } = self;
        let is_faulty = |i: usize| {
            let of_electrode = monitor.of_electrode();
            let is_of = |fault: &ElectrodeFault| of_electrode[fault.electrode].contains(&i);
            !used[i] || monitor.faults().iter().any(is_of)
        };
        let is_missing = |i: usize| monitor.is_missing(i) || waiting[i];
        let is_whole =
            monitor.faults().is_empty() && (0..used.len()).all(|i| !used[i] || !is_missing(i));
        let step = found.push(values, is_faulty, is_missing)?;
        match step.rows {
            0 => tracker.push_unseen(time_s)?,
            _ => tracker.push(found.found(), time_s, is_whole)?,
        };
        self.step = Some(step);
        // what touches do not explain may be anything
        if !self.is_explained() {
            self.tracker.invalidate();
        }
        Ok(())
    }

    fn touches(&self) -> &[Touch] {
        self.tracker.touches()
    }

    fn strongest(&self, _: &[f64], _: &[f64], _: f64) -> Result<Option<PressTouch>, SkinError> {
        // only the model is asked for single presses: they are what this was learnt from
        Ok(None)
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
        self.step.is_none_or(|step| step.rows > 0 && step.is_explained)
    }

    fn step(&self) -> Option<DetectorStep> {
        self.step
    }

    fn reference_v(&self) -> &[f64] {
        self.found.reference_v()
    }

    fn set_reference(&mut self, reference_v: &[f64]) {
        reference_v.iter().enumerate().for_each(|(i, v)| self.found.set_reference(i, *v));
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
