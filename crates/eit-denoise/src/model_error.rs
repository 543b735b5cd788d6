//! Model error of the data: the part of the measurements that the linear model leaves unexplained even with
//! the true image.

use crate::DenoiseError;
use ndarray::{Array2, ArrayView1};

/// Largest number of directions kept: the electrodes of the paper's skin move in 32 ways and have 16 contacts.
const DIRECTIONS: usize = 64;
/// Variance of the model error outside the kept directions, per measurement, as a fraction of the data's
/// mean energy per measurement: the differences are known to 1 %.
const FLOOR: f64 = 1e-4;
/// Largest number of sweeps of the eigenvalue iteration, which converges quadratically and needs about eight.
const SWEEPS: usize = 30;

/// Covariance of the model error relative to the data's energy: electrodes that move, contacts that change,
/// drift, and what the linear model lacks.
///
/// The error of a frame with differences `dv` is taken as normal with the covariance
/// `|dv|^2 (U' U + floor I)`, learnt from true images `x` as the second moment of `(dv - J x) / |dv|`
/// (the approximation error approach: Kaipio and Somersalo, J. Comput. Appl. Math. 198:493, 2007).
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ModelError {
    /// `U` [direction, measurement]: eigenvectors times the roots of their eigenvalues.
    pub directions: Array2<f32>,
    /// Variance in all other directions.
    pub floor: f64,
    /// Largest score ([`ModelErrorNorm::score`]) of a correct image.
    pub limit: f64,
}

impl ModelError {
    /// Rejects values that are not finite or not positive.
    ///
    /// # Errors
    /// [`DenoiseError::OutOfRange`].
    pub fn validate(&self) -> Result<(), DenoiseError> {
        for (quantity, value) in
            [("floor of the model error", self.floor), ("limit of the model error", self.limit)]
        {
            let is_positive = value.is_finite() && value > 0.0;
            DenoiseError::check_range(is_positive, quantity, value, "finite and above zero")?;
        }
        self.directions.iter().try_for_each(|&value| {
            let quantity = "a direction of the model error";
            DenoiseError::check_range(value.is_finite(), quantity, f64::from(value), "finite")
        })
    }
}

/// Second moments of model errors, added up frame by frame.
#[derive(Debug, Clone)]
pub struct ModelErrorSum {
    moments: Array2<f64>,
    frames: usize,
}

impl ModelErrorSum {
    /// Creates an empty sum for a number of measurements.
    pub fn new(measurements: usize) -> Self {
        Self { moments: Array2::zeros((measurements, measurements)), frames: 0 }
    }

    /// Adds the residual of a true image of a frame to the sum; both are `[measurement]`. Frames
    /// that lack a measurement, or of zero energy, are left out.
    pub fn add(&mut self, left: ArrayView1<'_, f64>, differences: ArrayView1<'_, f64>) {
        let energy = differences.iter().map(|v| v * v).sum::<f64>();
        let fits = left.len() == self.moments.nrows();
        if !(fits && energy.is_finite() && energy > 0.0 && left.iter().all(|v| v.is_finite())) {
            return;
        }
        self.frames += 1;
        for (i, a) in left.iter().enumerate() {
            let row = self.moments.row_mut(i);
            for (sum, b) in row.into_iter().zip(&left) {
                *sum += a * b / energy;
            }
        }
    }

    /// The model error of the frames so far; its limit is infinite until it is calibrated. `None` for
    /// fewer than a hundred frames.
    pub fn model_error(&self) -> Option<ModelError> {
        if self.frames < 100 {
            return None;
        }
        let measurements = self.moments.nrows();
        let floor = FLOOR / measurements as f64;
        let (values, vectors) = eigen(self.moments.mapv(|v| v / self.frames as f64));
        let mut order: Vec<usize> = (0..measurements).filter(|&k| values[k] > floor).collect();
        order.sort_by(|&a, &b| values[b].total_cmp(&values[a]));
        order.truncate(DIRECTIONS);
        let directions = Array2::from_shape_fn((order.len(), measurements), |(k, i)| {
            (values[order[k]].sqrt() * vectors[[i, order[k]]]) as f32
        });
        Some(ModelError { directions, floor, limit: f64::INFINITY })
    }
}

/// Eigenvalues and eigenvectors (columns) of a symmetric matrix by cyclic Jacobi rotations (Golub and
/// Van Loan, Matrix Computations, section 8.5).
fn eigen(mut a: Array2<f64>) -> (Vec<f64>, Array2<f64>) {
    let n = a.nrows();
    let mut v = Array2::eye(n);
    let size = a.iter().map(|x| x * x).sum::<f64>();
    for _ in 0..SWEEPS {
        let off = a.indexed_iter().filter(|((i, j), _)| i != j).map(|(_, x)| x * x).sum::<f64>();
        if off <= 1e-24 * size {
            break;
        }
        for p in 0..n {
            for q in p + 1..n {
                if a[[p, q]] == 0.0 {
                    continue;
                }
                let tau = (a[[q, q]] - a[[p, p]]) / (2.0 * a[[p, q]]);
                let t = tau.signum() / (tau.abs() + tau.hypot(1.0));
                let c = 1.0 / t.hypot(1.0);
                let s = t * c;
                for k in 0..n {
                    let (x, y) = (a[[k, p]], a[[k, q]]);
                    (a[[k, p]], a[[k, q]]) = (c * x - s * y, s * x + c * y);
                    let (x, y) = (v[[k, p]], v[[k, q]]);
                    (v[[k, p]], v[[k, q]]) = (c * x - s * y, s * x + c * y);
                }
                for k in 0..n {
                    let (x, y) = (a[[p, k]], a[[q, k]]);
                    (a[[p, k]], a[[q, k]]) = (c * x - s * y, s * x + c * y);
                }
            }
        }
    }
    (a.diag().to_vec(), v)
}

/// Norm of residuals in units of noise and model error, with its working memory.
#[derive(Debug, Clone)]
pub struct ModelErrorNorm {
    error: ModelError,
    /// Measurements of the last frame, and the Cholesky factor of `floor I + U U'` over them.
    present: Vec<bool>,
    factor: Vec<f64>,
    products: Vec<f64>,
}

impl ModelErrorNorm {
    /// Reserves the memory.
    ///
    /// # Errors
    /// Those of [`ModelError::validate`].
    pub fn new(error: &ModelError) -> Result<Self, DenoiseError> {
        error.validate()?;
        let (directions, measurements) = error.directions.dim();
        let mut made = Self {
            error: error.clone(),
            present: vec![true; measurements],
            factor: vec![0.0; directions * directions],
            products: vec![0.0; directions],
        };
        made.factorise();
        Ok(made)
    }

    /// Largest fraction of the data's energy that a correct image leaves unexplained.
    pub fn limit(&self) -> f64 {
        self.error.limit
    }

    /// Score of an image by what it leaves of a frame's differences, all `[measurement]` in one unit;
    /// values of `left` that are not finite are missing measurements, `noise_std` is infinite for
    /// those that are not used. Up to 1 the image explains the frame.
    ///
    /// ```text
    /// score = q / (limit + 1.5 sum(std^2) / |dv|^2)
    /// q     = floor r' (U' U + floor I)^-1 r / |dv|^2
    /// ```
    ///
    /// `q` is the part of the data's energy that neither image nor model error explains; the other
    /// term is what noise may leave. Allocates nothing.
    ///
    /// # Errors
    /// [`DenoiseError::WrongLength`].
    pub fn score(
        &mut self,
        left: &[f64],
        differences: &[f64],
        noise_std: &[f64],
    ) -> Result<f64, DenoiseError> {
        let [unexplained, noise] = self.unexplained(left, differences, noise_std)?;
        Ok(unexplained / (self.error.limit + noise))
    }

    /// The parts `q` and `1.5 sum(std^2) / |dv|^2` of [`ModelErrorNorm::score`]; infinite and 0 for
    /// differences of zero that an image does not give.
    ///
    /// # Errors
    /// [`DenoiseError::WrongLength`].
    pub fn unexplained(
        &mut self,
        left: &[f64],
        differences: &[f64],
        noise_std: &[f64],
    ) -> Result<[f64; 2], DenoiseError> {
        let wanted = self.present.len();
        DenoiseError::check_length("residuals", left.len(), wanted)?;
        DenoiseError::check_length("differences", differences.len(), wanted)?;
        DenoiseError::check_length("noise levels", noise_std.len(), wanted)?;
        let is_present = |i: usize| left[i].is_finite() && noise_std[i].is_finite();
        if (0..wanted).any(|i| self.present[i] != is_present(i)) {
            (0..wanted).for_each(|i| self.present[i] = is_present(i));
            self.factorise();
        }
        let (mut energy, mut noise, mut whole) = (0.0, 0.0, 0.0);
        for i in (0..wanted).filter(|&i| self.present[i]) {
            energy += differences[i] * differences[i];
            noise += noise_std[i] * noise_std[i];
            whole += left[i] * left[i];
        }
        if energy.is_nan() || energy <= 0.0 {
            return Ok([if whole > 0.0 { f64::INFINITY } else { 0.0 }, 0.0]);
        }
        for (product, row) in self.products.iter_mut().zip(self.error.directions.rows()) {
            let values = row.iter().zip(left).zip(&self.present).filter(|(_, present)| **present);
            *product = values.map(|((u, r), _)| f64::from(*u) * r).sum();
        }
        let explained = self.forward_solved();
        let unexplained = (whole - explained).max(0.0) / energy;
        Ok([unexplained, 1.5 * noise / energy])
    }

    /// `p' (floor I + U U')^-1 p` of the products: solves with the factor in place.
    fn forward_solved(&mut self) -> f64 {
        let n = self.products.len();
        let mut sum = 0.0;
        for row in 0..n {
            let (done, rest) = self.products.split_at_mut(row);
            let factor = &self.factor[row * n..row * n + row];
            let known: f64 = factor.iter().zip(done.iter()).map(|(l, y)| l * y).sum();
            rest[0] = (rest[0] - known) / self.factor[row * n + row];
            sum += rest[0] * rest[0];
        }
        sum
    }

    /// Cholesky factor, row by row.
    fn factorise(&mut self) {
        let Self { error, present, factor, .. } = self;
        let n = error.directions.nrows();
        for row in 0..n {
            for column in 0..=row {
                let rows = [row, column].map(|k| error.directions.row(k));
                let values = rows[0].into_iter().zip(rows[1]).zip(present.iter());
                let inner: f64 = values
                    .filter(|(_, present)| **present)
                    .map(|((a, b), _)| f64::from(*a) * f64::from(*b))
                    .sum();
                let known: f64 =
                    (0..column).map(|k| factor[row * n + k] * factor[column * n + k]).sum();
                let value = inner - known;
                factor[row * n + column] = match row == column {
                    // rounding of f32 never takes more than the floor
                    true => (value + error.floor).max(0.5 * error.floor).sqrt(),
                    false => value / factor[column * n + column],
                };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests")]
    use super::*;

    /// Pseudo-random numbers around zero.
    fn noise(k: usize) -> f64 {
        ((k as f64 * 12.9898).sin() * 43_758.545).fract() - 0.5
    }

    #[test]
    fn eigenvectors_diagonalise() {
        let n = 12;
        let half = Array2::from_shape_fn((n, n), |(i, j)| noise(i * n + j));
        let matrix = half.dot(&half.t());
        let (values, vectors) = eigen(matrix.clone());
        let diagonal = vectors.t().dot(&matrix).dot(&vectors);
        for ((i, j), value) in diagonal.indexed_iter() {
            let wanted = if i == j { values[i] } else { 0.0 };
            assert!((value - wanted).abs() < 1e-10, "{i} {j}: {value} {wanted}");
        }
    }

    /// The norm equals its definition with the inverted covariance, with all measurements and with
    /// some missing; an error along a learnt direction is explained, another is not.
    #[test]
    fn the_norm_is_the_definition() {
        let n = 10;
        let mut sum = ModelErrorSum::new(n);
        let along = ndarray::Array1::from_shape_fn(n, |i| noise(i + 70));
        for f in 0..200 {
            let left = &along * noise(f) + ndarray::Array1::from_elem(n, 1e-4 * noise(f + 1));
            sum.add(left.view(), ndarray::Array1::ones(n).view());
        }
        let error = ModelError { limit: 0.2, ..sum.model_error().unwrap() };
        let mut norm = ModelErrorNorm::new(&error).unwrap();
        let (ones, std) = (vec![1.0; n], vec![0.01; n]);
        let u = error.directions.mapv(f64::from);
        for missing in [vec![], vec![3], vec![0, 4, 9]] {
            let mut left: Vec<f64> = (0..n).map(|i| noise(i + 300)).collect();
            missing.iter().for_each(|&i| left[i] = f64::NAN);
            let kept: Vec<usize> = (0..n).filter(|i| !missing.contains(i)).collect();
            let covariance = Array2::from_shape_fn((kept.len(), kept.len()), |(i, j)| {
                let inner = u.column(kept[i]).dot(&u.column(kept[j]));
                inner + if i == j { error.floor } else { 0.0 }
            });
            let (values, vectors) = eigen(covariance);
            let r = ndarray::Array1::from_iter(kept.iter().map(|&i| left[i]));
            let turned = vectors.t().dot(&r);
            let q: f64 = turned.iter().zip(&values).map(|(t, l)| error.floor * t * t / l).sum();
            let kept = kept.len() as f64;
            let wanted = q / kept / (0.2 + 1.5 * 1e-4);
            let found = norm.score(&left, &ones, &std).unwrap();
            assert!((found / wanted - 1.0).abs() < 1e-4, "{missing:?}: {found} {wanted}");
        }
        let score =
            |norm: &mut ModelErrorNorm, left: &[f64]| norm.score(left, &ones, &std).unwrap();
        assert!(score(&mut norm, &along.to_vec()) < 0.1);
        let across: Vec<f64> =
            (0..n).map(|i| if i % 2 == 0 { along[i ^ 1] } else { -along[i ^ 1] }).collect();
        assert!(score(&mut norm, &across) > 0.3);
        assert!(norm.score(&[0.0], &ones, &std).is_err());
    }

    #[test]
    fn few_frames_give_no_model_error() {
        let mut sum = ModelErrorSum::new(3);
        let one = ndarray::Array1::ones(3);
        (0..99).for_each(|_| sum.add(one.view(), one.view()));
        // frames without some of their measurements do not count
        sum.add(ndarray::Array1::from_elem(3, f64::NAN).view(), one.view());
        assert!(sum.model_error().is_none());
        sum.add(one.view(), one.view());
        let error = sum.model_error().unwrap();
        assert_eq!(error.directions.nrows(), 1);
        assert!(error.validate().is_err(), "not calibrated yet");
    }
}
