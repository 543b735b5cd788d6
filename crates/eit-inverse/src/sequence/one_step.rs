//! One-step Gauss-Newton, frame by frame.

use crate::{
    DifferenceFrames, FrameStatus, ImageSequence, InverseError, OneStepGaussNewton, SequenceReport,
    SequenceSolver, Workspace,
};
use faer::Col;
use ndarray::Array2;
use std::time::Instant;

/// Scratch memory of one frame.
struct Scratch {
    workspace: Workspace,
    /// Difference data of the used measurements.
    difference: Vec<f64>,
    /// Protocol indices of the masked measurements.
    masked: Vec<usize>,
}

impl OneStepGaussNewton {
    /// Writes the image of a frame; returns `|W^1/2 (J dsigma - dv)|` over its good channels.
    fn frame(
        &self,
        frames: &DifferenceFrames<'_>,
        t: usize,
        scratch: &mut Scratch,
        image: &mut [f64],
    ) -> Result<f64, InverseError> {
        let Scratch { workspace, difference, masked } = scratch;
        let (row, map) = (frames.values.row(t), self.reconstructor());
        let channels = &map.channels;
        masked.clear();
        masked.extend(channels.used.iter().filter(|&&i| !frames.is_good(t, i)));
        if masked.len() == channels.used.len() {
            image.fill(0.0);
            return Ok(0.0);
        }
        difference.clear();
        difference.extend(channels.used.iter().map(|&i| row[i]));
        let result = map.reconstruct_masked_difference_into(difference, masked, workspace, image);
        // the single-frame reconstruction reports frame 0; insert the frame's index
        let status = result.map_err(|error| match error {
            InverseError::NonFiniteData { measurement, value, .. } => {
                InverseError::NonFiniteData { frame: t, measurement, value }
            }
            other => other,
        })?;
        let predicted = match status {
            FrameStatus::Computed => self.spectrum.predicted(workspace.coefficients()),
            FrameStatus::Unchanged => Col::zeros(difference.len()),
        };
        let square = |k: usize| (predicted[k] - channels.root_weights[k] * difference[k]).powi(2);
        let good = (0..channels.used.len()).filter(|&k| frames.is_good(t, channels.used[k]));
        Ok(good.map(square).sum::<f64>().sqrt() / channels.noise_scale.unwrap_or(1.0))
    }
}

/// Applies [`OneStepGaussNewton`] to every frame of a sequence independently.
///
/// Images are `[frame, element]`, siemens (per square). Masked channels of a frame are excluded
/// exactly ([`Reconstructor::reconstruct_masked_into`]); a frame without a good channel has the image
/// zero, the mean of the prior. A frame costs `2 r (m + n)` flops, and `2 m r` for the residual,
/// which the eigen-expansion gives without the Jacobian.
///
/// [`Reconstructor::reconstruct_masked_into`]: crate::Reconstructor::reconstruct_masked_into
impl SequenceSolver for OneStepGaussNewton {
    fn name(&self) -> &'static str {
        "one-step"
    }

    /// # Errors
    /// In addition to those of the trait, [`InverseError::MaskedDominates`] if lambda is too small to
    /// exclude the masked channels accurately.
    fn reconstruct_sequence(
        &mut self,
        frames: &DifferenceFrames<'_>,
    ) -> Result<ImageSequence, InverseError> {
        let start = Instant::now();
        frames.check_shape(self.reconstructor().measurements())?;
        let workspace = self.workspace();
        let mut scratch = Scratch { workspace, difference: Vec::new(), masked: Vec::new() };
        let mut images = Array2::zeros((frames.values.nrows(), self.report().elements));
        let mut residual = Vec::with_capacity(images.nrows());
        for (t, mut image) in images.rows_mut().into_iter().enumerate() {
            if let Some(image) = image.as_slice_mut() {
                residual.push(self.frame(frames, t, &mut scratch, image)?);
            }
        }
        let report = SequenceReport::direct(SequenceSolver::name(self), start, residual);
        Ok(ImageSequence { images, report })
    }
}
