//! Force in newtons from the strength of a touch and its position.
//!
//! ```text
//! ln F = b0 + b1 u + b2 u^2 + b3 r^2 + b4 r^4 + b5 x + b6 y,    u = ln(strength / median strength)
//! ```
//!
//! `x`, `y`, `z` are distances from the centre of the skin as fractions of its radius, and
//! `r^2 = x^2 + y^2 + z^2`, at most 1: the response of a sheet depends on the position even after the
//! model's correction of the strength. The median is that of the learnt strengths.
//!
//! Seven sets of terms are tried, from `b0 + b1 u` to all of them, each term with a ridge. A set is
//! accepted if its leave-one-out error is below 0.95 of the best so far. Force must increase with strength:
//! a set whose slope in `u` is below 0.05 anywhere in the learnt range is rejected. If even the straight
//! line `b0 + b1 u` is flatter than that (forces that do not follow the strengths), its slope is set to
//! 0.05, and the error shows how little is known. Beyond the learnt strengths the curve continues along its
//! tangent, and its standard deviation grows.

use super::choose::quantile;
use crate::InverseError;
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};

/// Sets of terms to try, as indices into the formula above.
const MODELS: [&[usize]; 7] = [
    &[0, 1],
    &[0, 1, 3],
    &[0, 1, 2],
    &[0, 1, 2, 3],
    &[0, 1, 2, 3, 4],
    &[0, 1, 3, 5, 6],
    &[0, 1, 2, 3, 4, 5, 6],
];
const TERMS: usize = 7;
/// Prior standard deviation and mean of each term: the logarithm of the force rises with that of the
/// strength.
const PRIOR_STD: [f64; TERMS] = [100.0, 1.0, 0.3, 1.0, 1.0, 0.3, 0.3];
const PRIOR_MEAN: [f64; TERMS] = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
/// Error of a single force, against which the priors are weighed.
const PRIOR_ERROR: f64 = 0.05;
/// Fewest presses with a force.
const LEAST_FORCES: usize = 3;
/// Least slope of `ln F` against `ln strength`.
const LEAST_SLOPE: f64 = 0.05;
/// A set of terms must reduce the error to less than this fraction of the best so far.
const GAIN: f64 = 0.95;
/// Standard deviation of `ln F` for each factor `e` of strength beyond the learnt range: a guess not
/// checked by data.
const BEYOND_STD: f64 = 0.3;

/// A press with a known force.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ForceSample {
    /// Strength of the touch in any unit, above zero.
    pub strength: f64,
    /// Position, metres.
    pub place_m: [f64; 3],
    /// Force, newtons, above zero.
    pub force_n: f64,
}

/// A force and its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct ForceEstimate {
    /// Force, newtons.
    pub force_n: f64,
    /// Its standard deviation, newtons.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::absent::infinite"))]
    pub std_n: f64,
}

/// A learnt map from strength and position to force.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ForceCurve {
    /// Coefficients `b0` to `b6` of `ln F`, `F` in newtons; unused ones are zero.
    pub coefficients: [f64; TERMS],
    /// Covariance of the coefficients, row by row; zero for unused ones.
    pub covariance: Vec<f64>,
    /// Centre of the skin, metres.
    pub middle_m: [f64; 3],
    /// Radius of the skin, metres.
    pub radius_m: f64,
    /// Median of the logarithms of the strengths.
    pub middle_ln: f64,
    /// Smallest and largest logarithm of a learnt strength, minus the median.
    pub range_ln: [f64; 2],
    /// Leave-one-out root mean square error of `ln F` over the presses.
    pub error_ln: f64,
    /// Smallest and largest learnt force, newtons.
    pub forces_n: [f64; 2],
}

impl ForceCurve {
    /// Number of coefficients.
    pub const TERMS: usize = TERMS;

    /// Learns from presses of known force on a skin with the given centre and radius.
    ///
    /// # Errors
    /// Fewer than three forces, or a force or strength that is not above zero.
    pub fn learn(
        samples: &[ForceSample],
        middle_m: [f64; 3],
        radius_m: f64,
    ) -> Result<Self, InverseError> {
        if samples.len() < LEAST_FORCES {
            let found = samples.len();
            return Err(InverseError::TooFewPresses { found, needed: LEAST_FORCES });
        }
        for (press, sample) in samples.iter().enumerate() {
            for (quantity, value) in [("force_n", sample.force_n), ("strength", sample.strength)] {
                if !(value > 0.0 && value.is_finite()) {
                    let must = "finite and above zero";
                    return Err(InverseError::MeasurementOutOfRange {
                        quantity,
                        measurement: press,
                        value,
                        must,
                    });
                }
            }
        }
        let logarithms: Vec<f64> = samples.iter().map(|s| s.strength.ln()).collect();
        let middle_ln = quantile(&logarithms, 0.5);
        let range = |of: fn(f64, f64) -> f64| {
            logarithms.iter().map(|l| l - middle_ln).reduce(of).unwrap_or(0.0)
        };
        let forces =
            |of: fn(f64, f64) -> f64| samples.iter().map(|s| s.force_n).reduce(of).unwrap_or(0.0);
        let mut made = Self {
            coefficients: [0.0; TERMS],
            covariance: vec![0.0; TERMS * TERMS],
            middle_m,
            radius_m,
            middle_ln,
            range_ln: [range(f64::min), range(f64::max)],
            error_ln: f64::INFINITY,
            forces_n: [forces(f64::min), forces(f64::max)],
        };
        for terms in MODELS.iter().filter(|terms| terms.len() == 2 || terms.len() < samples.len()) {
            made.attempt(samples, terms)?;
        }
        Ok(made)
    }

    /// Returns the force of a touch of the given strength and position.
    ///
    /// `strength_std` is the standard deviation of the strength as a fraction of it. The standard deviation
    /// of the force includes it, the leave-one-out error, the covariance of the coefficients and the
    /// extrapolation beyond the learnt strengths, but not the uncertainty of the position. If the strength
    /// is not finite and above zero, the force is 0 and its standard deviation infinite.
    pub fn force(&self, strength: f64, place_m: [f64; 3], strength_std: f64) -> ForceEstimate {
        if !(strength > 0.0 && strength.is_finite()) {
            return ForceEstimate { force_n: 0.0, std_n: f64::INFINITY };
        }
        let u = strength.ln() - self.middle_ln;
        let [low, high] = self.range_ln;
        let within = u.clamp(low, high);
        let terms = self.terms(within, place_m);
        let value: f64 = terms.iter().zip(&self.coefficients).map(|(t, c)| t * c).sum();
        let slope = self.slope(within);
        let ln_force = value + slope * (u - within);
        let variance: f64 = (0..TERMS)
            .flat_map(|i| (0..TERMS).map(move |j| (i, j)))
            .map(|(i, j)| terms[i] * terms[j] * self.covariance[i * TERMS + j])
            .sum();
        let beyond = (u - within).abs();
        let std_ln = (self.error_ln.powi(2)
            + variance.max(0.0)
            + (slope * strength_std).powi(2)
            + (BEYOND_STD * beyond).powi(2))
        .sqrt();
        let force_n = ln_force.exp();
        ForceEstimate { force_n, std_n: force_n * std_ln }
    }

    /// Slope of `ln F` against `ln strength`.
    fn slope(&self, u: f64) -> f64 {
        self.coefficients[1] + 2.0 * u * self.coefficients[2]
    }

    fn terms(&self, u: f64, place_m: [f64; 3]) -> [f64; TERMS] {
        let part: [f64; 3] =
            std::array::from_fn(|k| (place_m[k] - self.middle_m[k]) / self.radius_m);
        let r2 = part.iter().map(|p| p * p).sum::<f64>().min(1.0);
        [1.0, u, u * u, r2, r2 * r2, part[0], part[1]]
    }

    /// Fits a set of terms and keeps it if its leave-one-out error is smaller and force increases with
    /// strength.
    fn attempt(&mut self, samples: &[ForceSample], terms: &[usize]) -> Result<(), InverseError> {
        let size = terms.len();
        let rows: Vec<Vec<f64>> = samples
            .iter()
            .map(|s| {
                let all = self.terms(s.strength.ln() - self.middle_ln, s.place_m);
                terms.iter().map(|&t| all[t]).collect()
            })
            .collect();
        let rest: Vec<f64> = samples
            .iter()
            .zip(&rows)
            .map(|(s, row)| {
                let prior: f64 = row.iter().zip(terms).map(|(v, &t)| v * PRIOR_MEAN[t]).sum();
                s.force_n.ln() - prior
            })
            .collect();
        let gram = Mat::from_fn(size, size, |i, j| {
            let ridge = if i == j { (PRIOR_ERROR / PRIOR_STD[terms[i]]).powi(2) } else { 0.0 };
            rows.iter().map(|row| row[i] * row[j]).sum::<f64>() + ridge
        });
        let factor = gram.llt(Side::Lower);
        let factor = factor.map_err(|_| InverseError::Factorisation { what: "forces", size })?;
        let inverse = factor.solve(Mat::<f64>::identity(size, size));
        let right: Vec<f64> =
            (0..size).map(|i| rows.iter().zip(&rest).map(|(row, y)| row[i] * y).sum()).collect();
        let solution: Vec<f64> =
            (0..size).map(|i| (0..size).map(|j| inverse[(i, j)] * right[j]).sum()).collect();
        let left_out = rows.iter().zip(&rest).map(|(row, y)| {
            let value: f64 = row.iter().zip(&solution).map(|(v, c)| v * c).sum();
            let own: f64 = (0..size)
                .map(|i| (0..size).map(|j| row[i] * inverse[(i, j)] * row[j]).sum::<f64>())
                .sum();
            ((y - value) / (1.0 - own).max(1e-3)).powi(2)
        });
        let error_ln = (left_out.sum::<f64>() / samples.len() as f64).sqrt();
        let mut made = Self { coefficients: [0.0; TERMS], error_ln, ..self.clone() };
        made.covariance.fill(0.0);
        for (i, &t) in terms.iter().enumerate() {
            made.coefficients[t] = PRIOR_MEAN[t] + solution[i];
            for (j, &s) in terms.iter().enumerate() {
                made.covariance[t * TERMS + s] = error_ln * error_ln * inverse[(i, j)];
            }
        }
        let is_monotone = made.range_ln.iter().all(|u| made.slope(*u) >= LEAST_SLOPE);
        let is_first = !self.error_ln.is_finite();
        if is_first && !is_monotone {
            made.flatten(samples);
            *self = made;
        } else if is_monotone && error_ln < GAIN * self.error_ln {
            *self = made;
        }
        Ok(())
    }

    /// Fits the straight line of least slope: its constant is the mean residual, its error the
    /// leave-one-out error.
    fn flatten(&mut self, samples: &[ForceSample]) {
        let left =
            |s: &ForceSample| s.force_n.ln() - LEAST_SLOPE * (s.strength.ln() - self.middle_ln);
        let left: Vec<f64> = samples.iter().map(left).collect();
        let count = left.len() as f64;
        let mean = left.iter().sum::<f64>() / count;
        let square = left.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count;
        self.coefficients = [mean, LEAST_SLOPE, 0.0, 0.0, 0.0, 0.0, 0.0];
        // a mean over the other presses is off by count / (count - 1) times as much
        self.error_ln = square.sqrt() * count / (count - 1.0);
        self.covariance.fill(0.0);
        self.covariance[0] = self.error_ln.powi(2) / count;
    }
}
