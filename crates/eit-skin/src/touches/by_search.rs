//! Touches by the search of bells and its rules ([`TouchDetector`]).

use super::background::{self, Sheet};
use super::choices::Choices;
use super::finder::{Source, detector_settings, tracker_settings};
use super::model::{SoughtSkin, Spread, VoltageNoise, dents};
use super::tracked::{Detector, Tracked};
use crate::error::SkinError;
use crate::faults::FaultMonitor;
use crate::fitted::FittedFrames;
use crate::learn::{LearnedSkin, ModelForces};
use crate::progress::Progress;
use eit_inverse::touch::{
    DetectedTouch, DetectorSettings, DetectorStep, TouchDetector, TouchTracker,
};

/// Finds touches by the model, frame by frame.
#[derive(Debug, Clone)]
pub(super) struct SearchTouches {
    detector: TouchDetector,
    /// Forces learnt for touches that the model finds, and touches with them.
    forces: Option<ModelForces>,
    touches: Vec<DetectedTouch>,
}

/// Makes the source of touches by the search, and tells its choices.
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
    // the detector takes voltages of g times the model's for a sheet of 1 / g of its conductivity
    let conductivity_s = skin.skin.conductivity_s / fitted.level();
    let settings = detector_settings(keys, conductivity_s);
    let detector = detector(fitted, noise, sheet, &monitor, settings, progress)?;
    let local = sheet.local(fitted);
    let (places, seen) = detector.places();
    let choices = Choices {
        noise: noise.source.clone(),
        presses: None,
        model: keys.model,
        sheet: sheet.choice(),
        left_even: background::left_even(fitted),
        rows: detector.rows(),
        places: seen,
        blind: places - seen,
        twins: 0.0,
        radius_m: detector.settings().radius_m,
        least_s_m2: detector.settings().least_s_m2,
    };
    let made = SearchTouches {
        forces: learned.map(|learned| learned.model_forces(local.clone())),
        touches: Vec::with_capacity(detector.settings().max_touches),
        detector,
    };
    let tracker = TouchTracker::new(tracker_settings(keys, conductivity_s))?;
    let is_alike = Some(fitted.fit.is_alike());
    let made = Tracked::new(made, tracker, monitor, &frames.used, is_alike);
    #[cfg(feature = "learn")]
    let made = made.on_sheet(local);
    Ok((Box::new(made), choices))
}

/// Makes the detector, which knows how fabric gives way if its electrodes do.
fn detector(
    fitted: &FittedFrames,
    noise: &VoltageNoise,
    sheet: &Sheet,
    monitor: &FaultMonitor,
    settings: DetectorSettings,
    progress: &mut Progress,
) -> Result<TouchDetector, SkinError> {
    let spread = Spread::in_use(&fitted.skin);
    let sought = SoughtSkin::new(fitted, sheet, monitor, &spread)?;
    let std_v: Vec<f64> = noise.std_v.iter().map(|e| e * noise.with_reference).collect();
    let model = sought.model(&std_v);
    let detector =
        progress.stage("detector of touches", || TouchDetector::new(&model, settings))?;
    if !sought.is_moving() {
        return Ok(detector);
    }
    let (places, background_s) = (detector.dent_places(), sought.background_s);
    let of_dents = || dents(&fitted.skin, background_s, &places, spread.movement_m);
    Ok(detector.with_dents(&progress.stage("dents of touches", of_dents)?)?)
}

impl Detector for SearchTouches {
    fn push(
        &mut self,
        values: &[f64],
        is_faulty: impl Fn(usize) -> bool,
        is_missing: impl Fn(usize) -> bool,
        dt_s: f64,
    ) -> Result<DetectorStep, SkinError> {
        let step = self.detector.push(values, |i| is_faulty(i) || is_missing(i), dt_s)?;
        self.touches.clear();
        self.touches.extend_from_slice(self.detector.touches());
        if let Some(forces) = &self.forces {
            for touch in &mut self.touches {
                let [strength, std] = [touch.strength_s_m2, touch.strength_std_s_m2];
                touch.learnt = Some(forces.of([strength, std], touch.position_m));
            }
        }
        Ok(step)
    }

    fn found(&self) -> &[DetectedTouch] {
        &self.touches
    }

    fn reference_v(&self) -> &[f64] {
        self.detector.reference_v()
    }

    fn set_reference(&mut self, measurement: usize, value: f64) {
        self.detector.set_reference(measurement, value);
    }

    fn take_back_reference(&mut self) {
        self.detector.take_back_reference();
    }

    fn nearest_on_skin(&self, point_m: [f64; 3]) -> [f64; 3] {
        self.detector.nearest_on_skin(point_m)
    }
}
