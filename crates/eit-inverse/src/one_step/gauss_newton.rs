//! One-step difference Gauss-Newton.

use super::hyperparameter::{ChosenHyperparameter, HyperparameterChoice, HyperparameterStatus};
use super::report::OneStepReport;
use super::spectrum::Spectrum;
use super::whitened::{covariance_times, weighted_rows};
use crate::check::check_positive;
use crate::data::Channels;
use crate::{InverseError, OneStepSettings, Prior, Reconstructor};
use eit_core::event;
use eit_mesh::CsrMatrix;
use faer::linalg::matmul::matmul;
use faer::{Accum, ColRef, Mat, MatMut, MatRef, Par};
use ndarray::ArrayRef2;
use std::ops::Deref;
use std::time::Instant;

/// One-step difference reconstruction: the maximum a posteriori conductivity change for Gaussian
/// noise and a Gaussian prior.
///
/// ```text
/// image = argmin  |dv - J dsigma|_W^2 + lambda^2 s |dsigma|_R^2  =  RM dv
/// RM = P J' (J P J' + lambda^2 s W^-1)^-1  =  (J' W J + lambda^2 s R)^-1 J' W
/// s  = trace(W^1/2 J P J' W^1/2) / m
/// ```
///
/// with `J` the Jacobian `[measurement, element]` (rows divided by the model voltages for
/// normalised data), `W^-1` the noise covariance, `P = R^-1` the prior covariance and `m` the used
/// measurements. The scale `s` makes lambda dimensionless and comparable between scenes: lambda is
/// the ratio of noise to expected signal per measurement, whatever the units of conductivity, drive
/// current, noise and prior. (If reciprocal measurements are merged into one of double weight, `s`
/// doubles: lambda must then be smaller by a factor of the root of 2 for the same image.)
/// `RM` is computed in the first form, in measurement space (`m x m`, not `n x n`), from one
/// eigen-expansion, so changing lambda costs `O(r m)`.
///
/// Set-up cost: the prior's `J P`, `m^2 n` flops for `J P J'`, `m r^2` for its spectrum of rank `r`,
/// `2 m n r` for the image basis.
///
/// Source: Adler, Guardo, *IEEE Trans. Med. Imaging* 15 (1996), 170-179; the measurement-space
/// form: Adler, Dai, Lionheart, *Physiol. Meas.* 28 (2007), S1-S11.
#[derive(Debug, Clone)]
pub struct OneStepGaussNewton {
    reconstructor: Reconstructor,
    pub(crate) spectrum: Spectrum,
    report: OneStepReport,
}

impl OneStepGaussNewton {
    /// Computes the reconstruction for a Jacobian.
    ///
    /// `jacobian` is `[measurement, element]`, volts per siemens (per square), in protocol order.
    ///
    /// # Errors
    /// Returns an error if the Jacobian is empty, not finite or zero; if settings have the wrong
    /// length or are out of range; or if the prior belongs to another mesh.
    pub fn new(
        jacobian: &ArrayRef2<f64>,
        prior: &dyn Prior,
        settings: OneStepSettings,
    ) -> Result<Self, InverseError> {
        let (measurements, elements) = jacobian.dim();
        if measurements == 0 || elements == 0 {
            return Err(InverseError::EmptyJacobian { measurements, elements });
        }
        check_positive("hyperparameter", settings.hyperparameter)?;
        let channels = settings.channels(measurements)?;
        let start = Instant::now();
        let weighted = weighted_rows(jacobian, &channels)?;
        let used = channels.used.len();
        let covariance = covariance_times(prior, &weighted, elements)?;
        let prior_s = start.elapsed().as_secs_f64();

        let start = Instant::now();
        let covariance = MatRef::from_row_major_slice(&covariance, used, elements);
        let jacobian = MatRef::from_row_major_slice(&weighted, used, elements);
        let spectrum = Spectrum::new(jacobian, covariance, prior.name())?;
        let spectrum_s = start.elapsed().as_secs_f64();

        let start = Instant::now();
        let image_basis = product(covariance.transpose(), spectrum.vectors.as_ref());
        let basis_s = start.elapsed().as_secs_f64();
        let times = [prior_s, spectrum_s, basis_s];
        Ok(Self::assemble(
            prior.name(),
            channels,
            spectrum,
            image_basis,
            settings.hyperparameter,
            times,
        ))
    }

    /// Returns the same reconstruction with fewer measurements, for example after the instrument
    /// flags a channel.
    ///
    /// The result equals [`OneStepGaussNewton::new`] with `used`, but is computed from the spectrum
    /// alone: `m r^2 + 2 n r^2` flops, and the prior is not evaluated again. `used` is
    /// `[measurement]`. Measurements excluded earlier cannot be restored; keep the full
    /// reconstruction for that. The hyperparameter is unchanged. For a few masked values in single
    /// frames [`Reconstructor::reconstruct_masked_into`] is far cheaper.
    ///
    /// # Errors
    /// Returns an error if `used` has the wrong length or excludes every measurement, and
    /// [`InverseError::NotAvailable`] if it requests a measurement excluded earlier.
    pub fn restricted_to(&self, used: &[bool]) -> Result<Self, InverseError> {
        let (channels, kept) = self.reconstructor.channels.restrict(used)?;
        let start = Instant::now();
        let spectrum = Spectrum::from_factor(self.spectrum.factor_of(&kept).as_ref())?;
        // P J' W^1/2 of the kept measurements is B U' of their rows
        let rows = Mat::from_fn(kept.len(), self.spectrum.values.len(), |i, k| {
            self.spectrum.vectors[(kept[i], k)]
        });
        let spectrum_s = start.elapsed().as_secs_f64();
        let start = Instant::now();
        let turn = rows.transpose() * &spectrum.vectors;
        let image_basis = product(self.reconstructor.image_rows(), turn.as_ref());
        let times = [0.0, spectrum_s, start.elapsed().as_secs_f64()];
        let OneStepReport { prior, hyperparameter, .. } = self.report;
        Ok(Self::assemble(prior, channels, spectrum, image_basis, hyperparameter, times))
    }

    fn assemble(
        prior: &'static str,
        channels: Channels,
        spectrum: Spectrum,
        image_basis: Vec<f64>,
        hyperparameter: f64,
        times_s: [f64; 3],
    ) -> Self {
        let rank = spectrum.values.len();
        let report = OneStepReport {
            prior,
            measurements: channels.count,
            measurements_used: channels.used.len(),
            elements: image_basis.len() / rank,
            rank,
            condition: spectrum.values[0] / spectrum.values[rank - 1],
            scale: spectrum.scale,
            noise_scale: channels.noise_scale,
            hyperparameter,
            hyperparameter_status: HyperparameterStatus::Given,
            degrees_of_freedom: spectrum.degrees_of_freedom(hyperparameter),
            prior_s: times_s[0],
            spectrum_s: times_s[1],
            basis_s: times_s[2],
        };
        event!(
            DEBUG,
            "set up one-step reconstruction",
            prior = report.prior,
            measurements_used = report.measurements_used,
            elements = report.elements,
            rank = report.rank,
            condition = report.condition,
            prior_s = report.prior_s,
            spectrum_s = report.spectrum_s,
            basis_s = report.basis_s,
        );
        let reconstructor = Reconstructor::new(channels, image_basis, &spectrum, hyperparameter);
        Self { reconstructor, spectrum, report }
    }

    /// Returns the sizes, the conditioning and the set-up times of this reconstruction.
    pub fn report(&self) -> &OneStepReport {
        &self.report
    }

    /// Sets lambda and changes nothing else. Costs `r m` multiplications.
    ///
    /// # Errors
    /// [`InverseError::OutOfRange`] unless finite and above zero.
    pub fn set_hyperparameter(&mut self, hyperparameter: f64) -> Result<(), InverseError> {
        check_positive("hyperparameter", hyperparameter)?;
        self.apply(hyperparameter, HyperparameterStatus::Given);
        Ok(())
    }

    /// Sets lambda so that the prior has the same weight as in another reconstruction: `lambda^2 s`
    /// in units of the noise, and so the expected variance of an image, are equal in both.
    ///
    /// Use it for transformed data of the same skin, such as data projected by
    /// [`NuisanceParameters`](crate::NuisanceParameters). Such data has a different scale `s`, and
    /// its noise figure is not a useful criterion: it has lost signal, so an image with the same
    /// signal-to-noise ratio as this data is noisier than an image of the original data.
    ///
    /// # Errors
    /// See [`set_hyperparameter`](Self::set_hyperparameter).
    pub fn set_prior_of(&mut self, other: &Self) -> Result<(), InverseError> {
        let unit =
            |report: &OneStepReport| report.scale / report.noise_scale.unwrap_or(1.0).powi(2);
        let ratio = unit(&other.report) / unit(&self.report);
        self.set_hyperparameter(other.report.hyperparameter * ratio.sqrt())
    }

    /// Chooses lambda by a rule and sets it.
    ///
    /// # Errors
    /// Returns an error if data or areas have the wrong length, and [`InverseError::NoDifference`]
    /// if the data contains no signal.
    pub fn choose_hyperparameter(
        &mut self,
        choice: &HyperparameterChoice<'_>,
    ) -> Result<ChosenHyperparameter, InverseError> {
        let chosen = choice.evaluate(&self.reconstructor, &self.spectrum)?;
        self.apply(chosen.hyperparameter, chosen.status);
        Ok(chosen)
    }

    fn apply(&mut self, hyperparameter: f64, status: HyperparameterStatus) {
        self.reconstructor.set_hyperparameter(&self.spectrum, hyperparameter);
        self.report.hyperparameter = hyperparameter;
        self.report.hyperparameter_status = status;
        self.report.degrees_of_freedom = self.spectrum.degrees_of_freedom(hyperparameter);
    }

    /// Returns the map from frames to element images.
    pub fn reconstructor(&self) -> &Reconstructor {
        &self.reconstructor
    }

    /// Returns the map from frames directly to pixels, using `pixel_from_element`
    /// `[pixel, element]` of a raster (`eit_mesh::Raster::pixel_from_element`) and the current
    /// hyperparameter.
    ///
    /// A frame then costs `2 r (m + pixels)` flops: no element image is formed.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`] if the raster belongs to another mesh.
    pub fn on_raster(&self, pixel_from_element: &CsrMatrix) -> Result<Reconstructor, InverseError> {
        self.reconstructor.followed_by(pixel_from_element)
    }

    /// Returns the relative residual of the image, `|dv - J dsigma|_W / |dv|_W`, between 0 and 1.
    ///
    /// Computed from the spectrum in `O(r m)`. Returns `None` if frame and reference frame are equal
    /// in all used measurements.
    ///
    /// # Errors
    /// See [`Reconstructor::difference`].
    pub fn relative_residual(
        &self,
        frame: &[f64],
        reference_frame: &[f64],
    ) -> Result<Option<f64>, InverseError> {
        let difference = self.reconstructor.difference(frame, reference_frame)?;
        let largest = difference.iter().fold(0.0_f64, |m, dv| m.max(dv.abs()));
        if largest == 0.0 {
            return Ok(None);
        }
        // scale by the largest value to prevent overflow and underflow of the squares
        let weights = &self.reconstructor.channels.root_weights;
        let whitened: Vec<f64> =
            difference.iter().zip(weights).map(|(dv, w)| dv / largest * w).collect();
        let data = ColRef::from_slice(&whitened).as_mat();
        let parts = self.spectrum.decompose(data);
        let norm = parts.squared_norm();
        let residual = parts.squared_residual(&self.spectrum, self.report.hyperparameter);
        Ok(Some((residual / norm).sqrt()))
    }
}

/// The map from frames to images on elements, which this reconstruction is.
impl Deref for OneStepGaussNewton {
    type Target = Reconstructor;

    fn deref(&self) -> &Reconstructor {
        &self.reconstructor
    }
}

/// `a b`, row-major.
fn product(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Vec<f64> {
    let (rows, columns) = (a.nrows(), b.ncols());
    let mut values = vec![0.0; rows * columns];
    let target = MatMut::from_row_major_slice_mut(&mut values, rows, columns);
    matmul(target, Accum::Replace, a, b, 1.0, Par::Seq);
    values
}
