//! Touches by one model and one score ([`ScoreDetector`]) of a skin and its frames.

use super::background::{self, Sheet};
use super::choices::Choices;
#[cfg(feature = "learn")]
use super::finder::PressTouch;
use super::finder::Source;
use super::model::{SoughtSkin, Spread, VoltageNoise, common_mode, dents, drag_at_finger};
use crate::error::SkinError;
use crate::faults::{ElectrodeFault, FaultKind, FaultMonitor};
use crate::fitted::FittedFrames;
#[cfg(feature = "learn")]
use crate::learn::LocalSheet;
use crate::learn::{LearnedSkin, ModelForces};
use crate::progress::Progress;
use crate::scene::TouchSettings;
use eit_inverse::touch::{
    DetectorStep, ElectrodeState, ScoreDetector, ScoreModel, ScoreSettings, Touch,
};

/// Finds touches by one score, frame by frame.
#[derive(Debug, Clone)]
pub(super) struct ScoreTouches {
    detector: ScoreDetector,
    /// Recognises frames that repeat, and damaged ones.
    monitor: FaultMonitor,
    /// Faults of the reference, then those found since.
    faults: Vec<ElectrodeFault>,
    lasting: usize,
    since_s: Vec<f64>,
    states: Vec<ElectrodeState>,
    /// Forces learnt for touches that the model finds, and touches with them.
    forces: Option<ModelForces>,
    touches: Vec<Touch>,
    #[cfg(feature = "learn")]
    local: LocalSheet,
    /// Reference of the current frame.
    reference: Vec<f64>,
    step: Option<DetectorStep>,
}

/// Makes the source of touches by one score, and tells its choices.
pub(super) fn source(
    fitted: &FittedFrames,
    learned: Option<&LearnedSkin>,
    noise: &VoltageNoise,
    sheet: &Sheet,
    monitor: FaultMonitor,
    progress: &mut Progress,
) -> Result<(Box<dyn Source>, Choices), SkinError> {
    let FittedFrames { skin, frames, .. } = fitted;
    let settings = settings(&skin.skin.settings.touch);
    let detector = detector(fitted, noise, sheet, &monitor, settings.clone(), progress)?;
    let least_s_m2 = settings.least_m2 * skin.skin.conductivity_s / fitted.level();
    let [rows, places] = detector.size();
    let choices = Choices {
        noise: noise.source.clone(),
        presses: None,
        model: skin.skin.settings.touch.model,
        sheet: sheet.choice(),
        left_even: background::left_even(fitted),
        rows,
        places,
        blind: 0,
        twins: 0.0,
        radius_m: settings.bell_m,
        least_s_m2,
    };
    let faults = monitor.faults().to_vec();
    let local = sheet.local(fitted);
    let made = ScoreTouches {
        forces: learned.map(|learned| learned.model_forces(local.clone())),
        // those that end are told once more
        touches: Vec::with_capacity(2 * settings.max_touches),
        #[cfg(feature = "learn")]
        local,
        reference: frames.reference.clone(),
        since_s: vec![0.0; detector.electrodes().len()],
        states: detector.electrodes().to_vec(),
        monitor,
        lasting: faults.len(),
        faults,
        detector,
        step: None,
    };
    Ok((Box::new(made), choices))
}

/// Settings of the scene; the score is made for no more touches than by default.
fn settings(keys: &TouchSettings) -> ScoreSettings {
    let default = ScoreSettings::default();
    ScoreSettings {
        sign: keys.sign,
        max_touches: keys.max_touches.unwrap_or(default.max_touches).min(default.max_touches),
        bell_m: keys.radius_m.unwrap_or(default.bell_m),
        ..default
    }
}

/// Makes the detector, with the effects of dents and of what amplifiers add.
fn detector(
    fitted: &FittedFrames,
    noise: &VoltageNoise,
    sheet: &Sheet,
    monitor: &FaultMonitor,
    settings: ScoreSettings,
    progress: &mut Progress,
) -> Result<ScoreDetector, SkinError> {
    let FittedFrames { skin, frames, .. } = fitted;
    let one = Spread { movement_m: 1.0, contact: 1.0, sheet: 1.0 };
    let sought = SoughtSkin::new(fitted, sheet, monitor, &one)?;
    let (background_s, model) = (sought.background_s, sought.model(&noise.std_v));
    // without electrodes that move there is no fabric that does
    let places = match sought.is_moving() {
        true => ScoreDetector::dent_places(&model, &settings),
        false => Vec::new(),
    };
    let of_dents = || dents(skin, background_s, &places, 1.0);
    let mut dents_v = progress.stage("dents of touches", of_dents)?;
    let drag = drag_at_finger(skin);
    let drags = dents_v.columns_mut().into_iter().enumerate().filter(|(k, _)| k % 3 > 0);
    drags.for_each(|(_, mut column)| column /= drag);
    let drives = skin.skin.protocol.data().iter().map(|[drive, _]| *drive as usize);
    let model = ScoreModel {
        skin: model,
        conductivity_s: skin.skin.conductivity_s,
        reference_frames: frames.reference_frames,
        step_v: noise.step_v,
        drive: &drives.collect::<Vec<_>>(),
        common_v: &common_mode(&skin.skin, background_s)?,
        leak_v: &sheet.leak_v,
    };
    let detector =
        progress.stage("detector of touches", || ScoreDetector::new(&model, &dents_v, settings))?;
    Ok(detector)
}

impl ScoreTouches {
    /// Names the electrodes that the detector has found faulty.
    fn list_faults(&mut self, time_s: f64) {
        self.faults.truncate(self.lasting);
        for (e, state) in self.detector.electrodes().iter().enumerate() {
            if self.states[e] != *state {
                (self.states[e], self.since_s[e]) = (*state, time_s);
            }
            let kind = match state {
                ElectrodeState::Sound => continue,
                ElectrodeState::Noisy => FaultKind::Contradicts,
                ElectrodeState::Stuck => FaultKind::Stuck,
                ElectrodeState::Drifting => FaultKind::Drifts,
            };
            self.faults.push(ElectrodeFault { electrode: e, kind, since_s: self.since_s[e] });
        }
    }
}

impl Source for ScoreTouches {
    fn push(
        &mut self,
        values: &[f64],
        is_good: &dyn Fn(usize) -> bool,
        [time_s, dt_s]: [f64; 2],
    ) -> Result<(), SkinError> {
        self.monitor.push(values, self.detector.reference_v(), is_good, time_s)?;
        let is_bad = self.monitor.is_bad();
        self.reference.copy_from_slice(self.detector.reference_v());
        self.touches.clear();
        self.touches.extend_from_slice(self.detector.push(
            values,
            |i| is_bad || !is_good(i),
            dt_s,
        )?);
        if let Some(forces) = &self.forces {
            for touch in &mut self.touches {
                let std_s_m2 = touch.intensity_std_s_m2.unwrap_or(f64::INFINITY);
                let strength = [touch.intensity_s_m2, std_s_m2];
                touch.learnt = Some(forces.of(strength, touch.position_m));
            }
        }
        self.step = Some(self.detector.step());
        self.list_faults(time_s);
        Ok(())
    }

    fn touches(&self) -> &[Touch] {
        &self.touches
    }

    fn invalidate(&mut self, is_doubted: &dyn Fn(&Touch) -> bool) {
        let doubted = self.touches.iter_mut().filter(|touch| is_doubted(touch));
        doubted.for_each(|touch| touch.valid = false);
    }

    #[cfg(feature = "learn")]
    fn strongest(
        &self,
        values: &[f64],
        reference_v: &[f64],
        period_s: f64,
    ) -> Result<Option<PressTouch>, SkinError> {
        let mut detector = self.detector.clone();
        detector.set_reference(reference_v)?;
        let touches = detector.push(values, |_| false, period_s)?;
        let strength = |touch: &&Touch| touch.intensity_s_m2.abs();
        let valid = touches.iter().filter(|touch| touch.valid);
        let strongest = valid.max_by(|a, b| strength(a).total_cmp(&strength(b)));
        Ok(strongest.map(|touch| PressTouch {
            position_m: touch.position_m,
            even_strength_s_m2: strength(&touch) / self.local.ratio_at(touch.position_m),
        }))
    }

    fn faults(&self) -> &[ElectrodeFault] {
        &self.faults
    }

    fn is_missing(&self, measurement: usize) -> bool {
        self.detector.is_missing(measurement)
    }

    fn is_frozen(&self) -> bool {
        self.monitor.is_frozen()
    }

    fn is_explained(&self) -> bool {
        self.step.is_none() || self.detector.is_explained()
    }

    fn step(&self) -> Option<DetectorStep> {
        self.step
    }

    fn reference(&self) -> &[f64] {
        &self.reference
    }

    #[cfg(feature = "learn")]
    fn set_reference(&mut self, reference_v: &[f64]) -> Result<(), SkinError> {
        Ok(self.detector.set_reference(reference_v)?)
    }

    fn next_id(&self) -> u64 {
        self.detector.next_id()
    }

    fn set_next_id(&mut self, id: u64) {
        self.detector.set_next_id(id);
    }

    fn boxed(&self) -> Box<dyn Source> {
        Box::new(self.clone())
    }
}
