//! One-step Gauss-Newton, frame by frame.

use crate::one_step::weighted_rows;
use crate::{
    Chosen, Difference, DifferenceSettings, Differences, HyperparameterChoice, InverseError, Movie,
    MovieMethod, MovieReport, MovieStatus, Prior, Workspace,
};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
use ndarray::{Array2, ArrayRef2};
use std::time::Instant;

/// [`Difference`] on every frame of a sequence, none knowing of the others.
///
/// Movies are `[frame, element]`, siemens (per square). Channels that are masked in a frame are left
/// out of it exactly ([`Reconstructor::reconstruct_without_into`]); a frame without a good channel
/// gets the image zero, which is the prior's. `2 r (m + n)` flops a frame, and `2 m n` for the
/// residual, which is computed from the Jacobian itself.
///
/// For normalised data a frame with masked channels is rounded at `1 + dv`: 1e-16 of the reference.
///
/// [`Reconstructor::reconstruct_without_into`]: crate::Reconstructor::reconstruct_without_into
#[derive(Debug, Clone)]
pub struct OneStep {
    difference: Difference,
    workspace: Workspace,
    /// `W^1/2 J`, row-major `[used, element]`.
    weighted_jacobian: Vec<f64>,
    /// Difference data of one frame: `[used]`, or `[measurement]` where some are masked.
    values: Vec<f64>,
    bad: Vec<usize>,
}

impl OneStep {
    /// Set-up for a linearisation; `jacobian` is `[measurement, element]`, volts per siemens.
    ///
    /// Costs what [`Difference::new`] does.
    ///
    /// # Errors
    /// As there.
    pub fn new(
        jacobian: &ArrayRef2<f64>,
        prior: &dyn Prior,
        settings: &DifferenceSettings,
    ) -> Result<Self, InverseError> {
        let difference = Difference::new(jacobian, prior, settings.clone())?;
        let weighted_jacobian = weighted_rows(jacobian, &difference.reconstructor().channels)?;
        let workspace = difference.workspace();
        let (values, bad) = (Vec::new(), Vec::new());
        Ok(Self { difference, workspace, weighted_jacobian, values, bad })
    }

    /// The reconstruction of one frame, with its report.
    pub fn difference(&self) -> &Difference {
        &self.difference
    }

    /// Chooses lambda by a rule and sets it, see [`Difference::choose_hyperparameter`].
    ///
    /// # Errors
    /// As there.
    pub fn choose_hyperparameter(
        &mut self,
        choice: &HyperparameterChoice<'_>,
    ) -> Result<Chosen, InverseError> {
        self.difference.choose_hyperparameter(choice)
    }

    fn frame(
        &mut self,
        frames: &Differences<'_>,
        t: usize,
        image: &mut [f64],
    ) -> Result<(), InverseError> {
        let Self { difference, workspace, values, bad, .. } = self;
        let (row, map) = (frames.values.row(t), difference.reconstructor());
        let channels = &map.channels;
        bad.clear();
        bad.extend(channels.used.iter().filter(|&&i| !frames.is_good(t, i)));
        if bad.len() == channels.used.len() {
            image.fill(0.0);
            return Ok(());
        }
        values.clear();
        let result = if bad.is_empty() {
            values.extend(channels.used.iter().map(|&i| row[i]));
            map.reconstruct_difference_into(values, workspace, image)
        } else {
            // (1 + dv - 1) / 1 for normalised data, dv - 0 for plain
            let reference = if channels.normalised() { 1.0 } else { 0.0 };
            values.extend(row.iter().map(|dv| reference + dv));
            let references = vec![reference; values.len()];
            map.reconstruct_without_into(values, &references, bad, workspace, image)
        };
        // the reconstruction of one frame knows no other
        result.map(|_| ()).map_err(|error| match error {
            InverseError::NonFiniteData { measurement, .. } => {
                InverseError::NonFiniteData { frame: t, measurement, value: row[measurement] }
            }
            other => other,
        })
    }

    /// `|W^1/2 (J dsigma_t - dv_t)|` over good channels.
    fn residuals(&self, frames: &Differences<'_>, images: &Array2<f64>) -> Vec<f64> {
        let channels = &self.difference.reconstructor().channels;
        let (used, elements) = (channels.used.len(), images.ncols());
        let jacobian = MatRef::from_row_major_slice(&self.weighted_jacobian, used, elements);
        let mut predicted = Mat::zeros(used, images.nrows());
        if let Some(values) = images.as_slice() {
            let images = MatRef::from_column_major_slice(values, elements, images.nrows());
            matmul(predicted.as_mut(), Accum::Replace, jacobian, images, 1.0, Par::Seq);
        }
        let unit = channels.noise_scale.unwrap_or(1.0);
        let rows = || channels.used.iter().zip(&channels.root_weights).enumerate();
        let norm = |t: usize| {
            let good = rows().filter(|(_, (i, _))| frames.is_good(t, **i));
            good.map(|(k, (&i, w))| (predicted[(k, t)] - w * frames.values[(t, i)]).powi(2))
                .sum::<f64>()
                .sqrt()
        };
        (0..images.nrows()).map(|t| norm(t) / unit).collect()
    }
}

impl MovieMethod for OneStep {
    fn name(&self) -> &'static str {
        "one-step"
    }

    /// # Errors
    /// Besides those of the trait, [`InverseError::LeftOutDominates`] where lambda is too small to
    /// leave the masked channels out.
    fn reconstruct(&mut self, frames: &Differences<'_>) -> Result<Movie, InverseError> {
        let start = Instant::now();
        frames.check_shape(self.difference.reconstructor().measurements())?;
        let elements = self.difference.report().elements;
        let mut images = Array2::zeros((frames.values.nrows(), elements));
        for (t, mut image) in images.rows_mut().into_iter().enumerate() {
            if let Some(image) = image.as_slice_mut() {
                self.frame(frames, t, image)?;
            }
        }
        let report = MovieReport {
            method: self.name(),
            status: MovieStatus::Direct,
            iterations: 0,
            residual: self.residuals(frames, &images),
            seconds: start.elapsed().as_secs_f64(),
            certificate: None,
            trace: Vec::new(),
        };
        Ok(Movie { images, report })
    }
}
