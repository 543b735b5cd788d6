//! Linear problem in the eigenvectors of its whitened covariance, where it decouples into scalar
//! problems.
//!
//! ```text
//! b = W^1/2 dv,   W^1/2 J dsigma ~ N(0, A),   A = W^1/2 J P J' W^1/2 = U D U',   noise ~ N(0, mu I)
//! a = D^-1/2 U' W^1/2 J dsigma ~ N(0, I)      the amplitudes of an image, [rank]
//! E[dsigma | a] = P J' W^1/2 U D^-1/2 a = B D^-1/2 a
//! ```
//!
//! with `mu = lambda^2 s`, see [`OneStepGaussNewton`](crate::OneStepGaussNewton). With a sequence
//! covariance `K (x) P` the form is the same, with covariance `K` between the frames of every
//! amplitude. The part of an image that the measurements do not sense is independent of the
//! amplitudes and stays zero. Source of the covariance `K (x) P`: Adler, Dai, Lionheart,
//! *Physiol. Meas.* 28 (2007), S1-S11.

use crate::check::check_positive;
use crate::data::Channels;
use crate::one_step::Spectrum;
use crate::one_step::{covariance_times, weighted_rows};
use crate::{DifferenceFrames, InverseError, OneStepSettings, Prior};
use faer::linalg::matmul::matmul;
use faer::{Accum, ColMut, ColRef, Mat, MatMut, MatRef, Par};
use ndarray::{Array2, ArrayRef2};

/// Whitened linear problem and its eigen-expansion.
#[derive(Debug, Clone)]
pub(super) struct Modes {
    pub(super) channels: Channels,
    /// `U`, `[used measurement, rank]`.
    pub(super) vectors: Mat<f64>,
    /// Diagonal of `D^1/2`, `[rank]`.
    pub(super) gains: Vec<f64>,
    /// `mu = lambda^2 s`.
    pub(super) noise_variance: f64,
    /// `B = P J' W^1/2 U`, `[element, rank]`.
    image_basis: Mat<f64>,
}

impl Modes {
    /// Sets up the problem in `m^2 n + m r^2 + 2 m n r` flops in addition to the prior's `J P`.
    pub(super) fn new(
        jacobian: &ArrayRef2<f64>,
        prior: &dyn Prior,
        settings: &OneStepSettings,
    ) -> Result<Self, InverseError> {
        let (measurements, elements) = jacobian.dim();
        if measurements == 0 || elements == 0 {
            return Err(InverseError::EmptyJacobian { measurements, elements });
        }
        check_positive("hyperparameter", settings.hyperparameter)?;
        let channels = settings.channels(measurements)?;
        let used = channels.used.len();
        let weighted = weighted_rows(jacobian, &channels)?;
        let covariance = covariance_times(prior, &weighted, elements)?;
        let covariance = MatRef::from_row_major_slice(&covariance, used, elements);
        let jacobian = MatRef::from_row_major_slice(&weighted, used, elements);
        let spectrum = Spectrum::new(jacobian, covariance, prior.name())?;
        let noise_variance = spectrum.damping(settings.hyperparameter);
        check_positive("square of the hyperparameter times s", noise_variance)?;
        Ok(Self {
            noise_variance,
            gains: spectrum.values.iter().map(|d| d.sqrt()).collect(),
            image_basis: covariance.transpose() * &spectrum.vectors,
            vectors: spectrum.vectors,
            channels,
        })
    }

    pub(super) fn rank(&self) -> usize {
        self.gains.len()
    }

    pub(super) fn elements(&self) -> usize {
        self.image_basis.nrows()
    }

    /// Applies [`whiten`] to a sequence; returns the data `[used, frame]` and the masked indices of
    /// each frame.
    pub(super) fn whiten_all(
        &self,
        frames: &DifferenceFrames<'_>,
    ) -> Result<(Mat<f64>, Vec<Vec<usize>>), InverseError> {
        frames.check_shape(self.channels.count)?;
        let count = frames.values.nrows();
        let mut whitened = Mat::zeros(self.channels.used.len(), count);
        let masked: Result<Vec<_>, _> = (0..count)
            .map(|t| whiten(&self.channels, frames, t, whitened.col_as_slice_mut(t)))
            .collect();
        Ok((whitened, masked?))
    }

    /// Computes `U' b`, `[rank]`.
    pub(super) fn project(&self, whitened: &[f64], coefficients: &mut [f64]) {
        let (b, c) = (ColRef::from_slice(whitened), ColMut::from_slice_mut(coefficients));
        matmul(c, Accum::Replace, self.vectors.transpose(), b, 1.0, Par::Seq);
    }

    /// Returns the images `[frame, element]` of amplitudes `[rank, frame]`.
    pub(super) fn images(&self, amplitudes: &Mat<f64>) -> Array2<f64> {
        let coefficients = Mat::from_fn(self.rank(), amplitudes.ncols(), |k, t| {
            amplitudes[(k, t)] / self.gains[k]
        });
        let mut images = Array2::zeros((amplitudes.ncols(), self.elements()));
        if let Some(values) = images.as_slice_mut() {
            let images =
                MatMut::from_column_major_slice_mut(values, self.elements(), amplitudes.ncols());
            matmul(images, Accum::Replace, &self.image_basis, &coefficients, 1.0, Par::Seq);
        }
        images
    }

    /// Returns `|W^1/2 (J dsigma_t - dv_t)|` over the channels that are not masked, `[frame]`, in
    /// standard deviations if `noise_std` is given. `W^1/2 J dsigma = U D^1/2 a`.
    pub(super) fn residuals(
        &self,
        amplitudes: &Mat<f64>,
        whitened: &Mat<f64>,
        masked: &[Vec<usize>],
    ) -> Vec<f64> {
        let scaled = Mat::from_fn(self.rank(), amplitudes.ncols(), |k, t| {
            amplitudes[(k, t)] * self.gains[k]
        });
        let mut misfit = &self.vectors * &scaled - whitened;
        for (t, masked) in masked.iter().enumerate() {
            masked.iter().for_each(|&k| misfit[(k, t)] = 0.0);
        }
        let unit = self.channels.noise_scale.unwrap_or(1.0);
        misfit.col_iter().map(|column| column.norm_l2() / unit).collect()
    }

    /// Returns the same problem at the same `mu` without the measurements `masked`, and the indices of
    /// the others, which its data consists of in this order. Costs `m r^2 + 2 n r^2` flops.
    pub(super) fn without(&self, masked: &[usize]) -> Result<(Self, Vec<usize>), InverseError> {
        let mut used = vec![false; self.channels.count];
        self.channels.used.iter().for_each(|&i| used[i] = true);
        masked.iter().for_each(|&k| used[self.channels.used[k]] = false);
        let (channels, kept) = self.channels.restrict(&used)?;
        let factor = Mat::from_fn(kept.len(), self.rank(), |i, k| {
            self.vectors[(kept[i], k)] * self.gains[k]
        });
        let spectrum = Spectrum::from_factor(factor.as_ref())?;
        // P J' W^1/2 of the kept measurements is B U' of their rows
        let rows = Mat::from_fn(kept.len(), self.rank(), |i, k| self.vectors[(kept[i], k)]);
        let image_basis = &self.image_basis * (rows.transpose() * &spectrum.vectors);
        let gains = spectrum.values.iter().map(|d| d.sqrt()).collect();
        let noise_variance = self.noise_variance;
        let modes =
            Self { channels, vectors: spectrum.vectors, gains, noise_variance, image_basis };
        Ok((modes, kept))
    }
}

/// Writes `b = W^1/2 dv` of frame `t` to `whitened` `[used]`, with zeros for masked channels, and returns
/// the indices of these zeros, ascending. Unused and masked measurements are not read.
pub(super) fn whiten(
    channels: &Channels,
    frames: &DifferenceFrames<'_>,
    t: usize,
    whitened: &mut [f64],
) -> Result<Vec<usize>, InverseError> {
    let mut masked = Vec::new();
    let rows = channels.used.iter().zip(&channels.root_weights);
    for (k, (b, (&measurement, weight))) in whitened.iter_mut().zip(rows).enumerate() {
        if !frames.is_good(t, measurement) {
            masked.push(k);
            *b = 0.0;
            continue;
        }
        let value = frames.values[(t, measurement)];
        *b = weight * value;
        if !b.is_finite() {
            return Err(InverseError::NonFiniteData { frame: t, measurement, value });
        }
    }
    Ok(masked)
}
