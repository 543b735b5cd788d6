//! Frames of the presses of a table.

use super::{PlaceErrors, PressTable};
use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::frames::Frames;
use crate::progress::Progress;
use crate::touches::{DEFAULT_RATE_HZ, TouchFinder};
use eit_inverse::touch::DetectedTouch;
use ndarray::Array2;
use std::ops::RangeInclusive;

/// Frames of presses with what was subtracted from each.
#[derive(Debug, Clone, PartialEq)]
pub struct PressFrames {
    /// `[press, measurement]`, volts.
    pub values: Array2<f64>,
    /// Of the untouched skin, `[press, measurement]`, volts.
    pub references: Array2<f64>,
    /// In the coordinates of the table, metres.
    pub places_m: Vec<[f64; 3]>,
    /// Newtons, where known.
    pub forces_n: Vec<Option<f64>>,
}

impl PressFrames {
    /// Means over the frames that the table names.
    ///
    /// # Errors
    ///
    /// Frames that the recording does not have; as many frames as presses are needed where the table names
    /// none.
    pub fn new(table: &PressTable, frames: &Frames) -> Result<Self, SkinError> {
        let (count, measurements) = frames.values.dim();
        let presses = &table.presses;
        let unnamed = presses.iter().filter(|p| p.first_frame.is_none()).count();
        if unnamed > 0 && (unnamed < presses.len() || presses.len() != count) {
            return Err(SkinError::input(format!(
                "{}: {} presses, {unnamed} of them without first_frame, and {count} frames: give every \
                 press its first_frame and last_frame, or as many frames as presses",
                table.place,
                presses.len()
            )));
        }
        let mut values = Array2::zeros((presses.len(), measurements));
        let mut references = Array2::zeros((presses.len(), measurements));
        for (k, press) in presses.iter().enumerate() {
            let range = |first: usize, last: Option<usize>| -> Result<_, SkinError> {
                let last = last.unwrap_or(first);
                if last >= count {
                    let what = format!("{}, line {}, frame {last}", table.place, k + 2);
                    return Err(SkinError::NoSuchFrame { what, last: count - 1 });
                }
                Ok(first..=last)
            };
            let pressed = range(press.first_frame.unwrap_or(k), press.last_frame)?;
            let before = press.before_first.map(|first| range(first, press.before_last));
            for i in 0..measurements {
                let reference = match before.as_ref() {
                    Some(Ok(before)) => mean(frames, before, i),
                    _ => Some(frames.reference[i]),
                };
                // a value that is bad in all frames says nothing of the press
                let reference = reference.unwrap_or(frames.reference[i]);
                references[[k, i]] = reference;
                values[[k, i]] = mean(frames, &pressed, i).unwrap_or(reference);
            }
            if let Some(Err(error)) = before {
                return Err(error);
            }
        }
        Ok(Self {
            values,
            references,
            places_m: presses.iter().map(|p| [p.x_m, p.y_m, p.z_m.unwrap_or(0.0)]).collect(),
            forces_n: presses.iter().map(|p| p.force_n).collect(),
        })
    }

    /// Pressed less untouched, `[press, channel]`.
    pub fn differences(&self, channels: &[usize]) -> Array2<f64> {
        Array2::from_shape_fn((self.values.nrows(), channels.len()), |(press, k)| {
            self.values[[press, channels[k]]] - self.references[[press, channels[k]]]
        })
    }

    /// The presses of these numbers.
    pub fn select(&self, which: &[usize]) -> Self {
        let axis = ndarray::Axis(0);
        Self {
            values: self.values.select(axis, which),
            references: self.references.select(axis, which),
            places_m: which.iter().map(|&k| self.places_m[k]).collect(),
            forces_n: which.iter().map(|&k| self.forces_n[k]).collect(),
        }
    }

    /// Number of presses.
    pub fn len(&self) -> usize {
        self.places_m.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.places_m.is_empty()
    }

    /// The strongest touch of each by the model alone; `None` where the noise is unknown.
    pub fn detect(
        &self,
        fitted: &FittedFrames,
    ) -> Result<Option<Vec<Option<DetectedTouch>>>, SkinError> {
        let rate_hz = fitted.frames.rate_hz.unwrap_or(DEFAULT_RATE_HZ);
        let finder = TouchFinder::new(fitted, rate_hz, &mut Progress::silent())?;
        let Some(finder) = finder else { return Ok(None) };
        let pairs = self.values.rows().into_iter().zip(self.references.rows());
        let found = pairs
            .map(|(values, reference)| finder.strongest(&values.to_vec(), &reference.to_vec()));
        Ok(Some(found.collect::<Result<_, _>>()?))
    }

    /// Errors of detected touches; a press that was not found errs by `missed_m`.
    pub(super) fn errors_of(
        &self,
        detected: &[Option<DetectedTouch>],
        missed_m: f64,
    ) -> PlaceErrors {
        let error = |(touch, place): (&Option<DetectedTouch>, &[f64; 3])| match touch {
            Some(touch) => distance_m(touch.position_m, *place),
            None => missed_m,
        };
        PlaceErrors::of_errors(detected.iter().zip(&self.places_m).map(error).collect())
    }
}

impl PlaceErrors {
    /// Median and mean of distances.
    pub fn of_errors(mut errors_m: Vec<f64>) -> Self {
        errors_m.sort_unstable_by(f64::total_cmp);
        let mean_m = errors_m.iter().sum::<f64>() / errors_m.len().max(1) as f64;
        Self { median_m: errors_m.get(errors_m.len() / 2).copied().unwrap_or(0.0), mean_m }
    }
}

pub(super) fn distance_m(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

fn mean(frames: &Frames, range: &RangeInclusive<usize>, i: usize) -> Option<f64> {
    let good = range.clone().filter(|&f| frames.good[[f, i]]);
    let (sum, count) = good.fold((0.0, 0), |(s, n), f| (s + frames.values[[f, i]], n + 1));
    (count > 0).then(|| sum / f64::from(count))
}
