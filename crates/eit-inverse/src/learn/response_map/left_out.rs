//! Presses that are left out, and what the others predict of them.

use crate::InverseError;
use crate::learn::linear::product;
use crate::learn::presses::ModelResponses;
use crate::learn::process::{GainSums, Process};
use ndarray::{Array1, Array2, ArrayRef2, Axis};

/// Largest squared ratio of the typical press to another one.
const WEAKEST: f64 = 10.0;
/// Most folds of the cross-validation.
const FOLDS: usize = 10;
/// Range of the refitted lengths.
const LENGTH_RANGE: [f64; 2] = [0.3, 1.5];

/// Presses of length about 1, and the model's responses of length 1.
#[derive(Debug, Clone)]
pub(super) struct Data {
    pub(super) shapes: Array2<f64>,
    pub(super) model: Array2<f64>,
    pub(super) model_at_places: Array2<f64>,
    pub(super) relative2: Vec<f64>,
}

/// What presses that are left out are predicted to be, and the variance of that.
pub(super) struct LeftOut {
    pub(super) predicted: Array2<f64>,
    pub(super) variance: Vec<f64>,
}

impl Data {
    /// Presses and the model in units of the scales. `unit`: length of the median press.
    pub(super) fn new(
        changes: &Array2<f64>,
        scale: &[f64],
        unit: f64,
        model: &ModelResponses,
    ) -> Self {
        let scale = Array1::from_iter(scale.iter().copied());
        let (shapes, lengths) = unit_rows(changes);
        let relative2 = lengths.iter().map(|length| (unit / length).powi(2).min(WEAKEST));
        Self {
            shapes,
            model: unit_rows(&(&model.at_presses / &scale)).0,
            model_at_places: unit_rows(&(&model.at_candidates / &scale)).0,
            relative2: relative2.collect(),
        }
    }

    /// Some of the presses, without the model at places.
    pub(super) fn select(&self, which: &[usize]) -> Self {
        Self {
            shapes: self.shapes.select(Axis(0), which),
            model: self.model.select(Axis(0), which),
            model_at_places: Array2::zeros((0, self.model.ncols())),
            relative2: which.iter().map(|&k| self.relative2[k]).collect(),
        }
    }

    /// Predicts every press from those of the other folds.
    pub(super) fn left_out(
        &self,
        process: &Process,
        pull: Option<f64>,
    ) -> Result<LeftOut, InverseError> {
        let presses = self.shapes.nrows();
        let [of_shapes, of_model] =
            [&self.shapes, &self.model].map(|rows| product(&process.inverse, rows));
        let sums = GainSums::new(&self.shapes, &self.model);
        let (mut predicted, mut variance) = (self.shapes.clone(), vec![0.0; presses]);
        for fold in folds(presses, presses) {
            let gains = sums.without(&self.shapes, &self.model, &fold, pull);
            let own = process.left_out(&fold)?;
            let weights =
                of_shapes.select(Axis(0), &fold) - &(of_model.select(Axis(0), &fold) * &gains);
            let rest = own.dot(&weights);
            for ((row, &press), left) in rest.rows().into_iter().zip(&fold).zip(own.diag()) {
                let mut predicted = predicted.row_mut(press);
                predicted -= &row;
                variance[press] = *left;
            }
        }
        Ok(LeftOut { predicted, variance })
    }

    /// Refits the lengths of the presses to what the others predict.
    pub(super) fn refit_lengths(&mut self, left: &LeftOut) {
        let ratios = self.shapes.rows().into_iter().zip(left.predicted.rows());
        let [low, high] = LENGTH_RANGE;
        let ratios = ratios.map(|(u, p)| (u.dot(&p) / u.dot(&u)).clamp(low, high));
        let mut ratios: Array1<f64> = ratios.collect();
        ratios /= ratios.mapv(f64::ln).mean().unwrap_or(0.0).exp();
        self.shapes *= &ratios.insert_axis(Axis(1));
    }
}

impl LeftOut {
    /// Predictive log likelihood with a variance per channel, up to a constant.
    pub(super) fn score(&self, shapes: &Array2<f64>) -> f64 {
        let (presses, channels) = shapes.dim();
        let mut squares = (shapes - &self.predicted).mapv(|v| v * v);
        squares /= &Array1::from_iter(self.variance.iter().copied()).insert_axis(Axis(1));
        let of_channel = squares.sum_axis(Axis(0)) / presses as f64;
        let mean = of_channel.mean().unwrap_or(0.0);
        let channel_ln: f64 = of_channel.iter().map(|v| (v + 1e-3 * mean).ln()).sum();
        let variance_ln: f64 = self.variance.iter().map(|v| v.ln()).sum();
        -0.5 * (presses as f64 * channel_ln + channels as f64 * variance_ln)
    }
}

/// Some of the presses, evenly chosen in order of time and dealt to at most ten folds.
pub(crate) fn folds(presses: usize, most: usize) -> Vec<Vec<usize>> {
    let held = presses.min(most);
    let count = held.min(FOLDS);
    let all: Vec<usize> = (0..held).map(|k| k * presses / held.max(1)).collect();
    (0..count).map(|fold| all.iter().skip(fold).step_by(count).copied().collect()).collect()
}

/// Scales rows to length 1, leaving rows of zeros unchanged, and returns their lengths.
pub(in crate::learn) fn unit_rows(rows: &ArrayRef2<f64>) -> (Array2<f64>, Vec<f64>) {
    let lengths: Vec<f64> = rows.rows().into_iter().map(|row| row.dot(&row).sqrt()).collect();
    let mut unit = rows.to_owned();
    for (mut row, length) in unit.rows_mut().into_iter().zip(&lengths) {
        row /= length.max(f64::MIN_POSITIVE);
    }
    (unit, lengths)
}
