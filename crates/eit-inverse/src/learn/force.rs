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
//! All terms are fitted, each with a Gaussian prior; twelve presses do not determine seven numbers, and what
//! they leave open is small on a sheet whose model is about right. Four widths of the priors of all but `b0` and
//! `b1` are tried, from the power law alone to priors so wide that the presses decide; a wider one is accepted if
//! its leave-one-out error is below 0.85 of the best so far. Force must increase with strength: a fit whose slope
//! in `u` is below 0.05 anywhere in the learnt range is rejected. If even the power law `b0 + b1 u` is flatter than
//! that (forces that do not follow the strengths), its slope is set to 0.05, and the error shows how little is
//! known. Beyond the learnt strengths the curve continues along its tangent, and its standard deviation grows.
//!
//! Source of the fit: Rasmussen, Williams, *Gaussian Processes for Machine Learning* (2006), section 2.1 (linear
//! regression with Gaussian priors).

use crate::InverseError;
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};

/// Number of terms of the formula above.
const TERMS: usize = 7;
/// Prior standard deviations of the terms, widest last. The logarithm of the force rises with that of the strength,
/// by a power of 0.8 on the simulated fabric. The second set is for a sheet whose model is about right.
const PRIOR_STDS: [[f64; TERMS]; 4] = [
    [100.0, 0.3, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4],
    [100.0, 0.3, 0.05, 0.1, 0.05, 0.03, 0.03],
    [100.0, 0.5, 0.1, 0.4, 0.3, 0.1, 0.1],
    [100.0, 1.0, 0.3, 1.0, 1.0, 0.3, 0.3],
];
/// The set from which the search starts.
const FIRST_PRIOR: usize = 1;
const PRIOR_MEAN: [f64; TERMS] = [0.0, 0.9, 0.0, 0.0, 0.0, 0.0, 0.0];
/// Error of a single force, against which the priors are weighed, and the least that is stated: a few presses may
/// agree better by chance, but memory and unevenness of a fabric repeat no press better than that.
const PRIOR_ERROR: f64 = 0.05;
/// Fewest presses with a force.
const LEAST_FORCES: usize = 3;
/// Least slope of `ln F` against `ln strength`.
const LEAST_SLOPE: f64 = 0.05;
/// Wider priors must reduce the error to less than this fraction of the best so far.
const GAIN: f64 = 0.85;
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
        let middle_ln = eit_core::median(logarithms.iter().copied()).unwrap_or(0.0);
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
        for prior in &PRIOR_STDS[FIRST_PRIOR..] {
            made.attempt(samples, prior)?;
        }
        if !made.error_ln.is_finite() {
            // curved downward by chance: the power law alone
            made.attempt(samples, &PRIOR_STDS[0])?;
        }
        if !made.error_ln.is_finite() {
            made.flatten(samples);
        }
        Ok(made)
    }

    /// Returns the force of a touch of the given strength and position.
    ///
    /// `strength_std` is the standard deviation of the strength as a fraction of it. The standard deviation
    /// of the force includes it, the leave-one-out error (at least 5 %), the covariance of the coefficients and the
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
        let std_ln = (self.error_ln.max(PRIOR_ERROR).powi(2)
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

    /// Fits all terms with priors of these standard deviations, and keeps the fit if its leave-one-out error is
    /// smaller and force increases with strength.
    fn attempt(
        &mut self,
        samples: &[ForceSample],
        prior_std: &[f64; TERMS],
    ) -> Result<(), InverseError> {
        let rows: Vec<[f64; TERMS]> = samples
            .iter()
            .map(|s| self.terms(s.strength.ln() - self.middle_ln, s.place_m))
            .collect();
        let product = |a: &[f64; TERMS], b: &[f64; TERMS]| -> f64 {
            a.iter().zip(b).map(|(a, b)| a * b).sum()
        };
        let rest = samples.iter().zip(&rows);
        let rest: Vec<f64> =
            rest.map(|(s, row)| s.force_n.ln() - product(row, &PRIOR_MEAN)).collect();
        let gram = Mat::from_fn(TERMS, TERMS, |i, j| {
            let ridge = if i == j { (PRIOR_ERROR / prior_std[i]).powi(2) } else { 0.0 };
            rows.iter().map(|row| row[i] * row[j]).sum::<f64>() + ridge
        });
        let factor = gram.llt(Side::Lower);
        let factor =
            factor.map_err(|_| InverseError::Factorisation { what: "forces", size: TERMS })?;
        let inverse = factor.solve(Mat::<f64>::identity(TERMS, TERMS));
        let times = |vector: &[f64; TERMS]| -> [f64; TERMS] {
            std::array::from_fn(|i| (0..TERMS).map(|j| inverse[(i, j)] * vector[j]).sum())
        };
        let right: [f64; TERMS] =
            std::array::from_fn(|i| rows.iter().zip(&rest).map(|(row, y)| row[i] * y).sum());
        let solution = times(&right);
        let left_out = rows.iter().zip(&rest).map(|(row, y)| {
            let own = product(row, &times(row));
            ((y - product(row, &solution)) / (1.0 - own).max(1e-3)).powi(2)
        });
        let error_ln = (left_out.sum::<f64>() / samples.len() as f64).sqrt();
        let coefficients = std::array::from_fn(|t| PRIOR_MEAN[t] + solution[t]);
        // the priors are those of an error of PRIOR_ERROR
        let variance = error_ln.max(PRIOR_ERROR).powi(2);
        let entries = (0..TERMS).flat_map(|i| (0..TERMS).map(move |j| (i, j)));
        let covariance = entries.map(|(i, j)| variance * inverse[(i, j)]).collect();
        let made = Self { coefficients, covariance, error_ln, ..self.clone() };
        let is_monotone = made.range_ln.iter().all(|u| made.slope(*u) >= LEAST_SLOPE);
        if is_monotone && (!self.error_ln.is_finite() || error_ln < GAIN * self.error_ln) {
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
