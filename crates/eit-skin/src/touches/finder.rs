//! Touches frame by frame, recorded or live.

use super::model::{VoltageNoise, unknowns};
use crate::error::SkinError;
use crate::faults::{ElectrodeFault, FaultMonitor};
use crate::fitted::FittedFrames;
use crate::movement::{self, TakenOut, Whitening};
use crate::one_step::DEFAULT_NOISE_FIGURE;
use crate::progress::Progress;
use crate::scene::{TouchSettings, TouchSign};
use eit_inverse::metrics::ChangeSign;
use eit_inverse::touch::{
    DetectorModel, DetectorSettings, DetectorStep, Touch, TouchDetector, TouchTracker,
    TrackerSettings,
};
use eit_inverse::{
    HyperparameterChoice, InverseError, NoiseTarget, OneStepGaussNewton, OneStepSettings,
    Reconstructor, Workspace,
};
use eit_mesh::Raster;
use ndarray::Array2;

/// Least strength of a touch as an area of doubled conductivity, square metres: a finger of 0.2 N on
/// the paper's fabric has 2.5e-6, ghosts of its hysteresis less than 1e-6.
const LEAST_M2: f64 = 2e-6;
/// The same for one that is believed at once.
const STRONG_M2: f64 = 6e-6;

/// Thirty years.
const STANDS_STILL_S: f64 = 1e9;

/// Finds touches frame by frame.
#[derive(Debug)]
pub struct TouchFinder {
    /// Pixels of the images.
    pub raster: Raster,
    /// Where the noise came from.
    pub noise_source: String,
    used: Vec<bool>,
    reconstructor: Reconstructor,
    workspace: Workspace,
    whitening: Option<Whitening>,
    detector: TouchDetector,
    tracker: TouchTracker,
    monitor: FaultMonitor,
    /// The frame at hand, and the reference of its image.
    values: Vec<f64>,
    reference: Vec<f64>,
    pixels: Vec<f64>,
    bad: Vec<usize>,
    period_s: f64,
    before_s: Option<f64>,
    level_s: f64,
    step: Option<DetectorStep>,
}

impl TouchFinder {
    /// For frames like these, at this rate; `None` where their noise is unknown.
    ///
    /// # Errors
    ///
    /// Settings that no finder can be made with.
    pub fn new(
        fitted: &FittedFrames,
        rate_hz: f64,
        progress: &mut Progress,
    ) -> Result<Option<Self>, SkinError> {
        let FittedFrames { skin, frames, .. } = fitted;
        let Some(noise) = VoltageNoise::of(fitted)? else { return Ok(None) };
        let raster = skin.raster(progress)?.clone();
        let Imaging { difference, whitening } = Imaging::new(fitted, progress)?;
        let keys = &skin.skin.settings.touch;
        let protocol = &skin.skin.protocol;
        let monitor = FaultMonitor::new(protocol, &frames.used, &noise.std_v, noise.step_v)?
            .with_lasting(&frames.faults)?;
        let unknowns = unknowns(skin, &mut Progress::silent())?;
        let std_v: Vec<f64> = noise.std_v.iter().map(|e| e * noise.with_reference).collect();
        let quiet = match &frames.quiet {
            Some(quiet) => quiet.values.clone(),
            None => Array2::zeros((0, frames.used.len())),
        };
        let model = DetectorModel {
            surface: skin.skin.mesh.surface(),
            jacobian: &skin.jacobian,
            model_v: &skin.voltages.to_vec(),
            unknowns: &unknowns,
            reference_v: &frames.reference,
            noise_std_v: &std_v,
            quiet_v: quiet.view(),
            used: &frames.used,
            reciprocal: monitor.reciprocal(),
            of_electrode: monitor.of_electrode(),
        };
        let conductivity_s = skin.skin.conductivity_s;
        let settings = detector_settings(keys, conductivity_s);
        let level_s = settings.least_s_m2 / (std::f64::consts::PI * settings.radius_m.powi(2));
        let detector =
            progress.stage("detector of touches", || TouchDetector::new(&model, settings))?;
        let reconstructor = difference.on_raster(raster.pixel_from_element())?;
        Ok(Some(Self {
            noise_source: noise.source,
            used: frames.used.clone(),
            workspace: reconstructor.workspace(),
            whitening,
            tracker: TouchTracker::new(tracker_settings(keys, conductivity_s))?,
            detector,
            monitor,
            values: vec![0.0; frames.used.len()],
            reference: frames.reference.clone(),
            pixels: vec![0.0; raster.masked_pixels().len()],
            bad: Vec::new(),
            period_s: rate_hz.recip(),
            before_s: None,
            level_s,
            step: None,
            reconstructor,
            raster,
        }))
    }

    /// Takes a frame: faulty electrodes, the reference and its one-step image.
    /// [`find`](Self::find) is next.
    ///
    /// # Errors
    ///
    /// A frame of another length, an image that cannot be made.
    pub fn image(
        &mut self,
        values: &[f64],
        is_good: impl Fn(usize) -> bool,
        time_s: f64,
    ) -> Result<(), SkinError> {
        self.reference.copy_from_slice(self.detector.reference_v());
        self.monitor.push(values, &self.reference, is_good, time_s)?;
        self.values.copy_from_slice(values);
        for &i in self.monitor.healed() {
            // where the reference of what comes back is, nobody knows
            self.detector.set_reference(i, values[i] - self.detector.touch_of(i));
        }
        self.reference.copy_from_slice(self.detector.reference_v());
        let Self { bad, used, monitor, .. } = self;
        bad.clear();
        bad.extend((0..used.len()).filter(|&i| used[i] && monitor.is_missing(i)));
        let (memory, reference, pixels) = (&mut self.workspace, &self.reference, &mut self.pixels);
        match &mut self.whitening {
            None => match self
                .reconstructor
                .reconstruct_masked_into(values, reference, bad, memory, pixels)
            {
                // too little is left for an image; touches go on
                Err(InverseError::MaskedDominates { .. } | InverseError::NothingUsed { .. }) => {
                    pixels.fill(0.0)
                }
                made => {
                    made?;
                }
            },
            Some(whitening) if bad.is_empty() => {
                let white = whitening.of(values, reference)?;
                self.reconstructor.reconstruct_difference_into(white, memory, pixels)?;
            }
            // measurements are mixed: a frame without some of them shows nothing
            Some(_) => pixels.fill(0.0),
        }
        Ok(())
    }

    /// The touches of the frame at hand.
    ///
    /// # Errors
    ///
    /// A time that does not follow the one before.
    pub fn find(&mut self, time_s: f64) -> Result<&[Touch], SkinError> {
        let dt_s = self.before_s.map_or(self.period_s, |before_s| time_s - before_s);
        let monitor = &self.monitor;
        let step = self.detector.push(&self.values, |i| monitor.is_missing(i), dt_s)?;
        self.before_s = Some(time_s);
        self.monitor.blame(step.blamed, time_s)?;
        self.step = Some(step);
        Ok(self.tracker.push(self.detector.touches(), time_s, self.bad.is_empty())?)
    }

    /// Electrodes that are left out of the frame at hand.
    pub fn faults(&self) -> &[ElectrodeFault] {
        self.monitor.faults()
    }

    /// Whether a measurement of the frame at hand is left out: it is bad, or its electrode is.
    pub fn is_missing(&self, measurement: usize) -> bool {
        self.monitor.is_missing(measurement)
    }

    /// How the last frame was explained.
    pub fn step(&self) -> Option<DetectorStep> {
        self.step
    }

    /// Change of conductivity of the faintest touch, siemens.
    pub fn level_s(&self) -> f64 {
        self.level_s
    }

    /// What is subtracted from the frame at hand, `[measurement]`.
    pub fn reference(&self) -> &[f64] {
        &self.reference
    }

    /// Measurements that count.
    pub fn used(&self) -> &[bool] {
        &self.used
    }

    /// The one-step image of the last frame, a value for each pixel of the skin.
    pub fn pixels(&self) -> &[f64] {
        &self.pixels
    }
}

impl TouchSettings {
    /// Rejects settings that no touch can be found with, before any work.
    ///
    /// # Errors
    ///
    /// The value and its key.
    pub fn validate(&self) -> Result<(), SkinError> {
        let refuse = |e| SkinError::input(format!("touch: {e}"));
        detector_settings(self, 1.0).validate().map_err(refuse)?;
        tracker_settings(self, 1.0).validate().map_err(refuse)
    }
}

fn detector_settings(keys: &TouchSettings, conductivity_s: f64) -> DetectorSettings {
    let least_s_m2 = keys.least_strength_m2.unwrap_or(LEAST_M2) * conductivity_s;
    let default = DetectorSettings::with_least(least_s_m2);
    DetectorSettings {
        sign: match keys.sign {
            TouchSign::Increase => ChangeSign::Increase,
            TouchSign::Decrease => ChangeSign::Decrease,
        },
        max_touches: keys.max_touches.unwrap_or(default.max_touches),
        radius_m: keys.radius_m.unwrap_or(default.radius_m),
        apart_m: keys.apart_m.unwrap_or(default.apart_m),
        idle_s: following_s(keys).unwrap_or(default.idle_s),
        touched_s: following_s(keys).map_or(default.touched_s, |s| s.max(default.touched_s)),
        ..default
    }
}

/// Time in which the reference follows; 0 in a scene: so slowly that it stands still.
fn following_s(keys: &TouchSettings) -> Option<f64> {
    keys.drift_time_s.map(|s| if s == 0.0 { STANDS_STILL_S } else { s })
}

fn tracker_settings(keys: &TouchSettings, conductivity_s: f64) -> TrackerSettings {
    let strong_m2 = STRONG_M2.max(2.0 * keys.least_strength_m2.unwrap_or(0.0));
    let default = TrackerSettings::with_strong(strong_m2 * conductivity_s);
    TrackerSettings {
        max_touches: keys.max_touches.unwrap_or(default.max_touches),
        birth_frames: keys.birth_frames.unwrap_or(default.birth_frames),
        forgiven_frames: keys.forgiven_frames.unwrap_or(default.forgiven_frames),
        ..default
    }
}

/// One-step reconstruction weighted by the noise, at noise figure 1: an image as noisy as its data.
/// Where electrodes move, that is taken out first, and the prior stays.
struct Imaging {
    difference: OneStepGaussNewton,
    /// Takes the movement of electrodes out of differences.
    whitening: Option<Whitening>,
}

impl Imaging {
    fn new(fitted: &FittedFrames, progress: &mut Progress) -> Result<Self, SkinError> {
        let FittedFrames { skin, frames, .. } = fitted;
        let Some(noise) = fitted.noise()? else {
            return Err(SkinError::input("the noise of the frames is unknown: set [noise]"));
        };
        let mut settings = fitted.one_step_settings()?;
        settings.noise_std = Some(noise.std.clone());
        let prior = skin.prior()?;
        progress.stage("one-step images", || {
            let mut difference = OneStepGaussNewton::new(&skin.jacobian, prior.as_ref(), settings)?;
            let target = NoiseTarget::central(skin.skin.mesh.surface(), &skin.jacobian)?;
            let figure = DEFAULT_NOISE_FIGURE;
            let choice = HyperparameterChoice::NoiseFigure { figure, target: &target };
            difference.choose_hyperparameter(&choice)?;
            let taken = movement::take_out(skin, &noise, &frames.used, Some(&difference))?;
            let Some(TakenOut { side, linearised, .. }) = taken else {
                return Ok(Self { difference, whitening: None });
            };
            let used = Some(frames.used.clone());
            let settings = OneStepSettings { used, ..Default::default() };
            let mut left = OneStepGaussNewton::new(&linearised.jacobian, prior.as_ref(), settings)?;
            left.set_prior_of(&difference)?;
            let whitening = Whitening::new(side, skin.difference_kind(), &frames.used);
            Ok::<_, SkinError>(Self { difference: left, whitening: Some(whitening) })
        })
    }
}
