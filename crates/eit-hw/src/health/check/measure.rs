//! Quantities behind the findings: noise, drift, flags.

use eit_core::median;
use ndarray::ArrayView1;

use crate::frame::{Quadruple, Quality};
use crate::recording::MeasuredFrames;

/// Ratio of standard deviation to median absolute deviation for a normal distribution.
const MAD_TO_STD: f64 = 1.4826;
/// Fraction of flagged values above which an electrode counts as open.
const FLAGGED_SHARE: f64 = 0.5;

/// Returns the noise estimated from pairs of successive good values; NaN for fewer than three.
pub(super) fn noise_std(values: ArrayView1<'_, f64>, quality: ArrayView1<'_, Quality>) -> f64 {
    let good = |index: usize| quality[index].is_good() && values[index].is_finite();
    let steps = (1..values.len())
        .filter(|&index| good(index) && good(index - 1))
        .map(|index| (values[index] - values[index - 1]).abs())
        .collect::<Vec<_>>();
    if steps.len() < 3 {
        return f64::NAN;
    }
    median(steps).map_or(f64::NAN, |median| MAD_TO_STD * median / std::f64::consts::SQRT_2)
}

/// Returns the change of each measurement from the first to the last quarter of the frames.
pub(super) fn drift(frames: &MeasuredFrames) -> Vec<f64> {
    let count = frames.values.nrows();
    let quarter = (count / 4).max(1);
    let (first, _) = frames.mean_of(0..quarter);
    let (last, _) = frames.mean_of(count - quarter..count);
    last.iter().zip(first).map(|(last, first)| last - first).collect()
}

/// Returns electrodes most of whose values are flagged, worst first, with the fraction flagged.
/// Each is judged without the measurements of worse ones, since neighbours share measurements.
pub(super) fn open_electrodes(
    frames: &MeasuredFrames,
    quadruples: &[Quadruple],
    count: usize,
) -> Vec<(u32, f64)> {
    let mut left: Vec<(Quadruple, f64)> =
        quadruples.iter().copied().zip(flagged_shares(frames)).collect();
    let mut open = Vec::new();
    for _ in 0..count {
        let share = |electrode: u32| {
            let of = left.iter().filter(|(quadruple, _)| quadruple.contains(&electrode));
            let (sum, number) = of.fold((0.0, 0.0), |(sum, n), (_, share)| (sum + share, n + 1.0));
            if number > 0.0 { sum / number } else { 0.0 }
        };
        let shares = (0..count as u32).map(|electrode| (electrode, share(electrode)));
        let worst = shares.max_by(|(_, one), (_, other)| one.total_cmp(other));
        let Some((electrode, share)) = worst.filter(|(_, share)| *share > FLAGGED_SHARE) else {
            break;
        };
        open.push((electrode, share));
        left.retain(|(quadruple, _)| !quadruple.contains(&electrode));
    }
    open
}

/// Returns the fraction of flagged values of each measurement.
pub(super) fn flagged_shares(frames: &MeasuredFrames) -> Vec<f64> {
    let columns = frames.quality.columns().into_iter();
    columns
        .map(|column| {
            let bad = column.iter().filter(|quality| !quality.is_good()).count();
            bad as f64 / column.len() as f64
        })
        .collect()
}

/// Returns the median of the finite values; NaN if there are none.
pub(super) fn finite_median(values: impl Iterator<Item = f64>) -> f64 {
    median(values.filter(|value| value.is_finite())).unwrap_or(f64::NAN)
}
