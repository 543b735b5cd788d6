//! What a press does to each channel anywhere on a skin, learnt from presses, and how wrong that is.
//!
//! ```text
//! y = (pressed - untouched) / c,   u = y / |y|         c: scale of each channel
//! u_i = g * m(p_i) + f(p_i) + e_i                      process of `process.rs`
//! d(x) = |typical press| (g * m(x) + f(x)),            response of strength 1: that of the median press
//! R(x) = v(x) S                                        its covariance: v from the process, S from presses left out
//! ```
//!
//! Length of the kernel, noise and the pull of the gains are those of the largest predictive likelihood of presses
//! left out, of 96 combinations. The shape of a press is more reliable than its length, so the lengths are refitted
//! once. `S` is the covariance of what is left of presses that were left out, each with the same weight, shrunk to its
//! common factors and toward a prior; its size is the median, and the degrees of freedom of a t distribution tell how
//! much presses differ from it.

mod error;
mod left_out;

pub(crate) use left_out::folds;
pub(super) use left_out::unit_rows;

use super::covariance::Covariance;
use super::linear::product;
use super::presses::{ModelResponses, Presses};
use super::process::{GainSums, Kernel, Process};
use crate::InverseError;
use crate::check::{check_length, check_positive, check_range};
use crate::geometry::distance_m;
use error::error;
use left_out::{Data, LeftOut};
use ndarray::{Array1, Array2, ArrayRef2, Axis};

/// Fewest presses to learn from.
const LEAST_PRESSES: usize = 4;
/// Distance below which presses are at one place, metres: below any robot's step, above rounding.
const LEAST_SPREAD_M: f64 = 1e-9;

/// Presses as which a channel's share of the level counts in its scale, and the part of the median scale that is added.
const LEVEL_PRESSES: f64 = 3.0;
const LEAST_SCALE: f64 = 0.05;
/// Largest change of a channel, in its scale, unless two presses have changed it more: a single outlying value must not
/// decide a place.
const CLIP: f64 = 8.0;
/// Kernel lengths, as fractions of the skin's radius; noises; whether weak presses are noisier; pulls of the gains.
const LENGTHS: [f64; 4] = [0.25, 0.35, 0.5, 0.8];
const NOISES: [f64; 3] = [0.03, 0.1, 0.3];
const WEAK: [f64; 2] = [0.0, 1.0];
const PULLS: [Option<f64>; 4] = [Some(0.1), Some(1.0), Some(10.0), None];
/// Fewest presses from which responses are learnt without the model.
const WITHOUT_MODEL: usize = 8;
/// Most presses by which settings are chosen: more do not change the choice.
const CHOOSING: usize = 300;

/// Settings of a [`ResponseMap`], chosen by [`ResponseMap::choose`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct MapSettings {
    /// Length scale over the skin, metres.
    pub length_m: f64,
    /// Variance of a press relative to that of the process.
    pub noise: f64,
    /// How much noisier, relatively, a weak press is: 0 not at all, 1 by the ratio of squared lengths.
    pub weak: f64,
    /// Strength of the pull of each channel's gain toward the common one, relative to the information in
    /// the presses; `None` ignores the model, so that everything is learnt.
    pub gain_pull: Option<f64>,
}

impl MapSettings {
    /// Rejects settings out of range.
    fn validate(&self) -> Result<(), InverseError> {
        check_positive("length_m", self.length_m)?;
        check_positive("noise", self.noise)?;
        check_positive("gain_pull", self.gain_pull.unwrap_or(1.0))?;
        check_range("weak", self.weak, (0.0..=1.0).contains(&self.weak), "from 0 to 1")
    }

    /// Kernel of the process.
    fn kernel(&self) -> Kernel {
        Kernel { length_m: self.length_m, noise: self.noise, weak: self.weak }
    }
}

/// Learnt responses of the channels to a press at each place, with their covariance.
#[derive(Debug, Clone)]
pub struct ResponseMap {
    /// Settings.
    pub settings: MapSettings,
    /// Places, metres.
    pub places_m: Vec<[f64; 3]>,
    /// Scale of each channel, in the unit of the changes.
    pub scale: Vec<f64>,
    /// Largest change of each channel, in its scale: larger ones are outliers.
    pub(crate) most: Vec<f64>,
    /// Length of the median press in units of the scales: a touch of strength 1 has it.
    pub unit: f64,
    /// Responses to a press of length 1, `[place, channel]`.
    pub(crate) responses: Array2<f64>,
    /// Variance of the response at each place, relative to `error`.
    pub(crate) variance: Array1<f64>,
    /// Covariance of what a response of length 1 and variance 1 is off by.
    pub(crate) error: Covariance,
    /// Degrees of freedom of a frame's distribution.
    pub(crate) freedom: f64,
    /// Presses in units of the scales, `[press, channel]`, and their places.
    pub(crate) changes: Array2<f64>,
    pub(crate) presses_m: Vec<[f64; 3]>,
    data: Data,
    process: Process,
    /// Weights of presses at places, and the weights times shapes and model, `[place, channel]`.
    known: Array2<f64>,
    of_shapes: Array2<f64>,
    of_model: Array2<f64>,
}

/// Rejects presses that are too few, at one place or not of this model.
fn check(presses: &Presses, levels: &[f64], model: &ModelResponses) -> Result<(), InverseError> {
    presses.validate(LEAST_PRESSES)?;
    model.validate(presses)?;
    check_length("levels of the channels", levels.len(), presses.frames.ncols())?;
    let first = presses.places_m[0];
    let is_spread = presses.places_m.iter().any(|p| distance_m(*p, first) > LEAST_SPREAD_M);
    if is_spread {
        return Ok(());
    }
    Err(InverseError::PressesAtOnePlace { presses: presses.places_m.len() })
}

impl ResponseMap {
    /// Returns the scale of each channel: its median change, toward its share of the level while presses are few.
    pub fn scales(changes: &ArrayRef2<f64>, levels: &[f64]) -> Vec<f64> {
        let presses = changes.nrows() as f64;
        let median =
            |values: &mut dyn Iterator<Item = f64>| eit_core::median(values).unwrap_or(0.0);
        let medians: Vec<f64> = changes
            .columns()
            .into_iter()
            .map(|column| median(&mut column.iter().map(|v| v.abs())))
            .collect();
        let typical = median(&mut medians.iter().copied()).max(f64::MIN_POSITIVE);
        let level = median(&mut levels.iter().map(|v| v.abs())).max(f64::MIN_POSITIVE);
        let scale = |(change, of_level): (&f64, &f64)| {
            let share = typical * of_level.abs() / level;
            let squares = presses * change * change + LEVEL_PRESSES * share * share;
            (squares / (presses + LEVEL_PRESSES)).sqrt() + LEAST_SCALE * typical
        };
        medians.iter().zip(levels).map(scale).collect()
    }

    /// Learns a map from presses on a skin of a radius, with the settings that predict left-out presses best. `levels` are
    /// the channels' voltages on the untouched skin.
    ///
    /// # Errors
    /// Fewer than four presses, all presses at one position, or non-finite frames or responses.
    pub fn choose(
        presses: &Presses,
        levels: &[f64],
        model: &ModelResponses,
        radius_m: f64,
    ) -> Result<Self, InverseError> {
        check(presses, levels, model)?;
        let Scaled { changes, scale, unit, .. } = scaled(&presses.frames, levels);
        let mut which: Vec<usize> = folds(presses.places_m.len(), CHOOSING).concat();
        which.sort_unstable();
        let few = presses.select(&which);
        let mut data = Data::new(&changes, &scale, unit, model).select(&which);
        let pulls = if presses.places_m.len() >= WITHOUT_MODEL { &PULLS[..] } else { &PULLS[..3] };
        let mut settings = None;
        for is_last in [false, true] {
            let mut best: Option<(f64, MapSettings, LeftOut)> = None;
            for length_m in LENGTHS.map(|part| part * radius_m) {
                for (noise, weak) in NOISES.into_iter().flat_map(|n| WEAK.map(|w| (n, w))) {
                    let kernel = Kernel { length_m, noise, weak };
                    let process = Process::new(&few, &data.relative2, kernel)?;
                    for &gain_pull in pulls {
                        let left = data.left_out(&process, gain_pull)?;
                        let score = left.score(&data.shapes);
                        if best.as_ref().is_none_or(|(most, ..)| score > *most) {
                            let found = MapSettings { length_m, noise, weak, gain_pull };
                            best = Some((score, found, left));
                        }
                    }
                }
            }
            if let Some((_, found, left)) = best {
                settings = Some(found);
                if !is_last {
                    data.refit_lengths(&left);
                }
            }
        }
        let none = InverseError::PressesAtOnePlace { presses: presses.places_m.len() };
        Self::with_settings(presses, levels, model, settings.ok_or(none)?)
    }

    /// Learns with given settings.
    ///
    /// # Errors
    /// Those of [`ResponseMap::choose`], and settings out of range.
    pub fn with_settings(
        presses: &Presses,
        levels: &[f64],
        model: &ModelResponses,
        settings: MapSettings,
    ) -> Result<Self, InverseError> {
        check(presses, levels, model)?;
        settings.validate()?;
        let Scaled { changes, scale, most, unit } = scaled(&presses.frames, levels);
        let mut data = Data::new(&changes, &scale, unit, model);
        let process = Process::new(presses, &data.relative2, settings.kernel())?;
        let left = data.left_out(&process, settings.gain_pull)?;
        data.refit_lengths(&left);
        let left = data.left_out(&process, settings.gain_pull)?;
        let (known, variance) = process.at(presses, &model.candidates_m);
        let [of_shapes, of_model] = [&data.shapes, &data.model].map(|rows| product(&known, rows));
        let sums = GainSums::new(&data.shapes, &data.model);
        let gains = sums.without(&data.shapes, &data.model, &[], settings.gain_pull);
        let responses = (&data.model_at_places - &of_model) * &gains + &of_shapes;
        let (error, freedom) = error(&data.shapes, &left, &responses, &variance)?;
        let places_m = model.candidates_m.clone();
        let presses_m = presses.places_m.clone();
        Ok(Self {
            settings,
            places_m,
            scale,
            most,
            unit,
            responses,
            variance,
            error,
            freedom,
            changes,
            presses_m,
            data,
            process,
            known,
            of_shapes,
            of_model,
        })
    }

    /// Returns responses and variances as they would be without some of the presses.
    pub(crate) fn without(
        &self,
        fold: &[usize],
    ) -> Result<(Array2<f64>, Array1<f64>), InverseError> {
        let Data { shapes, model, model_at_places, .. } = &self.data;
        let gains =
            GainSums::new(shapes, model).without(shapes, model, fold, self.settings.gain_pull);
        let known = self.known.select(Axis(1), fold);
        let own = known.dot(&self.process.left_out(fold)?);
        let inverse = self.process.inverse.select(Axis(0), fold);
        let weights = inverse.dot(shapes) - &(inverse.dot(model) * &gains);
        let responses =
            (model_at_places - &self.of_model) * &gains + &self.of_shapes - &own.dot(&weights);
        Ok((responses, &self.variance + &(own * known).sum_axis(Axis(1))))
    }
}

/// Changes in units of the channels' scales, clipped; the scales and limits; and the length of the median press.
struct Scaled {
    changes: Array2<f64>,
    scale: Vec<f64>,
    most: Vec<f64>,
    unit: f64,
}

/// Scales presses.
fn scaled(frames: &Array2<f64>, levels: &[f64]) -> Scaled {
    let scale = ResponseMap::scales(frames, levels);
    let mut changes = frames / &Array1::from_iter(scale.iter().copied());
    let mut most = Vec::with_capacity(scale.len());
    for mut column in changes.columns_mut() {
        let [mut largest, mut second] = [0.0_f64; 2];
        for size in column.iter().map(|v| v.abs()) {
            (largest, second) = (largest.max(size), second.max(size.min(largest)));
        }
        let limit = second.max(CLIP);
        column.mapv_inplace(|v| v.clamp(-limit, limit));
        most.push(limit);
    }
    let lengths = changes.rows().into_iter().map(|row| row.dot(&row).sqrt());
    let unit = eit_core::median(lengths).unwrap_or(1.0).max(f64::MIN_POSITIVE);
    Scaled { changes, scale, most, unit }
}
