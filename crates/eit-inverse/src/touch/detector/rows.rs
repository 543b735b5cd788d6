//! Measurements as rows: a measurement and its reciprocal are one.

use crate::InverseError;

/// Rows of the detector: each the mean of a measurement and its reciprocal, or one measurement.
#[derive(Debug, Clone)]
pub(super) struct Rows {
    /// Measurements of each row; twice the same where there is no reciprocal.
    pub(super) of: Vec<[usize; 2]>,
    /// Measured over modelled voltage of each measurement: what its derivatives are multiplied by.
    pub(super) ratio: Vec<f64>,
}

/// Ratios beyond this factor of their median are taken to be the median: the voltage is too small to
/// say.
const RATIO_RANGE: f64 = 3.0;

impl Rows {
    /// For measurements that are used, with the index of each one's reciprocal (its own where there
    /// is none).
    pub(super) fn new(
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
        let ratio_of = |i: usize| reference_v[i] / model_v[i];
        let mut known: Vec<f64> =
            of.iter().flatten().map(|&i| ratio_of(i)).filter(|r| r.is_finite()).collect();
        known.sort_unstable_by(f64::total_cmp);
        let median = known.get(known.len() / 2).copied().unwrap_or(1.0);
        let within = |r: f64| (RATIO_RANGE.recip()..=RATIO_RANGE).contains(&(r / median));
        let ratio = (0..used.len())
            .map(|i| Some(ratio_of(i)).filter(|r| used[i] && within(*r)).unwrap_or(median))
            .collect();
        Ok(Self { of, ratio })
    }

    /// Median of measured over modelled voltages.
    pub(super) fn gain(&self) -> f64 {
        let mut sorted = self.ratio.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        sorted[sorted.len() / 2]
    }

    /// What a row of derivatives of the model is multiplied by.
    pub(super) fn ratio_of_row(&self, row: usize) -> f64 {
        let [i, j] = self.of[row];
        0.5 * (self.ratio[i] + self.ratio[j])
    }

    /// Mean of a value of each measurement.
    pub(super) fn fold(&self, values: &[f64], rows: &mut [f64]) {
        for (row, &[i, j]) in rows.iter_mut().zip(&self.of) {
            *row = 0.5 * (values[i] + values[j]);
        }
    }

    /// The same over the measurements that are there; rows without any are zero and listed.
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
