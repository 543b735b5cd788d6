//! Nuisance parameters, removed from the data by whitening.

use crate::InverseError;
use crate::check::{check_length, check_positive};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, Par};
use ndarray::{Array2, ArrayRef2};

/// Nuisance parameters: unknowns that affect the data but are not part of the image, such as the
/// displacement of each electrode.
///
/// The model is Gaussian and linear:
///
/// ```text
/// dv = J dsigma + K d + noise,     d ~ N(0, C),   noise ~ N(0, N),     C and N diagonal
/// ```
///
/// The image estimated jointly with the most probable `d` equals the image estimated alone under the noise
/// covariance `N + K C K'`: for every prior of the image, including total variation, minimising over `d`
/// leaves `|dv - J dsigma|` in the inverse of that covariance. So the methods need no change. Data and
/// Jacobian are multiplied by
///
/// ```text
/// T = (I - U diag(1 - (1 + s^2)^-1/2) U') N^-1/2,     N^-1/2 K C^1/2 = U diag(s) V'
/// ```
///
/// ([`NuisanceParameters::whiten`], [`NuisanceParameters::whiten_jacobian`]). The noise is then white with
/// standard deviation 1, and `d` follows from the residual of an image
/// ([`NuisanceParameters::map_estimate`]). The cost is `2 m k` flops per frame for `k` unknowns. Whitening
/// mixes measurements, so unused ones must be the same in all frames.
///
/// Source: Soleimani, Gomez-Laberge, Adler, *Physiol. Meas.* 27 (2006), S103-S113 (electrode movement as
/// further unknowns of the image); equivalence to correlated noise: Kaipio, Somersalo, *Statistical and
/// Computational Inverse Problems* (2005), section 3.3.
#[derive(Debug, Clone)]
pub struct NuisanceParameters {
    /// `N^-1/2`, zero for unused measurements.
    weights: Vec<f64>,
    /// `U`, `[measurement, k]`.
    directions: Mat<f64>,
    /// `s`.
    strengths: Vec<f64>,
    /// `C^1/2 V`, `[unknown, k]`.
    unknowns: Mat<f64>,
}

impl NuisanceParameters {
    /// Builds the whitening from `K` `[measurement, unknown]`, the standard deviation of each unknown, and
    /// the standard deviation of each difference's noise.
    ///
    /// `K` is in the unit of the differences per unit of an unknown, as from
    /// [`Solution::movement_jacobian`](eit_fem::Solution::movement_jacobian). Values of unused measurements
    /// are not read.
    ///
    /// # Errors
    /// Wrong lengths, non-finite entries, standard deviations that are not above zero, or no used
    /// measurement.
    pub fn new(
        jacobian: &ArrayRef2<f64>,
        std: &[f64],
        noise_std: &[f64],
        used: Option<&[bool]>,
    ) -> Result<Self, InverseError> {
        let (measurements, unknowns) = jacobian.dim();
        if measurements == 0 || unknowns == 0 {
            return Err(InverseError::EmptyJacobian { measurements, elements: unknowns });
        }
        check_length("std of the unknowns", std.len(), unknowns)?;
        check_length("noise_std", noise_std.len(), measurements)?;
        std.iter().try_for_each(|s| check_positive("std of an unknown", *s))?;
        let all = vec![true; measurements];
        let used = used.unwrap_or(&all);
        check_length("used", used.len(), measurements)?;
        if !used.contains(&true) {
            return Err(InverseError::NothingUsed { measurements });
        }
        let mut weights = vec![0.0; measurements];
        let mut scaled = Mat::zeros(measurements, unknowns);
        for (measurement, row) in jacobian.rows().into_iter().enumerate() {
            if !used[measurement] {
                continue;
            }
            check_positive("noise_std of a used measurement", noise_std[measurement])?;
            weights[measurement] = noise_std[measurement].recip();
            for (element, &value) in row.iter().enumerate() {
                let entry = weights[measurement] * value * std[element];
                if !entry.is_finite() {
                    return Err(InverseError::NonFiniteJacobian { measurement, element, value });
                }
                scaled[(measurement, element)] = entry;
            }
        }
        let failed = InverseError::Factorisation {
            what: "whitened Jacobian of the nuisance parameters",
            size: measurements,
        };
        let svd = scaled.thin_svd().map_err(|_| failed)?;
        let strengths: Vec<f64> = svd.S().column_vector().iter().copied().collect();
        let right = svd.V();
        let unknowns = Mat::from_fn(unknowns, strengths.len(), |i, k| std[i] * right[(i, k)]);
        Ok(Self { weights, directions: svd.U().to_owned(), strengths, unknowns })
    }

    /// Returns the fraction of the whitened variance that each direction keeps, largest unknown first:
    /// `1 / (1 + s^2)`.
    ///
    /// 1 if the unknowns are buried in noise, 0 if the data determine them.
    pub fn kept_variance(&self) -> Vec<f64> {
        self.strengths.iter().map(|s| 1.0 / (1.0 + s * s)).collect()
    }

    /// `U' N^-1/2 dv`.
    fn parts(&self, difference: &[f64]) -> Vec<f64> {
        let part = |k: usize| {
            let column = self.directions.col(k).iter().zip(&self.weights).zip(difference);
            // unused values may be NaN
            column.filter(|((_, w), _)| **w > 0.0).map(|((u, w), d)| u * w * d).sum()
        };
        (0..self.strengths.len()).map(part).collect()
    }

    /// Replaces `dv` by `T dv`: white noise of standard deviation 1, zero for unused measurements. Does not
    /// allocate.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`].
    pub fn whiten(&self, difference: &mut [f64]) -> Result<(), InverseError> {
        check_length("difference", difference.len(), self.weights.len())?;
        for (value, weight) in difference.iter_mut().zip(&self.weights) {
            // unused values may be NaN
            *value = if *weight > 0.0 { weight * *value } else { 0.0 };
        }
        // the directions are orthogonal, so removing one leaves the others unchanged
        for (k, taken) in self.taken().enumerate() {
            let direction = self.directions.col(k);
            let part: f64 = direction.iter().zip(&*difference).map(|(u, value)| u * value).sum();
            let values = difference.iter_mut().zip(direction.iter());
            values.for_each(|(value, u)| *value -= taken * part * u);
        }
        Ok(())
    }

    /// `1 - (1 + s^2)^-1/2`.
    fn taken(&self) -> impl Iterator<Item = f64> {
        self.strengths.iter().map(|s| 1.0 - (1.0 + s * s).sqrt().recip())
    }

    /// Returns `T J` for a Jacobian `[measurement, element]`.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`].
    pub fn whiten_jacobian(&self, jacobian: &ArrayRef2<f64>) -> Result<Array2<f64>, InverseError> {
        let (rows, columns) = jacobian.dim();
        check_length("rows of the Jacobian", rows, self.weights.len())?;
        let mut values = Vec::with_capacity(rows * columns);
        for (row, weight) in jacobian.rows().into_iter().zip(&self.weights) {
            // unused values may be NaN
            values.extend(row.iter().map(|j| if *weight > 0.0 { weight * j } else { 0.0 }));
        }
        let mut whitened = MatMut::from_row_major_slice_mut(&mut values, rows, columns);
        let mut parts = self.directions.transpose() * whitened.as_ref();
        for (k, taken) in self.taken().enumerate() {
            parts.row_mut(k).iter_mut().for_each(|part| *part *= taken);
        }
        let (u, target) = (self.directions.as_ref(), whitened.as_mut());
        matmul(target, Accum::Add, u, parts.as_ref(), -1.0, Par::Seq);
        let (found, wanted) = (values.len(), rows * columns);
        let what = "values of the Jacobian";
        Array2::from_shape_vec((rows, columns), values).map_err(|_| InverseError::WrongLength {
            what,
            found,
            wanted,
        })
    }

    /// Returns the most probable unknowns `C K' (N + K C K')^-1 r` for the residual of an image,
    /// `r = dv - J dsigma` (not whitened), `[unknown]`.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`].
    pub fn map_estimate(&self, unexplained: &[f64]) -> Result<Vec<f64>, InverseError> {
        check_length("unexplained", unexplained.len(), self.weights.len())?;
        let parts = self.parts(unexplained);
        let amounts: Vec<f64> =
            parts.iter().zip(&self.strengths).map(|(p, s)| p * s / (1.0 + s * s)).collect();
        let unknown = |i: usize| -> f64 {
            amounts.iter().enumerate().map(|(k, a)| self.unknowns[(i, k)] * a).sum()
        };
        Ok((0..self.unknowns.nrows()).map(unknown).collect())
    }
}
