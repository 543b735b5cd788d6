//! Whether reference frames show an untouched skin: no frame of another kind, and nothing that comes or goes.

use eit_core::median;
use ndarray::ArrayView2;

/// A value is an outlier if it differs from the median by more than this fraction of it, ...
const OFF: f64 = 0.2;
/// ... plus this fraction of the root mean square median, ...
const OFF_OF_ALL: f64 = 0.02;
/// ... plus this many times the median deviation; without this, every value of a floating
/// measurement would be an outlier.
const OFF_TYPICAL: f64 = 8.0;
/// A frame is an outlier if more than this fraction of its values are, or if half of them are
/// missing.
const OTHER: f64 = 0.2;

/// The frames are compared in this many parts.
const PARTS: usize = 4;
/// Fewest frames of a part.
const LEAST: usize = 2;
/// A measurement has moved if the means of two parts differ by more than this many of their standard deviations.
const MOVED_STD: f64 = 7.0;
/// Something came or went if more than this fraction of the measurements has moved, ...
const MOVED: f64 = 0.15;
/// ... by this fraction of their root mean square in all: 0.2 N on the paper's fabric are 2e-3, a drift of 1 % a minute in
/// two seconds 3e-4.
const CHANGED: f64 = 8e-4;

/// Returns the outlier frames, such as damaged ones or those before the gain was set. `is_good`
/// tells whether the value of a frame and measurement is valid.
pub(crate) fn others(
    values: ArrayView2<'_, f64>,
    is_good: impl Fn(usize, usize) -> bool,
) -> Vec<usize> {
    let (frames, measurements) = values.dim();
    let (mut medians, mut spreads) = (Vec::new(), Vec::new());
    for i in 0..measurements {
        let good = (0..frames).filter(|&f| is_good(f, i)).map(|f| values[(f, i)]);
        let good: Vec<f64> = good.filter(|v| v.is_finite()).collect();
        let middle = median(good.iter().copied()).unwrap_or(f64::NAN);
        let offsets = good.iter().map(|v| (v - middle).abs());
        spreads.push(median(offsets).unwrap_or(f64::NAN));
        medians.push(middle);
    }
    let seen: Vec<f64> = medians.iter().copied().filter(|v| v.is_finite()).collect();
    let typical = root_mean_square(seen.iter().copied());
    let is_other = |&f: &usize| {
        let (mut all, mut off) = (0, 0);
        for i in (0..measurements).filter(|&i| is_good(f, i) && values[(f, i)].is_finite()) {
            let allowed = OFF * medians[i].abs() + OFF_OF_ALL * typical + OFF_TYPICAL * spreads[i];
            all += 1;
            off += usize::from((values[(f, i)] - medians[i]).abs() > allowed);
        }
        2 * all < seen.len() || off as f64 > OTHER * all as f64
    };
    (0..frames).filter(is_other).collect()
}

/// Returns the relative change of the voltages between parts of the frames if it exceeds noise and
/// drift, so that the skin was touched or released; `None` otherwise, or if there are too few
/// frames to tell.
pub(crate) fn unrest(
    values: ArrayView2<'_, f64>,
    is_good: impl Fn(usize, usize) -> bool,
) -> Option<f64> {
    let (frames, measurements) = values.dim();
    let length = frames / PARTS;
    if length < LEAST {
        return None;
    }
    let (mut all, mut moved, mut change, mut size) = (0, 0, 0.0, 0.0);
    for i in 0..measurements {
        let column: Vec<f64> = (0..frames).map(|f| values[(f, i)]).collect();
        if !(0..frames).all(|f| is_good(f, i) && column[f].is_finite()) {
            continue;
        }
        let steps: Vec<f64> = column.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
        let step = steps.iter().copied().filter(|step| *step > 0.0).fold(f64::INFINITY, f64::min);
        // the median of the absolute value of a normal value is 0.674 of its standard deviation
        let noise = median(steps).unwrap_or(f64::NAN) / (0.674 * 2.0_f64.sqrt());
        let noise = noise.max(if step.is_finite() { step / 12.0_f64.sqrt() } else { 0.0 });
        let means =
            column.chunks_exact(length).map(|part| part.iter().sum::<f64>() / length as f64);
        let (low, high) = means.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), mean| {
            (low.min(mean), high.max(mean))
        });
        all += 1;
        size += 0.25 * (low + high).powi(2);
        if high - low > MOVED_STD * noise * (2.0 / length as f64).sqrt() {
            moved += 1;
            // a floating measurement has moved by less than its noise
            change += (high - low).powi(2);
        }
    }
    let change = (change / size.max(f64::MIN_POSITIVE)).sqrt();
    (moved as f64 > MOVED * all as f64 && change > CHANGED).then_some(change)
}

/// Describes [`unrest`] in words.
pub(crate) fn description(change: f64) -> String {
    format!(
        "the reference frames change by {:.1} % of the voltages, far more than noise: the skin was touched or let go \
         meanwhile, and touches may be missed or shown where there is none; take the reference from the untouched skin",
        100.0 * change
    )
}

fn root_mean_square(values: impl Iterator<Item = f64>) -> f64 {
    let (count, squares) = values.fold((0.0_f64, 0.0), |(n, sum), v| (n + 1.0, sum + v * v));
    (squares / count.max(1.0)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use eit_core::Random;
    use ndarray::Array2;

    const NOISE: f64 = 1e-4;

    /// Forty frames of 50 voltages between 0.2 and 1, with noise.
    fn frames(random: &mut Random) -> Array2<f64> {
        let level: Vec<f64> = (0..50).map(|_| random.between(0.2, 1.0)).collect();
        Array2::from_shape_fn((40, 50), |(_, i)| level[i] + NOISE * random.normal())
    }

    #[test]
    fn frames_of_another_kind_are_found() {
        let mut random = Random::new(3);
        let mut values = frames(&mut random);
        values.row_mut(10).fill(0.0);
        values.row_mut(20).mapv_inplace(|v| 10.0 * v);
        values.row_mut(30).fill(f64::NAN);
        // a single wrong value, and measurements that float, are no reason
        values[(5, 3)] = 7.0;
        for i in 40..50 {
            values.column_mut(i).mapv_inplace(|_| 0.3 * random.normal());
        }
        assert_eq!(others(values.view(), |_, _| true), [10, 20, 30]);
        assert_eq!(unrest(frames(&mut random).view(), |_, _| true), None);
    }

    /// A finger that lands, one that lifts and one that taps are told from noise, rounding and drift.
    #[test]
    fn a_finger_is_told_from_drift() {
        let mut random = Random::new(4);
        let change: Vec<f64> = (0..50).map(|_| 3e-3 * random.normal()).collect();
        for pressed in [15..40, 0..27, 12..22] {
            let mut values = frames(&mut random);
            for f in pressed.clone() {
                values.row_mut(f).iter_mut().zip(&change).for_each(|(v, c)| *v += c);
            }
            let found = unrest(values.view(), |_, _| true);
            assert!(
                found.is_some_and(|part| (1e-3..1e-2).contains(&part)),
                "{pressed:?} {found:?}"
            );
        }
        for step in [0.0, 1e-3] {
            let mut values = frames(&mut random);
            for (f, mut row) in values.rows_mut().into_iter().enumerate() {
                let drift = 1.0 + 5e-4 * f as f64 / 40.0;
                let rounded = |v: f64| if step > 0.0 { step * (v / step).round() } else { v };
                row.mapv_inplace(|v| rounded(drift * v));
            }
            assert_eq!(unrest(values.view(), |_, _| true), None, "{step}");
        }
    }
}
