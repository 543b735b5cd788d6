//! Touches by one model and one score ([`ScoreDetector`]) of a skin and its frames.

use super::model::{
    Spread, VoltageNoise, common_mode, dents, drag_at_finger, electrode_kinds, unknowns,
};
use crate::error::SkinError;
use crate::faults::{ElectrodeFault, FaultKind, FaultMonitor};
use crate::fitted::FittedFrames;
use crate::progress::Progress;
use eit_inverse::touch::{
    DetectorModel, DetectorStep, ElectrodeState, ScoreDetector, ScoreModel, ScoreSettings, Touch,
};
use ndarray::{Array1, Array2};

/// The sheet that explains the reference, and the model linearised there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Linearised<'a> {
    pub conductivity_s: &'a [f64],
    pub voltages: &'a Array1<f64>,
    pub jacobian: &'a Array2<f64>,
    /// What an amplifier adds to the voltages of the untouched skin, volts.
    pub leak_v: &'a [f64],
}

/// Finds touches by one score, frame by frame.
#[derive(Debug, Clone)]
pub(super) struct ScoreFinder {
    detector: ScoreDetector,
    /// Recognises frames that repeat, and damaged ones.
    monitor: FaultMonitor,
    /// Faults of the reference, then those found since.
    faults: Vec<ElectrodeFault>,
    lasting: usize,
    since_s: Vec<f64>,
    states: Vec<ElectrodeState>,
    step: Option<DetectorStep>,
}

impl ScoreFinder {
    pub(super) fn new(
        fitted: &FittedFrames,
        noise: &VoltageNoise,
        sheet: Linearised<'_>,
        monitor: &FaultMonitor,
        progress: &mut Progress,
    ) -> Result<Self, SkinError> {
        let FittedFrames { skin, frames, .. } = fitted;
        let one = Spread { movement_m: 1.0, contact: 1.0, sheet: 1.0 };
        let unknowns = unknowns(&skin.skin, sheet.conductivity_s, &one, &mut Progress::silent())?;
        let kinds = electrode_kinds(skin, unknowns.ncols())?;
        let quiet_v = match &frames.quiet {
            Some(quiet) => quiet.values.clone(),
            None => Array2::zeros((0, frames.used.len())),
        };
        let model = DetectorModel {
            surface: skin.skin.mesh.surface(),
            jacobian: sheet.jacobian,
            model_v: &sheet.voltages.to_vec(),
            unknowns: &unknowns,
            kinds: &kinds,
            reference_v: &frames.reference,
            noise_std_v: &noise.std_v,
            quiet_v: quiet_v.view(),
            used: &frames.used,
            reciprocal: monitor.reciprocal(),
            of_electrode: monitor.of_electrode(),
        };
        let keys = &skin.skin.settings.touch;
        let default = ScoreSettings::default();
        let settings = ScoreSettings {
            sign: keys.sign,
            max_touches: keys.max_touches.unwrap_or(default.max_touches).min(default.max_touches),
            bell_m: keys.radius_m.unwrap_or(default.bell_m),
            ..default
        };
        let places = match kinds.len() {
            0 | 1 => Vec::new(),
            _ => ScoreDetector::dent_places(&model, &settings),
        };
        let mut dents_v = progress
            .stage("dents of touches", || dents(skin, sheet.conductivity_s, &places, 1.0))?;
        let drag = drag_at_finger(skin);
        for (k, mut column) in dents_v.columns_mut().into_iter().enumerate() {
            if k % 3 > 0 {
                column /= drag;
            }
        }
        let drive: Vec<usize> =
            skin.skin.protocol.data().iter().map(|[drive, _]| *drive as usize).collect();
        let model = ScoreModel {
            skin: model,
            conductivity_s: skin.skin.conductivity_s,
            reference_frames: frames.reference_frames,
            step_v: noise.step_v,
            drive: &drive,
            common_v: &common_mode(&skin.skin, sheet.conductivity_s)?,
            leak_v: sheet.leak_v,
        };
        let detector = progress
            .stage("detector of touches", || ScoreDetector::new(&model, &dents_v, settings))?;
        let faults = monitor.faults().to_vec();
        Ok(Self {
            since_s: vec![0.0; detector.electrodes().len()],
            states: detector.electrodes().to_vec(),
            monitor: monitor.clone(),
            lasting: faults.len(),
            faults,
            detector,
            step: None,
        })
    }

    /// Takes a frame that [`TouchFinder::push`](super::TouchFinder::push) has checked.
    pub(super) fn push(
        &mut self,
        values: &[f64],
        is_good: impl Fn(usize) -> bool,
        [time_s, dt_s]: [f64; 2],
    ) -> Result<&[Touch], SkinError> {
        self.monitor.push(values, self.detector.reference_v(), &is_good, time_s)?;
        let is_bad = self.monitor.is_bad();
        self.detector.push(values, |i| is_bad || !is_good(i), dt_s)?;
        self.step = Some(self.detector.step());
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
        Ok(self.detector.touches())
    }

    pub(super) fn faults(&self) -> &[ElectrodeFault] {
        &self.faults
    }

    pub(super) fn is_missing(&self, measurement: usize) -> bool {
        self.detector.is_missing(measurement)
    }

    pub(super) fn is_frozen(&self) -> bool {
        self.monitor.is_frozen()
    }

    pub(super) fn is_explained(&self) -> bool {
        self.step.is_none() || self.detector.is_explained()
    }

    pub(super) fn step(&self) -> Option<DetectorStep> {
        self.step
    }

    pub(super) fn reference_v(&self) -> &[f64] {
        self.detector.reference_v()
    }

    pub(super) fn next_id(&self) -> u64 {
        self.detector.next_id()
    }

    pub(super) fn with_first_id(self, first: u64) -> Self {
        Self { detector: self.detector.with_first_id(first), ..self }
    }
}
