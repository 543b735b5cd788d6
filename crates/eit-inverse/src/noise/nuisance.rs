//! Nuisance parameters, taken out of the data.

use crate::InverseError;
use crate::check::{check_length, check_positive};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, Par};
use ndarray::{Array2, ArrayRef2};

/// Nuisance parameters: unknowns that the data depend on and the image does not show, such as the
/// displacement of each electrode. Gaussian and linear:
///
/// ```text
/// dv = J dsigma + K d + noise,     d ~ N(0, C),   noise ~ N(0, N),     C and N diagonal
/// ```
///
/// An image and the most probable `d` together are the image alone under the noise covariance
/// `N + K C K'`: for every prior of the image, total variation included, minimising over `d` leaves
/// `|dv - J dsigma|` in the inverse of it. So no method needs to know: data and Jacobian are
/// multiplied by
///
/// ```text
/// T = (I - U diag(1 - (1 + s^2)^-1/2) U') N^-1/2,     N^-1/2 K C^1/2 = U diag(s) V'
/// ```
///
/// ([`NuisanceParameters::whiten`], [`NuisanceParameters::whiten_jacobian`]), after which the noise
/// is white of standard deviation 1, and `d` follows from what an image leaves unexplained
/// ([`NuisanceParameters::map_estimate`]). Costs `2 m k` flops a frame for `k` unknowns.
/// Measurements mix: those that are not used must be so for all frames.
///
/// Source: Soleimani, Gomez-Laberge, Adler, *Physiol. Meas.* 27 (2006), S103-S113 (electrode
/// movement as further unknowns of the image); the same as correlated noise: Kaipio, Somersalo,
/// *Statistical and Computational Inverse Problems* (2005), section 3.3.
#[derive(Debug, Clone)]
pub struct NuisanceParameters {
    /// `N^-1/2`, zero where not used.
    weights: Vec<f64>,
    /// `U`, `[measurement, k]`.
    directions: Mat<f64>,
    /// `s`.
    strengths: Vec<f64>,
    /// `C^1/2 V`, `[unknown, k]`.
    unknowns: Mat<f64>,
}

impl NuisanceParameters {
    /// From `K` `[measurement, unknown]` (in the unit of the differences for each unit of an
    /// unknown, as from [`Solution::movement_jacobian`](eit_fem::Solution::movement_jacobian)), the
    /// standard deviation of each unknown, and that of each difference's noise. Values of
    /// measurements that are not used are not looked at.
    ///
    /// # Errors
    /// Wrong lengths; entries that are not finite; deviations that are not above zero; nothing
    /// used.
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

    /// What part of the variance of whitened data each direction keeps, largest unknown first:
    /// `1 / (1 + s^2)`, 1 where the unknowns drown in noise, 0 where the data tell them alone.
    pub fn kept_variance(&self) -> Vec<f64> {
        self.strengths.iter().map(|s| 1.0 / (1.0 + s * s)).collect()
    }

    /// `U' N^-1/2 dv`.
    fn parts(&self, difference: &[f64]) -> Vec<f64> {
        let part = |k: usize| {
            let column = self.directions.col(k).iter().zip(&self.weights).zip(difference);
            // what is not used may be NaN
            column.filter(|((_, w), _)| **w > 0.0).map(|((u, w), d)| u * w * d).sum()
        };
        (0..self.strengths.len()).map(part).collect()
    }

    /// `T dv` in place: white noise of standard deviation 1; zero where not used. Allocates
    /// nothing.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`].
    pub fn whiten(&self, difference: &mut [f64]) -> Result<(), InverseError> {
        check_length("difference", difference.len(), self.weights.len())?;
        for (value, weight) in difference.iter_mut().zip(&self.weights) {
            // what is not used may be NaN
            *value = if *weight > 0.0 { weight * *value } else { 0.0 };
        }
        // directions are orthogonal: what one takes is no part of the next
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

    /// `T J` of a Jacobian `[measurement, element]`.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`].
    pub fn whiten_jacobian(&self, jacobian: &ArrayRef2<f64>) -> Result<Array2<f64>, InverseError> {
        let (rows, columns) = jacobian.dim();
        check_length("rows of the Jacobian", rows, self.weights.len())?;
        let mut values = Vec::with_capacity(rows * columns);
        for (row, weight) in jacobian.rows().into_iter().zip(&self.weights) {
            // what is not used may be NaN
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

    /// The most probable unknowns `C K' (N + K C K')^-1 r` for what an image leaves of the
    /// differences, `r = dv - J dsigma` (not whitened), `[unknown]`.
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
