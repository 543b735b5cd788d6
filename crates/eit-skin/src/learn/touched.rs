//! Averages the frames of presses, and rejects presses that do not appear in them: such a press teaches a wrong
//! position or force, and distorts every other choice.

use super::{Press, PressFrames, PressTable};
use crate::error::SkinError;
use crate::frames::Frames;
use eit_inverse::noise_std_of_quiet_frames;
use ndarray::Array2;
use std::ops::RangeInclusive;

/// A frame that shows less than this fraction of its press's mean change is one of the untouched skin: there
/// the fraction is 0, up to noise, whereas in a force ramp that is worth averaging most frames have more.
const LEAST_PART: f64 = 0.25;

/// The change of a press must have this multiple of the power expected from noise: for an untouched skin the
/// ratio is 1 on average, with a deviation of 0.1 at 200 measurements.
const NOISE_FACTOR: f64 = 2.0;

/// Range of frames of a press.
#[derive(Debug, Clone)]
struct PressRanges {
    pressed: RangeInclusive<usize>,
    /// Frames of the untouched skin; `None` for the reference of the recording.
    before: Option<RangeInclusive<usize>>,
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
        refuse_shared(table, &ranges)?;
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
            interval_s: interval_s(presses, frames.rate_hz),
            lines: (0..presses.len()).map(|k| table.line(k)).collect(),
            place: table.place.clone(),
        };
        refuse_untouched(&made, &ranges, frames)?;
        Ok(made)
    }
}

/// Median time from one press to the next.
pub(super) fn interval_s(presses: &[Press], rate_hz: Option<f64>) -> Option<f64> {
    let first = |press: &Press| press.first_frame.map(|frame| frame as f64);
    let pairs = presses.windows(2).filter_map(|pair| Some(first(&pair[1])? - first(&pair[0])?));
    let frames = eit_core::median(pairs.filter(|frames| *frames > 0.0))?;
    Some(frames / rate_hz?)
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
    let of = |(k, press): (usize, &Press)| {
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

fn mean(frames: &Frames, range: &RangeInclusive<usize>, i: usize) -> Option<f64> {
    let good = range.clone().filter(|&f| frames.good[[f, i]]);
    let (sum, count) = good.fold((0.0, 0), |(s, n), f| (s + frames.values[[f, i]], n + 1));
    (count > 0).then(|| sum / f64::from(count))
}

/// Rejects presses that share frames, and frames that are named both as pressed and as untouched.
fn refuse_shared(table: &PressTable, ranges: &[PressRanges]) -> Result<(), SkinError> {
    let mut pressed: Vec<(usize, &RangeInclusive<usize>)> =
        ranges.iter().map(|range| &range.pressed).enumerate().collect();
    pressed.sort_unstable_by_key(|(press, range)| (*range.start(), *press));
    let shared = |press: usize, what: &str, other: usize, range: &RangeInclusive<usize>| {
        let (first, last) = (range.start(), range.end());
        let line = table.line(other);
        SkinError::input(format!(
            "{what} overlap frames {first} to {last}, which line {line} names: a frame belongs to one press"
        ))
        .within(&table.name(press))
    };
    for pair in pressed.windows(2) {
        let [(one, range), (other, next)] = [pair[0], pair[1]];
        if next.start() <= range.end() {
            let what = format!("frames {} to {}", next.start(), next.end());
            return Err(shared(other, &what, one, range));
        }
    }
    for (press, PressRanges { before, .. }) in ranges.iter().enumerate() {
        let Some(before) = before else { continue };
        // presses do not overlap: only the last one that begins by then can reach into the range
        let after = pressed.partition_point(|(_, range)| range.start() <= before.end());
        if let Some((other, range)) = after.checked_sub(1).map(|at| pressed[at])
            && range.end() >= before.start()
        {
            let what = format!("the untouched frames {} to {}", before.start(), before.end());
            return Err(shared(press, &what, other, range));
        }
    }
    Ok(())
}

/// Rejects presses whose change is no larger than noise, and presses that some of their frames do not show.
fn refuse_untouched(
    pressed: &PressFrames,
    ranges: &[PressRanges],
    frames: &Frames,
) -> Result<(), SkinError> {
    let quiet = frames.quiet.as_ref();
    // sum of the variances of a single frame; without quiet frames, only presses of several frames show it
    let noise_v2: Option<f64> =
        quiet.and_then(|quiet| noise_std_of_quiet_frames(quiet.values.view()).ok()).map(|std| {
            std.iter().zip(&frames.used).filter(|(_, used)| **used).map(|(s, _)| s * s).sum()
        });
    for (press, range) in ranges.iter().enumerate() {
        let change = Change::of(pressed, press, range, frames);
        let count = range.pressed.clone().count() as f64;
        let before =
            range.before.as_ref().map_or(frames.reference_frames, |range| range.clone().count());
        let scatter_v2 = change.scatter_v2.or(noise_v2).unwrap_or(0.0);
        let by_noise_v2 = scatter_v2 * (count.recip() + (before.max(1) as f64).recip());
        let (first, last) = (range.pressed.start(), range.pressed.end());
        if change.power_v2 <= NOISE_FACTOR * by_noise_v2 {
            return Err(SkinError::input(format!(
                "frames {first} to {last} change by {:.1e} V root mean square, no more than noise does: was \
                 the skin pressed?",
                (change.power_v2 / frames.used.iter().filter(|used| **used).count() as f64).sqrt()
            ))
            .within(&pressed.name(press)));
        }
        let weak = change.parts.iter().find(|(_, part)| *part < LEAST_PART);
        if let Some((frame, part)) = weak {
            return Err(SkinError::input(format!(
                "frame {frame} shows {:.0} % of the mean change of frames {first} to {last}: name \
                 only frames \
                 that show the press",
                100.0 * part
            ))
            .within(&pressed.name(press)));
        }
    }
    Ok(())
}

/// Effect of a press on its frames.
struct Change {
    /// Square of the mean change, summed over the measurements that count.
    power_v2: f64,
    /// Fraction of the mean change in each frame.
    parts: Vec<(usize, f64)>,
    /// Variance of a frame orthogonal to the mean change, summed over the measurements; `None` for a single
    /// frame.
    scatter_v2: Option<f64>,
}

impl Change {
    fn of(pressed: &PressFrames, press: usize, range: &PressRanges, frames: &Frames) -> Self {
        let reference = pressed.references.row(press);
        let mean: Vec<f64> =
            pressed.values.row(press).iter().zip(reference).map(|(v, r)| v - r).collect();
        let used = || (0..mean.len()).filter(|&i| frames.used[i]);
        let power_v2 = used().map(|i| mean[i] * mean[i]).sum();
        let (mut parts, mut across) = (Vec::new(), 0.0);
        for frame in range.pressed.clone() {
            let good = || used().filter(|&i| frames.good[[frame, i]]);
            let change = |i: usize| frames.values[[frame, i]] - reference[i];
            let square: f64 = good().map(|i| mean[i] * mean[i]).sum();
            if square == 0.0 {
                continue;
            }
            let part = good().map(|i| change(i) * mean[i]).sum::<f64>() / square;
            across += good().map(|i| (change(i) - part * mean[i]).powi(2)).sum::<f64>();
            parts.push((frame, part));
        }
        let others = parts.len().saturating_sub(1);
        let scatter_v2 = (others > 0).then(|| across / others as f64);
        Self { power_v2, parts, scatter_v2 }
    }
}
