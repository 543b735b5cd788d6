//! Covariances of few rows, and quantiles of what they imply.

use super::linear::eigen;
use crate::InverseError;
use ndarray::{Array1, Array2, Axis};
use statrs::distribution::{ChiSquared, ContinuousCDF, FisherSnedecor};

/// Rows of a typical variance that are added to those of each channel.
const TYPICAL_ROWS: f64 = 4.0;
/// Factor above the largest eigenvalue that chance makes (Marchenko, Pastur) from which a common factor is believed.
const ABOVE_CHANCE: f64 = 1.1;
/// Least part of a channel's variance that is its own.
const LEAST_OWN: f64 = 0.1;
/// Prior of a tail: so many values above the median, which exceed it by this much in the mean (chance: 2).
const TAIL_VALUES: f64 = 3.0;
const TAIL_MEAN: f64 = 8.0;

/// A covariance matrix, and the part of its diagonal in which channels vary independently.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Covariance {
    pub(crate) all: Array2<f64>,
    pub(crate) own: Array1<f64>,
}

impl Covariance {
    /// Returns it multiplied by a factor.
    pub(crate) fn scaled(&self, factor: f64) -> Self {
        Self { all: &self.all * factor, own: &self.own * factor }
    }
}

/// Returns the covariance of rows of mean zero, `[row, channel]`: the variances, and those common factors of the
/// correlations that chance does not make, with their sizes corrected for it. A `prior` counts as so many further rows.
///
/// ```text
/// keep l > 1.1 (1 + sqrt(g))^2,  g = channels / rows;   true size (l + 1 - g + sqrt((l + 1 - g)^2 - 4 l)) / 2
/// ```
///
/// Source: Baik, Silverstein, *J. Multivariate Anal.* 97 (2006), 1382-1408 (spiked model).
///
/// # Errors
/// [`InverseError::Factorisation`] for rows that are not finite.
pub(crate) fn shrunk(
    rows: &Array2<f64>,
    prior: Option<(&Covariance, f64)>,
) -> Result<Covariance, InverseError> {
    let (count, channels) = (rows.nrows(), rows.ncols());
    if count == 0 {
        let none = Array2::zeros((channels, channels));
        let none = Covariance { all: none, own: Array1::zeros(channels) };
        return Ok(prior.map_or(none, |(prior, _)| prior.clone()));
    }
    let k = count as f64;
    let mut variance = (rows * rows).sum_axis(Axis(0)) / k + 1e-12;
    let typical = eit_core::median(variance.iter().copied()).unwrap_or(0.0);
    variance.mapv_inplace(|v| (k * v + TYPICAL_ROWS * typical) / (k + TYPICAL_ROWS));
    let deviation = variance.mapv(f64::sqrt);
    let factors = common_factors(&(rows / &deviation))?;
    let mut all = factors.t().dot(&factors);
    let own = all.diag().mapv(|common| (1.0 - common).max(LEAST_OWN));
    for ((i, j), value) in all.indexed_iter_mut() {
        *value = deviation[i] * deviation[j] * (*value + if i == j { own[i] } else { 0.0 });
    }
    let mut own = own * variance;
    if let Some((prior, weight)) = prior {
        all = (all * k + &prior.all * weight) / (k + weight);
        own = (own * k + &prior.own * weight) / (k + weight);
    }
    Ok(Covariance { all, own })
}

/// Common factors of rows of variance 1, `[factor, channel]`; from the smaller of the two Gram matrices.
fn common_factors(rows: &Array2<f64>) -> Result<Array2<f64>, InverseError> {
    let (count, channels) = rows.dim();
    let gamma = channels as f64 / count as f64;
    let least = (1.0 + gamma.sqrt()).powi(2) * ABOVE_CHANCE;
    let is_wide = count < channels;
    let gram = if is_wide { rows.dot(&rows.t()) } else { rows.t().dot(rows) };
    let (values, vectors) = eigen(&(gram / count as f64), "correlations of channels")?;
    let kept: Vec<usize> = (0..values.len()).filter(|&i| values[i] > least).collect();
    let mut factors = Array2::zeros((kept.len(), channels));
    for (mut factor, &i) in factors.rows_mut().into_iter().zip(&kept) {
        let vector = vectors.column(i);
        match is_wide {
            // the eigenvector of the other Gram matrix
            true => factor.assign(&(rows.t().dot(&vector) / (values[i] * count as f64).sqrt())),
            false => factor.assign(&vector),
        }
        let sum = values[i] + 1.0 - gamma;
        let size = 0.5 * (sum + (sum * sum - 4.0 * values[i]).max(0.0).sqrt());
        factor *= (size - 1.0).max(0.0).sqrt();
    }
    Ok(factors)
}

/// Returns the value that ones like these exceed with a probability: exponential above their median.
pub(crate) fn tail_level(values: &[f64], probability: f64) -> f64 {
    let middle = eit_core::median(values.iter().map(|v| v.max(0.0))).unwrap_or(0.0);
    let above: Vec<f64> = values.iter().map(|v| v - middle).filter(|over| *over > 0.0).collect();
    let mean =
        (above.iter().sum::<f64>() + TAIL_VALUES * TAIL_MEAN) / (above.len() as f64 + TAIL_VALUES);
    middle + mean * (0.5 / probability.min(0.5)).ln()
}

/// Returns the value that a chi-square variable of one degree of freedom exceeds with a probability.
pub(crate) fn chi_square_level(probability: f64) -> f64 {
    ChiSquared::new(1.0).map_or(f64::INFINITY, |chi| chi.inverse_cdf(1.0 - probability))
}

/// Returns the value that a variable of the F distribution exceeds with a probability.
pub(crate) fn f_level(probability: f64, degrees: f64, of_scale: f64) -> f64 {
    FisherSnedecor::new(degrees, of_scale)
        .map_or(f64::INFINITY, |f| f.inverse_cdf(1.0 - probability))
}

#[cfg(test)]
mod tests {
    use super::*;
    use fixtures::Random;

    /// Rows with two common factors: both Gram matrices give the same, and each entry is within five of its standard
    /// errors; without common factors none is found.
    #[test]
    fn common_factors_are_found_and_no_others() {
        let mut random = Random::new(7);
        let rows = 400;
        let channels = 60;
        let factors = Array2::from_shape_fn((2, channels), |_| random.normal());
        let noise = Array2::from_shape_fn((rows, channels), |_| random.normal());
        let size = Array2::from_shape_fn((rows, 2), |_| random.normal());
        let found = shrunk(&(size.dot(&factors) + &noise), None).unwrap();
        let wanted = factors.t().dot(&factors) + Array2::<f64>::eye(channels);
        for ((i, j), value) in found.all.indexed_iter() {
            let spread = (wanted[[i, i]] * wanted[[j, j]] + wanted[[i, j]].powi(2)).sqrt();
            let error = (value - wanted[[i, j]]).abs() / (spread / (rows as f64).sqrt());
            assert!(error < 5.0, "{i} {j}: {value} for {}", wanted[[i, j]]);
        }
        let none = shrunk(&noise, None).unwrap();
        let crossed = none.all.indexed_iter().filter(|((i, j), _)| i != j);
        assert!(crossed.into_iter().all(|(_, value)| *value == 0.0));
        // fewer rows than channels: the other Gram matrix
        let few = (size.dot(&factors) * 3.0 + &noise).select(Axis(0), &(0..30).collect::<Vec<_>>());
        let wide = common_factors(&few).unwrap();
        let (values, vectors) = eigen(&(few.t().dot(&few) / 30.0), "all").unwrap();
        assert!(wide.nrows() >= 2);
        for (k, factor) in wide.rows().into_iter().rev().enumerate() {
            let at = channels - 1 - k;
            let along = factor.dot(&vectors.column(at));
            let sum = values[at] - 1.0;
            let size = 0.5 * (sum + (sum * sum - 4.0 * values[at]).max(0.0).sqrt());
            assert!((along * along - (size - 1.0)).abs() < 1e-9 * values[at], "{along} {size}");
        }
    }

    /// Levels of known distributions: tables of chi-square and F; an exponential tail of mean 2.
    #[test]
    fn levels_are_those_of_tables() {
        assert!((chi_square_level(0.05) - 3.841).abs() < 1e-3);
        assert!((chi_square_level(1e-7) - 28.37).abs() < 0.01);
        assert!((f_level(1e-3, 120.0, 4.0) - 44.40).abs() < 0.01);
        let values: Vec<f64> =
            (0..20_000).map(|i| -2.0 * (1.0 - (f64::from(i) + 0.5) / 20_000.0).ln()).collect();
        assert!((tail_level(&values, 1e-3) - 2.0 * 1000.0_f64.ln()).abs() < 0.1);
    }
}
