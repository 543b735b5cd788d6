//! Touches by the map that presses have taught.

use super::background;
use super::choices::Choices;
use super::finder::{Source, detector_settings, following_s, tracker_settings};
use super::model::VoltageNoise;
use super::tracked::{Detector, Tracked};
use crate::error::SkinError;
use crate::faults::FaultMonitor;
use crate::fitted::FittedFrames;
use crate::learn::{LearnedSkin, LearnedTouches, Quiet};
use crate::progress::Progress;
use eit_inverse::touch::{
    DetectedTouch, DetectorStep, LearntSettings, TouchTracker, TrackerSettings,
};

/// Makes the source of touches by a map of presses, and tells its choices.
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
    let found = progress.stage("detector of touches", || learned.touches(skin, quiet, settings))?;
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
        model: keys.model,
        sheet: None,
        left_even: background::left_even(fitted),
        rows,
        places,
        blind: 0,
        twins: 0.0,
        radius_m: learned.bell_m,
        least_s_m2: detector_settings(keys, conductivity_s).least_s_m2,
    };
    let tracker = TouchTracker::new(tracker)?;
    Ok((Box::new(Tracked::new(found, tracker, monitor, &frames.used, None)), choices))
}

impl Detector for LearnedTouches {
    fn push(
        &mut self,
        values: &[f64],
        is_faulty: impl Fn(usize) -> bool,
        is_missing: impl Fn(usize) -> bool,
        _: f64,
    ) -> Result<DetectorStep, SkinError> {
        self.push(values, is_faulty, is_missing)
    }

    fn found(&self) -> &[DetectedTouch] {
        self.found()
    }

    fn reference_v(&self) -> &[f64] {
        self.reference_v()
    }

    fn set_reference(&mut self, measurement: usize, value: f64) {
        self.set_reference(measurement, value);
    }

    fn take_back_reference(&mut self) {
        self.forget_waiting();
    }
}
