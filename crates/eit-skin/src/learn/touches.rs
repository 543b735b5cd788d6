//! Touches of a skin that was learnt: by its presses, or by the model with forces from presses.

use super::{LearnedSkin, LocalSheet, PlacesBy, model};
use crate::error::SkinError;
use crate::linearised::LinearisedSkin;
use eit_inverse::learn::{ForceCurve, ResponseMap};
use eit_inverse::touch::{
    DetectedTouch, DetectorStep, LearntDetector, LearntSettings, LearntTouch, Stated, Untouched,
};
use ndarray::Array2;
use std::path::Path;

/// Forces of touches that the model alone finds.
#[derive(Debug, Clone)]
pub(crate) struct ModelForces {
    curve: Option<ForceCurve>,
    local: LocalSheet,
}

/// Touches by a map of presses.
#[derive(Debug, Clone)]
pub(crate) struct LearnedTouches {
    detector: LearntDetector,
    curve: Option<ForceCurve>,
    /// Number of presses.
    pub(crate) presses: usize,
    channels: Vec<usize>,
    /// Channel of each measurement.
    channel_of: Vec<Option<usize>>,
    frame: Vec<f64>,
    reference: Vec<f64>,
    touches: Vec<DetectedTouch>,
}

/// What is known of the untouched skin when touches are sought, `[measurement]` or `[channel]`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Quiet<'a> {
    pub(crate) reference: &'a [f64],
    /// Noise of a frame minus the reference.
    pub(crate) std_v: &'a [f64],
    pub(crate) rate_hz: f64,
}

impl LearnedSkin {
    /// Reads the file that a scene names.
    ///
    /// # Errors
    ///
    /// A file that cannot be read, or that was learnt on another skin or protocol.
    pub(crate) fn read_for(file: &Path, skin: &LinearisedSkin) -> Result<Self, SkinError> {
        let learned = Self::read(file)?;
        learned.check(skin).map_err(|e| e.within(&file.display().to_string()))?;
        Ok(learned)
    }

    /// Whether the model alone was the best on the presses.
    pub(crate) fn model_is_right(&self) -> bool {
        self.places_by == PlacesBy::Model
    }

    /// Forces of touches that the model alone finds.
    pub(crate) fn model_forces(&self, local: LocalSheet) -> ModelForces {
        ModelForces { curve: self.force.clone(), local }
    }

    /// Prepares the map of presses for frames of this untouched skin.
    ///
    /// # Errors
    ///
    /// Presses learnt on another skin, protocol or choice of measurements.
    pub(crate) fn touches(
        &self,
        skin: &LinearisedSkin,
        quiet: Quiet<'_>,
        settings: LearntSettings,
    ) -> Result<LearnedTouches, SkinError> {
        let of_channels =
            |values: &[f64]| -> Vec<f64> { self.channels.iter().map(|&i| values[i]).collect() };
        let (reference, std_v) = (of_channels(quiet.reference), of_channels(quiet.std_v));
        let of_quiet = Quiet { reference: &reference, std_v: &std_v, ..quiet };
        let map = self.map(skin)?;
        let stated = Some(self.stated);
        let detector = self.detector(skin, map, of_quiet, settings, stated)?;
        let mut channel_of = vec![None; quiet.reference.len()];
        self.channels.iter().enumerate().for_each(|(channel, &i)| channel_of[i] = Some(channel));
        Ok(LearnedTouches {
            frame: vec![0.0; reference.len()],
            reference: quiet.reference.to_vec(),
            touches: Vec::with_capacity(settings.max_touches),
            curve: self.force.clone(),
            presses: self.presses.places_m.len(),
            channels: self.channels.clone(),
            channel_of,
            detector,
        })
    }

    /// Learns the map from the presses and the settings that were chosen.
    pub(super) fn map(&self, skin: &LinearisedSkin) -> Result<ResponseMap, SkinError> {
        let model = self.model_responses(skin)?;
        Ok(ResponseMap::with_settings(&self.presses, &self.levels, &model, self.map)?)
    }

    /// Prepares a map for frames of an untouched skin, `[channel]`.
    pub(super) fn detector(
        &self,
        skin: &LinearisedSkin,
        map: ResponseMap,
        quiet: Quiet<'_>,
        settings: LearntSettings,
        stated: Option<Stated>,
    ) -> Result<LearntDetector, SkinError> {
        let Self { channels, bell_m, orientation, .. } = self;
        let factors = model::ratios(skin, channels, &self.levels);
        let scaled: Vec<f64> = map.scale.iter().zip(&factors).map(|(c, ratio)| ratio / c).collect();
        // the length alone counts, which a turn changes little
        let responses = model::responses(skin, channels, &scaled, &map.places_m, *bell_m)?;
        let strength = |row: ndarray::ArrayView1<'_, f64>| {
            orientation.sign * map.unit / row.dot(&row).sqrt().max(f64::MIN_POSITIVE)
        };
        let strength_s_m2 = responses.rows().into_iter().map(strength).collect();
        let steps = self.steps();
        let Quiet { reference, std_v: noise_std, rate_hz } = quiet;
        let untouched =
            Untouched { reference, noise_std, steps: &steps, interval_s: self.interval_s, rate_hz };
        let surface = skin.skin.mesh.surface();
        Ok(LearntDetector::new(map, surface, &untouched, strength_s_m2, *bell_m, settings, stated)?)
    }

    /// Changes of the untouched skin from one press to the next of the same session, `[interval, channel]`.
    pub(super) fn steps(&self) -> Array2<f64> {
        let rows = self.untouched.rows().into_iter();
        let session = |press: usize| self.presses.sessions.get(press);
        let pairs = rows.clone().zip(rows.skip(1)).enumerate();
        let of_session = pairs.filter(|(press, _)| session(*press) == session(press + 1));
        let steps: Vec<Vec<f64>> = of_session
            .map(|(_, (a, b))| (&b - &a).to_vec())
            .filter(|step| step.iter().any(|v| *v != 0.0))
            .collect();
        let shape = (steps.len(), self.channels.len());
        Array2::from_shape_fn(shape, |(step, channel)| steps[step][channel])
    }
}

impl ModelForces {
    /// Force of a touch of this strength and standard deviation, S m^2, that the model found.
    pub(crate) fn of(&self, [strength, std]: [f64; 2], position_m: [f64; 3]) -> LearntTouch {
        let even = strength.abs() / self.local.ratio_at(position_m);
        let relative = std / strength;
        let of = |curve: &ForceCurve| force(curve, even, position_m, relative);
        LearntTouch { force_n: self.curve.as_ref().map(of), is_unlike: false }
    }
}

/// Force of a touch of this strength and relative error, and its standard deviation, newtons.
fn force(curve: &ForceCurve, strength: f64, position_m: [f64; 3], relative: f64) -> [f64; 2] {
    let relative = if relative.is_finite() { relative.abs() } else { 1.0 };
    let force = curve.force(strength, position_m, relative);
    [force.force_n, force.std_n]
}

impl LearnedTouches {
    /// Takes a frame `[measurement]`, volts. Channels of faulty electrodes are left out until they heal; single missing
    /// values are filled in. Allocates only if the former change.
    ///
    /// # Errors
    ///
    /// A factorisation that fails.
    pub(crate) fn push(
        &mut self,
        values: &[f64],
        is_faulty: impl Fn(usize) -> bool,
        is_missing: impl Fn(usize) -> bool,
    ) -> Result<DetectorStep, SkinError> {
        let Self { detector, channels, frame, curve, touches, .. } = self;
        frame.iter_mut().zip(&*channels).for_each(|(value, &i)| *value = values[i]);
        detector.leave_out(|channel| is_faulty(channels[channel]))?;
        let step = detector.push(frame, |channel| is_missing(channels[channel]))?;
        touches.clear();
        touches.extend(detector.touches().iter().map(|touch| {
            let learnt = touch.learnt.map(|learnt| LearntTouch {
                force_n: curve.as_ref().filter(|_| !learnt.is_unlike).map(|curve| {
                    let relative = touch.strength_std_s_m2 / touch.strength_s_m2;
                    force(curve, touch.strength_s_m2.abs(), touch.position_m, relative)
                }),
                ..learnt
            });
            DetectedTouch { learnt, ..*touch }
        }));
        for (&i, value) in channels.iter().zip(detector.reference()) {
            self.reference[i] = *value;
        }
        Ok(step)
    }

    /// Touches of the last frame.
    pub(crate) fn found(&self) -> &[DetectedTouch] {
        &self.touches
    }

    /// The reference, `[measurement]`.
    pub(crate) fn reference_v(&self) -> &[f64] {
        &self.reference
    }

    pub(crate) fn set_reference(&mut self, measurement: usize, value: f64) {
        if let Some(channel) = self.channel_of.get(measurement).copied().flatten() {
            self.detector.set_reference(channel, value);
            self.reference[measurement] = value;
        }
    }

    pub(crate) fn forget_waiting(&mut self) {
        self.detector.forget_waiting();
    }

    /// Number of channels, coarse places and places.
    pub(crate) fn sizes(&self) -> [usize; 3] {
        self.detector.sizes()
    }
}
