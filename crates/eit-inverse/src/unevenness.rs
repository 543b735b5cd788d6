//! Unevenness of an untouched sheet, estimated from its reference frame.
//!
//! ```text
//! v_ref / g - v(sigma) = J diag(sigma) B c + U q + e        ln sigma = ln sigma_0 + B c
//! ```
//!
//! `B` holds bells `exp(-r^2 / length^2)` at evenly spread positions, and `c` is normal with mean 0.
//! `ln sigma` is then nearly a Gaussian field of covariance `amplitude^2 exp(-r^2 / (2 length^2))`. `U q`
//! is the effect of contacts, displaced electrodes and the gain `g`; `e` is the error of each voltage,
//! known up to a factor. The amplitude and that factor maximise the evidence (marginal likelihood). The
//! amplitude is zero if an even sheet explains the frame equally well.
//!
//! **Cost** for `n` voltages, `p` positions, `u` unknowns: `2 n p elements` flops and 32 Cholesky factorisations of
//! `m^3 / 3` with `m = min(n, p + u)`, once, at set-up. Outside the range of `[J B, U]` is `e` alone.
//!
//! Source: Kaipio, Somersalo, *Statistical and Computational Inverse Problems* (2005), section 3.3; MacKay,
//! *Neural Computation* 4 (1992), 415-447, for the evidence.

use crate::InverseError;
use crate::check::{check_length, check_positive};
use crate::geometry::distance_m;
use eit_mesh::Surface;
use faer::linalg::solvers::{Llt, Solve};
use faer::{Col, Mat, Side};
use ndarray::ArrayRef2;

/// Most positions; more cost more than they tell.
const MOST_PLACES: f64 = 500.0;

/// Spacing of the bells as a fraction of their length, at which their sum is even to 1e-3.
const SPACING: f64 = 0.6;

/// Standard deviations of `ln sigma` to try, ...
const AMPLITUDES: [f64; 6] = [0.01, 0.02, 0.05, 0.1, 0.2, 0.4];

/// ... and factors of the voltages' errors to try, alternating with them, ...
const ERROR_SCALES: [f64; 6] = [0.25, 0.5, 1.0, 2.0, 4.0, 16.0];

/// ... this many times.
const ROUNDS: usize = 2;

/// Basis of bells for an uneven sheet.
#[derive(Debug, Clone)]
pub struct UnevenSheet {
    /// `[element, place]`.
    basis: Mat<f64>,
}

/// Inputs of [`UnevenSheet::fit`]. Voltages are `[measurement]`.
#[derive(Debug, Clone, Copy)]
pub struct ReferenceModel<'a> {
    /// Jacobian at `conductivity_s`, `[measurement, element]`, volts per siemens.
    pub jacobian: &'a ArrayRef2<f64>,
    /// Conductivity at which voltages and Jacobian were computed, siemens per square.
    pub conductivity_s: &'a [f64],
    /// Voltages of the model, volts.
    pub model_v: &'a [f64],
    /// The reference frame divided by its gain relative to the model, volts.
    pub reference_v: &'a [f64],
    /// Standard deviation of the error of each voltage, volts, above zero.
    pub error_v: &'a [f64],
    /// Other effects on the voltages, per standard deviation of each: `[measurement, unknown]`.
    pub unknowns: &'a ArrayRef2<f64>,
    /// Which measurements are used.
    pub used: &'a [bool],
}

/// A fitted uneven sheet.
#[derive(Debug, Clone)]
pub struct Unevenness {
    /// `ln (sigma / sigma_0)` of each element.
    pub log_change: Vec<f64>,
    /// Standard deviation of `ln (sigma / sigma_0)` of greatest evidence; zero for an even sheet.
    pub amplitude: f64,
    /// Factor of the voltages' errors of greatest evidence.
    pub error_scale: f64,
    /// Logarithm of the evidence relative to that of an even sheet.
    pub log_evidence: f64,
    coefficients: Col<f64>,
}

/// Effects on a reference frame, in standard deviations of each.
#[derive(Debug, Clone, PartialEq)]
pub struct Effects {
    /// Mean of each, ...
    pub mean: Vec<f64>,
    /// ... and standard deviation, at most 1.
    pub std: Vec<f64>,
    /// Logarithm of the evidence relative to that without them.
    pub log_evidence: f64,
}

impl UnevenSheet {
    /// Builds a basis of the given correlation length, which is increased on a very large skin.
    ///
    /// # Errors
    /// A length that is not above zero.
    pub fn new(surface: &Surface, length_m: f64) -> Result<Self, InverseError> {
        check_positive("correlation length of the unevenness", length_m)?;
        let area: f64 = surface.areas_m2().iter().sum();
        let spacing_m = (SPACING * length_m).max((area / MOST_PLACES).sqrt());
        let length_m = spacing_m / SPACING;
        let centroids = surface.centroids();
        let mut at: Vec<[f64; 3]> = Vec::new();
        for &centroid in &centroids {
            if at.iter().all(|other| distance_m(*other, centroid) >= spacing_m) {
                at.push(centroid);
            }
        }
        let mut basis = Mat::from_fn(centroids.len(), at.len(), |element, place| {
            (-(distance_m(centroids[element], at[place]) / length_m).powi(2)).exp()
        });
        // coefficients of variance 1 give `B c` variance 1, averaged over elements
        let spread = basis.norm_l2() / (centroids.len().max(1) as f64).sqrt();
        basis *= faer::Scale(spread.recip());
        Ok(Self { basis })
    }

    /// Finds the sheet that explains a reference frame.
    ///
    /// Pass as `before` the result from which the model's sheet was made; repeated calls are then
    /// Gauss-Newton steps.
    ///
    /// # Errors
    /// Wrong lengths, non-finite values of used measurements, errors that are not above zero, or no used
    /// measurement.
    pub fn fit(
        &self,
        model: &ReferenceModel<'_>,
        before: Option<&Unevenness>,
    ) -> Result<Unevenness, InverseError> {
        let none = Mat::zeros(self.check(model)?.len(), 0);
        let (columns, _, frame) = self.frame(model, before, &none)?;
        let even = frame.better(frame.at(0.0, 1.0)?, ERROR_SCALES.map(|scale| (0.0, scale)))?;
        let best = frame.uneven(&even)?;
        let log_evidence = best.log_evidence - even.log_evidence;
        let best = if log_evidence > 0.0 { best } else { even };
        let variance = best.amplitude.powi(2);
        let coefficients = faer::Scale(variance) * (columns.transpose() * &best.solved);
        Ok(Unevenness {
            log_change: (&self.basis * &coefficients).iter().copied().collect(),
            amplitude: best.amplitude,
            error_scale: best.error_scale,
            log_evidence: log_evidence.max(0.0),
            coefficients,
        })
    }

    /// Estimates further effects on the reference frame, `[measurement, effect]` for one standard deviation of
    /// each, together with an uneven sheet and errors as [`UnevenSheet::fit`] finds them.
    ///
    /// # Errors
    /// Those of [`UnevenSheet::fit`].
    pub fn estimate(
        &self,
        model: &ReferenceModel<'_>,
        effects: &ArrayRef2<f64>,
    ) -> Result<Effects, InverseError> {
        check_length("rows of the effects", effects.nrows(), model.used.len())?;
        let rows = self.check(model)?;
        let effects = Mat::from_fn(rows.len(), effects.ncols(), |row, k| {
            effects[(rows[row], k)] / model.error_v[rows[row]]
        });
        let (_, effects, mut frame) = self.frame(model, None, &effects)?;
        let without = frame.best()?;
        frame.errors += &effects * effects.transpose();
        let with = frame.best()?;
        let factor = frame.factor(with.amplitude, with.error_scale)?;
        let solved = factor.solve(&effects);
        let explained = effects.transpose() * &solved;
        Ok(Effects {
            mean: (effects.transpose() * &with.solved).iter().copied().collect(),
            std: (0..effects.ncols()).map(|k| (1.0 - explained[(k, k)]).max(0.0).sqrt()).collect(),
            log_evidence: with.log_evidence - without.log_evidence,
        })
    }

    /// The frame in units of each voltage's error, and the effects of each bell and of `effects` on it, without errors alone.
    fn frame(
        &self,
        model: &ReferenceModel<'_>,
        before: Option<&Unevenness>,
        effects: &Mat<f64>,
    ) -> Result<(Mat<f64>, Mat<f64>, Frame), InverseError> {
        let rows = self.check(model)?;
        // in units of each voltage's error
        let weight = |row: usize| model.error_v[rows[row]].recip();
        let scaled = Mat::from_fn(rows.len(), self.basis.nrows(), |row, e| {
            weight(row) * model.jacobian[(rows[row], e)] * model.conductivity_s[e]
        });
        let columns = &scaled * &self.basis;
        let mut left = Col::from_fn(rows.len(), |row| {
            let i = rows[row];
            weight(row) * (model.reference_v[i] - model.model_v[i])
        });
        if let Some(before) = before {
            left += &columns * &before.coefficients;
        }
        let (places, unknowns) = (columns.ncols(), model.unknowns.ncols());
        let all = Mat::from_fn(rows.len(), places + unknowns + effects.ncols(), |row, k| match k {
            k if k < places => columns[(row, k)],
            k if k < places + unknowns => weight(row) * model.unknowns[(rows[row], k - places)],
            k => effects[(row, k - places - unknowns)],
        });
        let (all, left, outside) = without_errors_alone(all, left);
        let columns = all.subcols(0, places).to_owned();
        let effects = all.subcols(places + unknowns, effects.ncols()).to_owned();
        let unknowns = all.subcols(places, unknowns);
        let gram = &columns * columns.transpose();
        let errors = unknowns * unknowns.transpose();
        Ok((columns, effects, Frame { left, errors, gram, outside }))
    }

    /// Checks the input and returns the used measurements.
    fn check(&self, model: &ReferenceModel<'_>) -> Result<Vec<usize>, InverseError> {
        let measurements = model.used.len();
        check_length("rows of the Jacobian", model.jacobian.nrows(), measurements)?;
        check_length("elements of the Jacobian", model.jacobian.ncols(), self.basis.nrows())?;
        check_length("conductivities", model.conductivity_s.len(), self.basis.nrows())?;
        check_length("voltages of the model", model.model_v.len(), measurements)?;
        check_length("voltages of the reference", model.reference_v.len(), measurements)?;
        check_length("errors of voltages", model.error_v.len(), measurements)?;
        check_length("rows of the unknowns", model.unknowns.nrows(), measurements)?;
        let rows: Vec<usize> = (0..measurements).filter(|&i| model.used[i]).collect();
        if rows.is_empty() {
            return Err(InverseError::NothingUsed { measurements });
        }
        for &measurement in &rows {
            let value = model.reference_v[measurement] - model.model_v[measurement];
            if !value.is_finite() {
                return Err(InverseError::NonFiniteData { frame: 0, measurement, value });
            }
            check_positive("error of a voltage", model.error_v[measurement])?;
        }
        Ok(rows)
    }
}

/// A frame and what may explain it, in units of each voltage's error.
struct Frame {
    left: Col<f64>,
    /// Covariance of the unknowns' effects.
    errors: Mat<f64>,
    /// Covariance of voltages for an amplitude of 1.
    gram: Mat<f64>,
    outside: Outside,
}

/// What is outside the range of all effects: errors alone.
struct Outside {
    count: usize,
    /// Energy of the data there, in units of the voltages' errors.
    square: f64,
}

/// Effects, `[measurement, effect]`, and data in an orthonormal basis of the range of the effects, if they are fewer than the
/// measurements; and what is outside of it.
fn without_errors_alone(effects: Mat<f64>, left: Col<f64>) -> (Mat<f64>, Col<f64>, Outside) {
    let (measurements, inside) = effects.shape();
    if inside >= measurements {
        return (effects, left, Outside { count: 0, square: 0.0 });
    }
    let qr = effects.qr();
    let projected = qr.compute_thin_Q().transpose() * &left;
    let square = (left.squared_norm_l2() - projected.squared_norm_l2()).max(0.0);
    (qr.thin_R().to_owned(), projected, Outside { count: measurements - inside, square })
}

/// A hypothesis and its evidence.
struct Choice {
    amplitude: f64,
    error_scale: f64,
    /// Inverse covariance times the data.
    solved: Col<f64>,
    /// Logarithm of the normal density of the data, up to a constant.
    log_evidence: f64,
}

impl Frame {
    /// Returns the uneven sheet of greatest evidence.
    fn uneven(&self, even: &Choice) -> Result<Choice, InverseError> {
        let mut best = self.at(AMPLITUDES[0], even.error_scale)?;
        for _ in 0..ROUNDS {
            let error_scale = best.error_scale;
            best = self.better(best, AMPLITUDES.map(|amplitude| (amplitude, error_scale)))?;
            let amplitude = best.amplitude;
            best = self.better(best, ERROR_SCALES.map(|scale| (amplitude, scale)))?;
        }
        Ok(best)
    }

    /// Returns the sheet of greatest evidence, even or uneven.
    fn best(&self) -> Result<Choice, InverseError> {
        let even = self.better(self.at(0.0, 1.0)?, ERROR_SCALES.map(|scale| (0.0, scale)))?;
        let uneven = self.uneven(&even)?;
        Ok(if uneven.log_evidence > even.log_evidence { uneven } else { even })
    }

    /// Factor of the covariance of the frame.
    fn factor(&self, amplitude: f64, error_scale: f64) -> Result<Llt<f64>, InverseError> {
        let size = self.left.nrows();
        let covariance = Mat::from_fn(size, size, |i, j| {
            let error = if i == j { error_scale * error_scale } else { 0.0 };
            self.errors[(i, j)] + amplitude * amplitude * self.gram[(i, j)] + error
        });
        Llt::new(covariance.as_ref(), Side::Lower)
            .map_err(|_| InverseError::Factorisation { what: "covariance of a frame", size })
    }

    fn at(&self, amplitude: f64, error_scale: f64) -> Result<Choice, InverseError> {
        let factor = self.factor(amplitude, error_scale)?;
        let solved: Col<f64> = factor.solve(&self.left);
        let square: f64 = self.left.iter().zip(solved.iter()).map(|(a, b)| a * b).sum();
        let diagonal = factor.L().diagonal().column_vector();
        let log_determinant: f64 = diagonal.iter().map(|d| 2.0 * d.ln()).sum();
        let Outside { count, square: outside } = self.outside;
        let of_errors = outside / error_scale.powi(2) + count as f64 * error_scale.powi(2).ln();
        let log_evidence = -0.5 * (square + log_determinant + of_errors);
        Ok(Choice { amplitude, error_scale, solved, log_evidence })
    }

    /// Returns the best of one hypothesis and others, `(amplitude, error_scale)`.
    fn better<const N: usize>(
        &self,
        best: Choice,
        others: [(f64, f64); N],
    ) -> Result<Choice, InverseError> {
        others.into_iter().try_fold(best, |best, (amplitude, error_scale)| {
            let tried = self.at(amplitude, error_scale)?;
            Ok(if tried.log_evidence > best.log_evidence { tried } else { best })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Effects of fewer unknowns than measurements: the small problem has the evidence and the coefficients of the covariance
    /// of all measurements. 1e-10: rounding.
    #[test]
    fn errors_alone_are_left_out_exactly() {
        let value =
            |i: usize, k: usize| ((7 * i + 13 * k * k + 5 * i * k) % 29) as f64 / 29.0 - 0.4;
        let effects = Mat::from_fn(40, 9, value);
        let left = Col::from_fn(40, |i| value(i, 11));
        let frame = |effects: &Mat<f64>, left, outside| {
            let [gram, errors] =
                [effects.subcols(0, 6), effects.subcols(6, 3)].map(|e| e * e.transpose());
            Frame { left, errors, gram, outside }
        };
        let whole = frame(&effects, left.clone(), Outside { count: 0, square: 0.0 });
        let (few, projected, outside) = without_errors_alone(effects.clone(), left);
        assert_eq!((few.nrows(), outside.count), (9, 31));
        let small = frame(&few, projected, outside);
        for (amplitude, error_scale) in [(0.0, 1.0), (0.5, 0.3), (2.0, 4.0)] {
            let [all, least] = [&whole, &small].map(|f| f.at(amplitude, error_scale).unwrap());
            assert!((all.log_evidence - least.log_evidence).abs() < 1e-10 * all.log_evidence.abs());
            let difference = effects.transpose() * &all.solved - few.transpose() * &least.solved;
            assert!(difference.norm_max() < 1e-10, "{difference:?}");
        }
    }
}
