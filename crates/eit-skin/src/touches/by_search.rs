//! Touches by the search of bells and its rules ([`TouchDetector`]), with ids from frame to frame.

use super::background::{self, Sheet};
use super::choices::Choices;
#[cfg(feature = "learn")]
use super::finder::PressTouch;
use super::finder::{Source, detector_settings, tracker_settings};
use super::model::{Spread, VoltageNoise, dents, electrode_kinds, unknowns};
use crate::error::SkinError;
use crate::faults::{ElectrodeFault, FaultMonitor};
use crate::fitted::FittedFrames;
use crate::learn::{LearnedSkin, LocalSheet, ModelForces};
use crate::progress::Progress;
#[cfg(feature = "learn")]
use eit_inverse::touch::DetectedTouch;
use eit_inverse::touch::{DetectorModel, DetectorStep, Touch, TouchDetector, TouchTracker};
use ndarray::Array2;

/// Finds touches by the model, frame by frame.
#[derive(Debug, Clone)]
pub(super) struct SearchTouches {
    detector: TouchDetector,
    /// Forces learnt for touches that the model finds.
    forces: Option<ModelForces>,
    tracker: TouchTracker,
    monitor: FaultMonitor,
    used: Vec<bool>,
    /// Whether the reference frame resembles the model; else touches explain frames by chance.
    is_alike: bool,
    /// Measurements that have recovered and wait for a frame without touches, to set their reference.
    waiting: Vec<bool>,
    #[cfg(feature = "learn")]
    local: LocalSheet,
    step: Option<DetectorStep>,
}

impl SearchTouches {
    pub(super) fn source(
        fitted: &FittedFrames,
        learned: Option<&LearnedSkin>,
        noise: &VoltageNoise,
        sheet: &Sheet,
        monitor: FaultMonitor,
        progress: &mut Progress,
    ) -> Result<(Box<dyn Source>, Choices), SkinError> {
        let FittedFrames { skin, frames, .. } = fitted;
        let keys = &skin.skin.settings.touch;
        let (background_s, jacobian, voltages) = sheet.linearised(fitted);
        let unknowns =
            unknowns(&skin.skin, background_s, &Spread::in_use(skin), &mut Progress::silent())?;
        let std_v: Vec<f64> = noise.std_v.iter().map(|e| e * noise.with_reference).collect();
        let no_frames = Array2::zeros((0, frames.used.len()));
        let model = DetectorModel {
            surface: skin.skin.mesh.surface(),
            jacobian,
            model_v: &voltages.to_vec(),
            unknowns: &unknowns,
            kinds: &electrode_kinds(skin, unknowns.ncols())?,
            reference_v: &frames.reference,
            noise_std_v: &std_v,
            quiet_v: frames.quiet.as_ref().map_or(no_frames.view(), |quiet| quiet.values.view()),
            used: &frames.used,
            reciprocal: monitor.reciprocal(),
            of_electrode: monitor.of_electrode(),
        };
        // the detector takes voltages of g times the model's for a sheet of 1 / g of its conductivity
        let conductivity_s = skin.skin.conductivity_s / fitted.level();
        let settings = detector_settings(keys, conductivity_s);
        let detector =
            progress.stage("detector of touches", || TouchDetector::new(&model, settings))?;
        let detector = match unknowns.ncols() == 1 {
            true => detector,
            false => {
                let movement_m = Spread::in_use(skin).movement_m;
                let places = detector.dent_places();
                let dents_v = progress
                    .stage("dents of touches", || dents(skin, background_s, &places, movement_m))?;
                detector.with_dents(&dents_v)?
            }
        };
        let local = sheet.found.as_ref().map_or_else(LocalSheet::default, |found| {
            LocalSheet::new(skin.skin.mesh.surface(), &found.conductivity_s, &sheet.even_s)
        });
        let (places, seen) = detector.places();
        let choices = Choices {
            noise: noise.source.clone(),
            presses: None,
            sheet: sheet.choice(),
            left_even: background::left_even(fitted),
            rows: detector.rows(),
            places: seen,
            blind: places - seen,
            radius_m: detector.settings().radius_m,
            least_s_m2: detector.settings().least_s_m2,
        };
        let made = Self {
            forces: learned.map(|learned| learned.model_forces(local.clone())),
            tracker: TouchTracker::new(tracker_settings(keys, conductivity_s))?,
            detector,
            monitor,
            used: frames.used.clone(),
            is_alike: fitted.fit.is_alike(),
            waiting: vec![false; frames.used.len()],
            #[cfg(feature = "learn")]
            local,
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
        let is_seen = self.step.is_none_or(|step| step.rows > 0 && step.is_explained);
        if !(is_seen && self.detector.touches().is_empty()) {
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

impl Source for SearchTouches {
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
        let Self { detector, forces, tracker, monitor, used, waiting, is_alike, .. } = self;
        let is_faulty = |i: usize| {
            let of_electrode = monitor.of_electrode();
            let is_of = |fault: &ElectrodeFault| of_electrode[fault.electrode].contains(&i);
            !used[i] || monitor.faults().iter().any(is_of)
        };
        let is_missing = |i: usize| monitor.is_missing(i) || waiting[i];
        let is_whole =
            monitor.faults().is_empty() && (0..used.len()).all(|i| !used[i] || !is_missing(i));
        let step = detector.push(values, |i| is_faulty(i) || is_missing(i), dt_s)?;
        let faults = monitor.faults().len();
        monitor.blame(step.blamed, time_s)?;
        // a model that does not explain the reference explains no frame
        monitor.doubt(step.is_explained || !*is_alike, time_s)?;
        if monitor.faults().len() > faults {
            // the next frame is the first one without it
            detector.take_back_reference();
        }
        self.step = Some(step);
        let found = match forces {
            Some(forces) => forces.add_to(detector.touches()),
            None => detector.touches(),
        };
        match step.rows {
            0 => tracker.push_unseen(time_s)?,
            _ => tracker.push(found, time_s, is_whole)?,
        };
        tracker.place(|point_m| detector.nearest_on_skin(point_m));
        // what touches do not explain may be anything
        if !(self.is_alike && self.is_explained()) {
            self.tracker.invalidate();
        }
        Ok(())
    }

    fn touches(&self) -> &[Touch] {
        self.tracker.touches()
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
        let step = detector.push(values, |i| !self.used[i], period_s)?;
        if !(step.is_explained && self.is_alike) {
            return Ok(None);
        }
        let strength = |touch: &&DetectedTouch| touch.strength_s_m2.abs();
        let touches = detector.touches().iter();
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

    fn reference_v(&self) -> &[f64] {
        self.detector.reference_v()
    }

    #[cfg(feature = "learn")]
    fn set_reference(&mut self, reference_v: &[f64]) {
        reference_v.iter().enumerate().for_each(|(i, v)| self.detector.set_reference(i, *v));
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
