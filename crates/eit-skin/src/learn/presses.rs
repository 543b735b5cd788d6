//! Frames of the presses in a table.

use super::{PlaceErrors, PlacesBy, PressTable, touched};
use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::frames::Frames;
use crate::progress::Progress;
use crate::touches::{DEFAULT_RATE_HZ, TouchFinder};
use eit_core::vector::distance;
use eit_inverse::touch::DetectedTouch;
use ndarray::Array2;
use std::ops::RangeInclusive;

/// Frames of presses, each with the untouched frame to subtract from it.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct PressFrames {
    /// `[press, measurement]`, volts; arbitrary for measurements that do not count.
    pub values: Array2<f64>,
    /// Frames of the untouched skin, `[press, measurement]`, volts.
    pub references: Array2<f64>,
    /// Places in the coordinates of the table, metres.
    pub places_m: Vec<[f64; 3]>,
    /// Forces, newtons, if known.
    pub forces_n: Vec<Option<f64>>,
    /// Lines of the table, from 1.
    pub lines: Vec<usize>,
    /// Name of the table, for messages.
    pub place: String,
}

/// The strongest touch of a press, found by the model alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PressTouch {
    /// The touch.
    pub touch: DetectedTouch,
    /// Strength that it would have on an even sheet, S m^2, without sign: divided by the relative conductivity of
    /// the sheet there, as far as the reference frame shows it.
    pub even_strength_s_m2: f64,
}

/// Range of frames of a press.
#[derive(Debug, Clone)]
pub(super) struct PressRanges {
    pub pressed: RangeInclusive<usize>,
    /// Frames of the untouched skin; `None` for the reference of the recording.
    pub before: Option<RangeInclusive<usize>>,
}

impl PressFrames {
    /// Averages the frames that the table names.
    ///
    /// # Errors
    ///
    /// Frames that the recording does not have, or that two presses share; a number of frames other than that
    /// of presses, if the table names no frames; a measurement that counts and is bad in all frames of a
    /// press; a frame of a press that does not show it.
    pub fn new(table: &PressTable, frames: &Frames) -> Result<Self, SkinError> {
        let ranges = ranges(table, frames.values.nrows())?;
        touched::refuse_shared(table, &ranges)?;
        let shape = (ranges.len(), frames.values.ncols());
        let (mut values, mut references) = (Array2::zeros(shape), Array2::zeros(shape));
        for (k, PressRanges { pressed, before }) in ranges.iter().enumerate() {
            for i in 0..shape.1 {
                let untouched = match before {
                    Some(before) => mean(frames, before, i),
                    None => Some(frames.reference[i]),
                };
                for (what, range, found) in [
                    ("before it", before.as_ref(), untouched),
                    ("", Some(pressed), mean(frames, pressed, i)),
                ] {
                    if let (true, None, Some(range)) = (frames.used[i], found, range) {
                        return Err(no_value(i, what, range).within(&table.name(k)));
                    }
                }
                references[[k, i]] = untouched.unwrap_or(frames.reference[i]);
                values[[k, i]] = mean(frames, pressed, i).unwrap_or(references[[k, i]]);
            }
        }
        let presses = &table.presses;
        let made = Self {
            values,
            references,
            places_m: presses.iter().map(|p| [p.x_m, p.y_m, p.z_m.unwrap_or(0.0)]).collect(),
            forces_n: presses.iter().map(|p| p.force_n).collect(),
            lines: (0..presses.len()).map(|k| table.line(k)).collect(),
            place: table.place.clone(),
        };
        touched::refuse_untouched(&made, &ranges, frames)?;
        Ok(made)
    }

    /// Returns the name of a press in messages.
    pub fn name(&self, press: usize) -> String {
        match self.lines.get(press) {
            Some(line) => format!("{}, line {line}", self.place),
            None => self.place.clone(),
        }
    }

    /// Returns pressed minus untouched frames, `[press, channel]`.
    pub fn differences(&self, channels: &[usize]) -> Array2<f64> {
        Array2::from_shape_fn((self.values.nrows(), channels.len()), |(press, k)| {
            self.values[[press, channels[k]]] - self.references[[press, channels[k]]]
        })
    }

    /// Returns the presses with these indices.
    pub fn select(&self, which: &[usize]) -> Self {
        let axis = ndarray::Axis(0);
        Self {
            values: self.values.select(axis, which),
            references: self.references.select(axis, which),
            places_m: which.iter().map(|&k| self.places_m[k]).collect(),
            forces_n: which.iter().map(|&k| self.forces_n[k]).collect(),
            lines: which.iter().map(|&k| self.lines[k]).collect(),
            place: self.place.clone(),
        }
    }

    /// Returns the number of presses.
    pub fn len(&self) -> usize {
        self.places_m.len()
    }

    /// Returns whether there are no presses.
    pub fn is_empty(&self) -> bool {
        self.places_m.is_empty()
    }

    /// Frame and reference of each press, `[measurement]`.
    pub(super) fn pairs(&self) -> impl Iterator<Item = [Vec<f64>; 2]> {
        let pairs = self.values.rows().into_iter().zip(self.references.rows());
        pairs.map(|(values, reference)| [values.to_vec(), reference.to_vec()])
    }

    /// Finds the strongest touch of each press with the model alone, as touches are found on a skin whose places
    /// are by the given method; `None` if the noise is unknown.
    ///
    /// # Errors
    ///
    /// Settings with which no touches can be found.
    pub fn detect(
        &self,
        fitted: &FittedFrames,
        places_by: PlacesBy,
    ) -> Result<Option<Vec<Option<PressTouch>>>, SkinError> {
        strongest(fitted, self.pairs(), places_by)
    }
}

/// Finds the strongest touch of each frame against its reference with the model alone; `None` if the noise is
/// unknown.
pub(super) fn strongest(
    fitted: &FittedFrames,
    pairs: impl Iterator<Item = [Vec<f64>; 2]>,
    places_by: PlacesBy,
) -> Result<Option<Vec<Option<PressTouch>>>, SkinError> {
    let rate_hz = fitted.frames.rate_hz.unwrap_or(DEFAULT_RATE_HZ);
    let is_right = places_by == PlacesBy::Model;
    let finder = TouchFinder::for_presses(fitted, rate_hz, is_right, &mut Progress::silent())?;
    let Some(finder) = finder else { return Ok(None) };
    let found = pairs.map(|[values, reference]| finder.strongest(&values, &reference));
    Ok(Some(found.collect::<Result<_, _>>()?))
}

/// The frames of each press.
fn ranges(table: &PressTable, count: usize) -> Result<Vec<PressRanges>, SkinError> {
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
    let range = |k: usize, first: usize, last: Option<usize>| {
        let last = last.unwrap_or(first);
        if last >= count {
            let what = format!("{}, frame {last}", table.name(k));
            return Err(SkinError::NoSuchFrame { what, last: count - 1 });
        }
        Ok(first..=last)
    };
    let of = |(k, press): (usize, &super::Press)| {
        let before = press.before_first.map(|first| range(k, first, press.before_last));
        Ok(PressRanges {
            pressed: range(k, press.first_frame.unwrap_or(k), press.last_frame)?,
            before: before.transpose()?,
        })
    };
    presses.iter().enumerate().map(of).collect()
}

fn no_value(measurement: usize, what: &str, range: &RangeInclusive<usize>) -> SkinError {
    let (first, last) = (range.start(), range.end());
    let space = if what.is_empty() { "" } else { " " };
    SkinError::input(format!(
        "measurement {measurement} (from 0) is bad in all frames {first} to {last}{space}{what}: remove the \
         press, or exclude the measurement or its electrode in the scene"
    ))
}

impl PlaceErrors {
    /// Returns median and mean of distances.
    pub fn of_errors(mut errors_m: Vec<f64>) -> Self {
        errors_m.sort_unstable_by(f64::total_cmp);
        let mean_m = errors_m.iter().sum::<f64>() / errors_m.len().max(1) as f64;
        Self { median_m: errors_m.get(errors_m.len() / 2).copied().unwrap_or(0.0), mean_m }
    }

    /// Errors of detected touches; a press that was not found counts with `missed_m`.
    pub(super) fn of_detected(
        detected: &[Option<PressTouch>],
        places_m: &[[f64; 3]],
        missed_m: f64,
    ) -> Self {
        Self::of_errors(errors_of_detected(detected, places_m, missed_m))
    }
}

/// Error of each press; one that was not found has `missed_m`.
pub(super) fn errors_of_detected(
    detected: &[Option<PressTouch>],
    places_m: &[[f64; 3]],
    missed_m: f64,
) -> Vec<f64> {
    let error = |(found, place): (&Option<PressTouch>, &[f64; 3])| match found {
        Some(found) => distance(found.touch.position_m, *place),
        None => missed_m,
    };
    detected.iter().zip(places_m).map(error).collect()
}

fn mean(frames: &Frames, range: &RangeInclusive<usize>, i: usize) -> Option<f64> {
    let good = range.clone().filter(|&f| frames.good[[f, i]]);
    let (sum, count) = good.fold((0.0, 0), |(s, n), f| (s + frames.values[[f, i]], n + 1));
    (count > 0).then(|| sum / f64::from(count))
}
