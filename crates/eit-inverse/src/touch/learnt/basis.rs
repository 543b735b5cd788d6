//! Bases in which the covariances of background and errors are diagonal.

use crate::InverseError;
use crate::learn::{Covariance, eigen, inverse_of_factor};
use ndarray::{Array2, ArrayView1, Axis};

/// Values that are computed side by side; rows are padded to a multiple with what contributes nothing.
pub(super) const LANES: usize = 8;

/// Rows of responses in the basis, each padded to `width`.
#[derive(Debug, Clone)]
pub(super) struct Basis {
    /// Channels that count.
    pub(super) channels: Vec<usize>,
    pub(super) width: usize,
    /// `W`, `[row, channel]`, and the variances `lambda` of an error of variance 1, padded with 0.
    turn: Array2<f64>,
    pub(super) lambda: Vec<f64>,
    /// The same for the errors of single channels.
    turn_single: Array2<f64>,
    lambda_single: Vec<f64>,
    /// Responses of strength 1, `[place][row]`, padded with 0.
    pub(super) responses: Vec<f64>,
    /// Median squared length of the responses at coarse places.
    pub(super) typical2: f64,
}

impl Basis {
    /// Of responses `[place, channel]` and their error, both for length 1, against a background `[channel, channel]`.
    pub(super) fn new(
        responses: &Array2<f64>,
        error: &Covariance,
        unit: f64,
        background: &Array2<f64>,
        channels: &[usize],
        coarse: &[usize],
    ) -> Result<Self, InverseError> {
        let low = inverse_of_factor(background, "background of a learnt skin")?;
        let whole = low.dot(&error.all).dot(&low.t()) * (unit * unit);
        let single = (&low * &error.own).dot(&low.t()) * (unit * unit);
        let width = channels.len().next_multiple_of(LANES);
        let solve = |covariance: &Array2<f64>| {
            let (values, vectors) = eigen(covariance, "errors of a learnt skin")?;
            let mut lambda: Vec<f64> = values.into_iter().map(|v| v.max(0.0)).collect();
            lambda.resize(width, 0.0);
            Ok::<_, InverseError>((vectors.t().dot(&low), lambda))
        };
        let ((turn, lambda), (turn_single, lambda_single)) = (solve(&whole)?, solve(&single)?);
        let turned = responses.dot(&turn.t()) * unit;
        let mut padded = vec![0.0; responses.nrows() * width];
        for (to, row) in padded.chunks_exact_mut(width).zip(turned.rows()) {
            to.iter_mut().zip(row).for_each(|(to, value)| *to = *value);
        }
        let squares = (&turned * &turned).sum_axis(Axis(1));
        let typical2 = eit_core::median(coarse.iter().map(|&k| squares[k]));
        Ok(Self {
            channels: channels.to_vec(),
            width,
            turn,
            lambda,
            turn_single,
            lambda_single,
            responses: padded,
            typical2: typical2.unwrap_or(1.0).max(f64::MIN_POSITIVE),
        })
    }

    /// Response of strength 1 at a place, `[row]`.
    pub(super) fn response(&self, place: usize) -> &[f64] {
        &self.responses[place * self.width..(place + 1) * self.width]
    }

    /// Replaces the responses, of length 1, for as long as they are those without some presses.
    pub(super) fn with_responses(&self, responses: &Array2<f64>, unit: f64) -> Self {
        let turned = responses.dot(&self.turn.t()) * unit;
        let mut made = self.clone();
        for (to, row) in made.responses.chunks_exact_mut(self.width).zip(turned.rows()) {
            to.iter_mut().zip(row).for_each(|(to, value)| *to = *value);
        }
        made
    }

    /// `W d` of a difference over all channels, padded.
    pub(super) fn turn(&self, difference: &[f64], out: &mut [f64]) {
        turn(&self.turn, &self.channels, difference, out);
    }

    /// Least -2 log likelihood of a difference without a touch, but with as much change of single channels, independent
    /// of each other, as is best, up to a constant; `work` has the width.
    pub(super) fn without_touch(&self, difference: &[f64], freedom: f64, work: &mut [f64]) -> f64 {
        turn(&self.turn_single, &self.channels, difference, work);
        let count = self.channels.len();
        let factors = (-14..=4).map(|power| 2.0_f64.powi(power)).chain([0.0]);
        let of = |factor: f64| {
            let (mut square, mut logarithm) = (0.0, 0.0);
            for (z, lambda) in work[..count].iter().zip(&self.lambda_single) {
                let variance = 1.0 + factor * lambda;
                square += z * z / variance;
                logarithm += variance.ln();
            }
            minus2(square, logarithm, count, freedom)
        };
        factors.map(of).fold(f64::INFINITY, f64::min)
    }
}

/// -2 log likelihood of Student's distribution up to a constant, from a whitened squared length and the logarithm of
/// the determinant.
pub(super) fn minus2(square: f64, logarithm: f64, channels: usize, freedom: f64) -> f64 {
    (freedom + channels as f64) * (square / freedom).ln_1p() + logarithm
}

fn turn(rows: &Array2<f64>, channels: &[usize], difference: &[f64], out: &mut [f64]) {
    out.fill(0.0);
    for (out, row) in out.iter_mut().zip(rows.rows()) {
        *out = product(row, channels, difference);
    }
}

fn product(row: ArrayView1<'_, f64>, channels: &[usize], difference: &[f64]) -> f64 {
    row.iter().zip(channels).map(|(w, &channel)| w * difference[channel]).sum()
}
