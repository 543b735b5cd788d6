//! The frames of a sequence that need a solve: those that are not quiet, or their mean if all are equal.

use crate::noise::DataNoise;
use eit_inverse::InverseError;
use ndarray::{Array1, Array2, Axis};

/// Selected frames of a sequence.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    /// Their indices.
    pub frames: Vec<usize>,
    /// [frame, measurement], or one row if one image serves all.
    pub values: Array2<f64>,
    /// Whether each value is good; same shape as the values.
    pub good: Array2<bool>,
}

impl Part {
    pub(crate) fn new(values: &Array2<f64>, good: &Array2<bool>, quiet: &[bool]) -> Self {
        let frames: Vec<usize> = (0..quiet.len()).filter(|&f| !quiet[f]).collect();
        let (values, good) = (values.select(Axis(0), &frames), good.select(Axis(0), &frames));
        Self { frames, values, good }
    }

    /// Mean over the good values of each measurement, and whether there are any.
    fn mean(&self) -> (Array1<f64>, Array1<bool>) {
        let count = self.good.map_axis(Axis(0), |g| g.iter().filter(|good| **good).count());
        // values that are not good are zero
        let sum = self.values.sum_axis(Axis(0));
        let mean = ndarray::Zip::from(&sum).and(&count).map_collect(|s, &n| s / n.max(1) as f64);
        (mean, count.mapv(|n| n > 0))
    }

    /// Whether there are several frames that do not differ from their mean beyond noise: the sum of the
    /// squared differences in units of the noise exceeds its degrees of freedom by at most three standard
    /// deviations.
    pub(crate) fn is_still(&self, noise: &DataNoise) -> bool {
        if self.frames.len() < 2 {
            return false;
        }
        let (mean, std) = (self.mean().0, noise.of_frames());
        let (mut square, mut freedom) = (0.0, 0.0);
        for ((_, i), value) in self.values.indexed_iter().filter(|(at, _)| self.good[*at]) {
            square += ((value - mean[i]) / std[i]).powi(2);
            freedom += 1.0;
        }
        freedom *= 1.0 - 1.0 / self.frames.len() as f64;
        square <= freedom + 3.0 * (2.0_f64 * freedom).sqrt()
    }

    /// Converts frame numbers in an error from this selection to the whole recording.
    pub(crate) fn of_recording(&self, error: InverseError) -> InverseError {
        let number = |frame: usize| self.frames.get(frame).copied().unwrap_or(frame);
        match error {
            InverseError::DeltaTooSmall { frame, delta, least } => {
                InverseError::DeltaTooSmall { frame: number(frame), delta, least }
            }
            InverseError::DeltaTooSmallWithinBounds { frame, delta, least, lower_s, upper_s } => {
                let frame = number(frame);
                InverseError::DeltaTooSmallWithinBounds { frame, delta, least, lower_s, upper_s }
            }
            InverseError::NonFiniteData { frame, measurement, value } => {
                InverseError::NonFiniteData { frame: number(frame), measurement, value }
            }
            other => other,
        }
    }

    /// Replaces all rows by their mean.
    pub(crate) fn take_mean(&mut self) {
        let (mean, good) = self.mean();
        self.values = mean.insert_axis(Axis(0));
        self.good = good.insert_axis(Axis(0));
    }
}
