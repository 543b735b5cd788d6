//! Data consistency: whether an image explains the measurements behind it.
//!
//! A net reproduces what it has learnt, even from images unlike any it has seen. The linearised model can
//! tell: it maps a correct image to most of the measured differences, and an invented one not. One product of `measurements x pixels` per frame,
//! 0.7 million multiplications for 208 and 3 200, in `f32`.

use crate::DenoiseError;
use ndarray::{Array2, ArrayView2};

/// How far above its mean the energy of noise alone may lie, in standard deviations. With 208
/// measurements and a known noise level, one frame in six thousand lies higher (chi squared, not
/// normal); more do if the level was measured on few quiet frames.
const NOISE_DEVIATIONS: f64 = 4.0;

/// Checks images against their measurements with the linear model of a skin, weighted by the noise.
#[derive(Debug, Clone)]
pub struct DataConsistency {
    /// `W^1/2 J`, `[measurement][masked pixel]`, row by row.
    rows: Vec<f32>,
    /// `W^1/2`; 0 for a measurement that is not used.
    root_weights: Vec<f64>,
    mask: Array2<bool>,
    /// Masked pixels of the current image.
    pixels: Vec<f32>,
}

/// Energies of a frame in units of the noise: sums of squares over the used measurements.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct DataMisfit {
    /// `|W^1/2 dv|^2`.
    pub data: f64,
    /// Residual of the image: `|W^1/2 (dv - J x)|^2`.
    pub residual: f64,
    /// Number of used measurements.
    pub measurements: usize,
}

impl DataConsistency {
    /// Prepares the check for images on `mask` [row, column]. `jacobian` [measurement, masked pixel in
    /// row-major order] is in the differences' unit per image unit, `noise_std` the standard deviation of
    /// each difference, infinite for a measurement that is not used.
    ///
    /// # Errors
    /// [`DenoiseError::WrongLength`], [`DenoiseError::EmptyMask`]; [`DenoiseError::OutOfRange`] for
    /// a deviation that is not positive, or a sensitivity of a used measurement that is not finite.
    pub fn new(
        jacobian: ArrayView2<'_, f64>,
        noise_std: &[f64],
        mask: ArrayView2<'_, bool>,
    ) -> Result<Self, DenoiseError> {
        let inside = mask.iter().filter(|inside| **inside).count();
        if inside == 0 {
            let (rows, columns) = mask.dim();
            return Err(DenoiseError::EmptyMask { rows, columns });
        }
        let (measurements, pixels) = jacobian.dim();
        DenoiseError::check_length("pixels of the Jacobian", pixels, inside)?;
        DenoiseError::check_length("noise levels", noise_std.len(), measurements)?;
        let must = "above zero; infinite where a value is not used";
        let mut levels = noise_std.iter();
        levels.try_for_each(|&std| DenoiseError::check_range(std > 0.0, "noise", std, must))?;
        let root_weights: Vec<f64> = noise_std.iter().map(|std| 1.0 / std).collect();
        let mut rows = Vec::with_capacity(measurements * pixels);
        for (row, &weight) in jacobian.rows().into_iter().zip(&root_weights) {
            // whatever stands in a row that is not used
            let of = |j: &f64| if weight == 0.0 { 0.0 } else { (weight * j) as f32 };
            rows.extend(row.iter().map(of));
        }
        rows.iter().try_for_each(|&value: &f32| {
            let quantity = "sensitivity over noise";
            DenoiseError::check_range(value.is_finite(), quantity, f64::from(value), "finite")
        })?;
        Ok(Self { rows, root_weights, mask: mask.to_owned(), pixels: vec![0.0; inside] })
    }

    /// Energy of a frame's differences in units of the noise, which is the residual of an empty
    /// image; a value that is not finite is a missing measurement. Does not allocate.
    ///
    /// # Errors [`DenoiseError::WrongLength`].
    pub fn energy(&self, differences: &[f64]) -> Result<DataMisfit, DenoiseError> {
        DenoiseError::check_length("differences", differences.len(), self.root_weights.len())?;
        let mut energy = DataMisfit { data: 0.0, residual: 0.0, measurements: 0 };
        for (weight, difference) in self.root_weights.iter().zip(differences) {
            if *weight != 0.0 && difference.is_finite() {
                energy.data += (weight * difference).powi(2);
                energy.measurements += 1;
            }
        }
        energy.residual = energy.data;
        Ok(energy)
    }

    /// Returns the energies of a frame's differences and of the residual of an image [row, column];
    /// a value that is not finite is a missing measurement. Does not allocate.
    ///
    /// # Errors
    ///
    /// [`DenoiseError::ShapeMismatch`], [`DenoiseError::WrongLength`];
    /// [`DenoiseError::NonFinitePixel`] of frame 0.
    pub fn misfit(
        &mut self,
        image: ArrayView2<'_, f64>,
        differences: &[f64],
    ) -> Result<DataMisfit, DenoiseError> {
        let mut misfit = DataMisfit { data: 0.0, residual: 0.0, measurements: 0 };
        self.each_left(image, differences, |_, weight, difference, left| {
            misfit.data += (weight * difference).powi(2);
            misfit.residual += left * left;
            misfit.measurements += 1;
        })?;
        Ok(misfit)
    }

    /// Writes the residual of an image [row, column] for a frame, in the differences' unit; NaN for
    /// a measurement that is missing or not used. Does not allocate.
    ///
    /// # Errors
    ///
    /// Those of [`DataConsistency::misfit`].
    pub fn left_into(
        &mut self,
        image: ArrayView2<'_, f64>,
        differences: &[f64],
        out: &mut [f64],
    ) -> Result<(), DenoiseError> {
        DenoiseError::check_length("residuals", out.len(), self.root_weights.len())?;
        out.fill(f64::NAN);
        self.each_left(image, differences, |i, weight, _, left| out[i] = left / weight)
    }

    /// Passes each present measurement to `take`: index, root of the weight, difference, and weighted
    /// residual.
    fn each_left(
        &mut self,
        image: ArrayView2<'_, f64>,
        differences: &[f64],
        mut take: impl FnMut(usize, f64, f64, f64),
    ) -> Result<(), DenoiseError> {
        DenoiseError::check_size(image.dim(), self.mask.dim())?;
        DenoiseError::check_length("differences", differences.len(), self.root_weights.len())?;
        let bad = image.indexed_iter().find(|(at, v)| self.mask[*at] && !v.is_finite());
        if let Some(((row, column), &value)) = bad {
            return Err(DenoiseError::NonFinitePixel { frame: 0, row, column, value });
        }
        // images in siemens need scaling to fit the range of f32
        let inside =
            || image.iter().zip(&self.mask).filter(|(_, inside)| **inside).map(|(v, _)| *v);
        let scale = inside().fold(0.0_f64, |most, v| v.abs().max(most));
        let scale = if scale > 0.0 { scale } else { 1.0 };
        for (pixel, value) in self.pixels.iter_mut().zip(inside()) {
            *pixel = (value / scale) as f32;
        }
        let rows = self.rows.chunks_exact(self.pixels.len());
        let measurements = rows.zip(&self.root_weights).zip(differences).enumerate();
        for (i, ((row, &weight), &difference)) in measurements {
            if weight != 0.0 && difference.is_finite() {
                let left = weight * difference - scale * f64::from(dot(row, &self.pixels));
                take(i, weight, difference, left);
            }
        }
        Ok(())
    }
}

/// Sixteen independent sums, so that the compiler can use registers of any width.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let (a, a_rest) = a.as_chunks::<16>();
    let (b, b_rest) = b.as_chunks::<16>();
    let mut sums = [0.0_f32; 16];
    for (a, b) in a.iter().zip(b) {
        for i in 0..16 {
            sums[i] += a[i] * b[i];
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f32>() + rest
}

impl DataMisfit {
    /// Largest energy expected of noise alone: `n + 4 sqrt(2 n)`, the mean of chi squared with `n` degrees
    /// of freedom plus four standard deviations.
    fn noise_bound(&self) -> f64 {
        let n = self.measurements as f64;
        n + NOISE_DEVIATIONS * (2.0 * n).sqrt()
    }

    /// Returns the residual over its bound, which is the share `limit` of the data's energy or the noise bound,
    /// whichever is larger. Up to 1 the image is consistent with its data. Infinite without a
    /// measurement.
    pub fn score(&self, limit: f64) -> f64 {
        if self.measurements == 0 {
            return f64::INFINITY;
        }
        self.residual / (limit * self.data).max(self.noise_bound())
    }
}
