//! Rows of the detector: a measurement and its reciprocal form one row.

use crate::InverseError;
use crate::check::check_finite;
use eit_core::median;
use ndarray::ArrayRef2;

/// Rows of the detector: each is the mean of a measurement and its reciprocal, or a single measurement.
#[derive(Debug, Clone)]
pub(in crate::touch) struct Rows {
    /// Measurements of each row; the same index twice if there is no reciprocal.
    pub(in crate::touch) of: Vec<[usize; 2]>,
    /// Measured over modelled voltage of each measurement, which scales its derivatives; where magnitudes are measured,
    /// with the sign of the model's voltage.
    pub(in crate::touch) ratio: Vec<f64>,
}

/// Why a reference differs from the model's voltages: `v_ref / g = v (1 + gain) + error`.
///
/// A gain of a channel scales the change by a touch as well; an error of the model, due to the mesh, contacts or the
/// sheet, does not, and on a small voltage it looks like a large gain. Both standard deviations are those of greatest
/// likelihood on a grid.
#[derive(Debug, Clone, Copy)]
struct Mismatch {
    gain: f64,
    error_v: f64,
}

impl Mismatch {
    /// `pairs`: voltages of the model and of the reference.
    fn of(pairs: impl Iterator<Item = [f64; 2]>) -> Self {
        let pairs: Vec<[f64; 2]> = pairs.collect();
        let median_v = median(pairs.iter().map(|[v, _]| v.abs())).unwrap_or(0.0);
        // a factor of two from one to the next, down to 1e-5
        let steps = || (0..17).map(|k| 0.5_f64.powi(k));
        let grid = steps().flat_map(|gain| steps().map(move |error| (gain, error * median_v)));
        let cost = |&(gain, error_v): &(f64, f64)| {
            let of = |[v, of_reference]: &[f64; 2]| {
                let variance = (gain * v).powi(2) + error_v * error_v;
                variance.ln() + (of_reference - v).powi(2) / variance
            };
            pairs.iter().map(of).sum::<f64>()
        };
        let best = grid.min_by(|a, b| cost(a).total_cmp(&cost(b)));
        let (gain, error_v) = best.unwrap_or((1.0, 0.0));
        Self { gain, error_v }
    }

    /// Expected part of a mismatch that is due to the gain.
    fn share_of_gain(&self, voltage_v: f64) -> f64 {
        let [of_gain, of_error] = [self.gain * voltage_v, self.error_v].map(|s| s * s);
        of_gain / (of_gain + of_error).max(f64::MIN_POSITIVE)
    }
}

/// Fraction of the median voltage above which the sign of the model's voltage is certain.
const CLEAR: f64 = 0.1;

/// Whether a reference holds magnitudes of voltages of both signs. `pairs`: voltages of the model and of the reference.
fn are_sizes(pairs: impl Iterator<Item = [f64; 2]> + Clone) -> bool {
    let clear_v = CLEAR * median(pairs.clone().map(|[v, _]| v.abs())).unwrap_or(0.0);
    pairs.clone().all(|[_, of_reference]| of_reference >= 0.0) && {
        let (mut above, mut below) = (pairs.clone(), pairs);
        above.any(|[v, _]| v > clear_v) && below.any(|[v, _]| v < -clear_v)
    }
}

/// Ratios that differ from the median by more than this factor are replaced by the median: the voltage is
/// too small to tell.
const RATIO_RANGE: f64 = 3.0;

impl Rows {
    /// Builds the rows of the used measurements from the index of each one's reciprocal (its own index if
    /// it has none).
    pub(in crate::touch) fn new(
        reciprocal: &[usize],
        used: &[bool],
        reference_v: &[f64],
        model_v: &[f64],
    ) -> Result<Self, InverseError> {
        let is_pair = |i: usize| {
            let twin = reciprocal[i];
            twin != i && twin < used.len() && used[twin] && reciprocal[twin] == i
        };
        let of: Vec<[usize; 2]> = (0..used.len())
            .filter(|&i| used[i])
            .filter_map(|i| match is_pair(i) {
                true if reciprocal[i] > i => Some([i, reciprocal[i]]),
                true => None,
                false => Some([i, i]),
            })
            .collect();
        if of.is_empty() {
            return Err(InverseError::NothingUsed { measurements: used.len() });
        }
        // an instrument that gives magnitudes: each changes with the sign of its voltage
        let are_sizes = are_sizes(of.iter().flatten().map(|&i| [model_v[i], reference_v[i]]));
        let sign_of = |i: usize| if are_sizes { 1.0_f64.copysign(model_v[i]) } else { 1.0 };
        let ratio_of = |i: usize| sign_of(i) * reference_v[i] / model_v[i];
        let known = of.iter().flatten().map(|&i| ratio_of(i)).filter(|r| r.is_finite());
        let median = median(known).unwrap_or(1.0);
        let within = |r: f64| (RATIO_RANGE.recip()..=RATIO_RANGE).contains(&(r / median));
        let pairs = of.iter().flatten().filter(|&&i| within(ratio_of(i)));
        let mismatch =
            Mismatch::of(pairs.map(|&i| [model_v[i], sign_of(i) * reference_v[i] / median]));
        let ratio = (0..used.len()).map(|i| match used[i] && within(ratio_of(i)) {
            true => {
                let share = mismatch.share_of_gain(model_v[i]);
                sign_of(i) * (median + share * (ratio_of(i) - median))
            }
            false if used[i] => sign_of(i) * median,
            false => median,
        });
        Ok(Self { ratio: ratio.collect(), of })
    }

    /// Median size of the ratios of measured to modelled voltage.
    pub(in crate::touch) fn gain(&self) -> f64 {
        median(self.ratio.iter().map(|ratio| ratio.abs())).unwrap_or(f64::NAN)
    }

    /// Factor for the model's derivatives of one row.
    pub(in crate::touch) fn ratio_of_row(&self, row: usize) -> f64 {
        let [i, j] = self.of[row];
        0.5 * (self.ratio[i] + self.ratio[j])
    }

    /// Checks both measurements of each row; unused measurements are not read.
    pub(super) fn check_finite(&self, derivatives: &ArrayRef2<f64>) -> Result<(), InverseError> {
        let mut used = self.of.iter().flatten();
        used.try_for_each(|&measurement| check_finite(measurement, derivatives.row(measurement)))
    }

    /// Mean of a model's derivatives with respect to one unknown of both measurements of a row, scaled by their ratios.
    pub(super) fn scaled_mean(&self, row: usize, derivative: impl Fn(usize) -> f64) -> f64 {
        let [first, second] = self.of[row].map(|i| self.ratio[i] * derivative(i));
        0.5 * (first + second)
    }

    /// Averages values `[measurement]` into rows.
    pub(super) fn fold(&self, values: &[f64], rows: &mut [f64]) {
        for (row, &[i, j]) in rows.iter_mut().zip(&self.of) {
            *row = 0.5 * (values[i] + values[j]);
        }
    }

    /// Averages the values that are present into rows; a row without any becomes zero and is listed in
    /// `lost`.
    pub(super) fn fold_present(
        &self,
        values: &[f64],
        missing: &[bool],
        rows: &mut [f64],
        lost: &mut Vec<usize>,
    ) {
        lost.clear();
        for (k, (row, &[i, j])) in rows.iter_mut().zip(&self.of).enumerate() {
            *row = match (missing[i], missing[j]) {
                (false, false) => 0.5 * (values[i] + values[j]),
                (false, true) => values[i],
                (true, false) => values[j],
                (true, true) => {
                    lost.push(k);
                    0.0
                }
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fixtures::Random;

    /// 200 voltages over three decades, and a reference with this gain (logarithm) and error of its channels.
    fn rows(gain: f64, error_v: f64) -> (Rows, Vec<f64>) {
        let mut random = Random::new(8);
        let model_v: Vec<f64> =
            (0..200).map(|i| 10.0_f64.powf(-3.0 * f64::from(i) / 200.0)).collect();
        let gains: Vec<f64> =
            model_v.iter().map(|_| 2.0 * (gain * random.normal()).exp()).collect();
        let reference_v: Vec<f64> =
            model_v.iter().zip(&gains).map(|(v, g)| g * (v + error_v * random.normal())).collect();
        let alone: Vec<usize> = (0..200).collect();
        (Rows::new(&alone, &[true; 200], &reference_v, &model_v).unwrap(), gains)
    }

    /// Largest relative error of the ratios as estimates of the gains.
    fn error(gain: f64, error_v: f64) -> f64 {
        let (rows, gains) = rows(gain, error_v);
        let errors = rows.ratio.iter().zip(&gains).map(|(ratio, gain)| (ratio / gain - 1.0).abs());
        errors.fold(0.0, f64::max)
    }

    /// Gains are taken over as they are; errors of the model, which on the smallest voltages look like factors of up to
    /// three, are not; of both, each voltage takes over what its gain explains.
    #[test]
    fn gains_are_told_from_errors() {
        assert!(error(0.2, 0.0) < 1e-3);
        // the median of 200 ratios
        assert!(error(0.0, 3e-3) < 2e-2);
        // where the error hides it, a gain is not taken over: the largest of 200 with a deviation of 5 % is some 15 %
        assert!(error(0.05, 1e-3) < 0.2);
    }

    /// Magnitudes have the gains of the voltages, with the signs of the model. One small voltage of another sign than the
    /// model's does not make magnitudes of the others.
    #[test]
    fn magnitudes_take_the_signs_of_the_model() {
        let alone: Vec<usize> = (0..40).collect();
        let size = |i: usize| 1.0 + 0.01 * i as f64;
        let signed: Vec<f64> =
            (0..40).map(|i| if i % 3 == 0 { -size(i) } else { size(i) }).collect();
        let measured: Vec<f64> = (0..40).map(|i| 2.0 * size(i)).collect();
        let rows = Rows::new(&alone, &[true; 40], &measured, &signed).unwrap();
        // rounding
        let is_right = |(ratio, v): (&f64, &f64)| (ratio - 2.0 * v.signum()).abs() < 1e-12;
        assert!(rows.ratio.iter().zip(&signed).all(is_right), "{:?}", rows.ratio);
        assert!((rows.gain() - 2.0).abs() < 1e-12);
        let mut nearly: Vec<f64> = (0..40).map(size).collect();
        nearly[7] = -0.05;
        let rows = Rows::new(&alone, &[true; 40], &measured, &nearly).unwrap();
        assert!(rows.ratio.iter().all(|ratio| (ratio - 2.0).abs() < 1e-12), "{:?}", rows.ratio);
    }
}
