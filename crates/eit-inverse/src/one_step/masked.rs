//! Images of frames with masked measurements.

use super::reconstructor::{Reconstructor, Workspace};
use crate::InverseError;
use crate::check::check_length;
use crate::data::FrameStatus;

impl Reconstructor {
    /// Like [`reconstruct_into`](Self::reconstruct_into), but excludes the measurements `masked`
    /// from this frame.
    ///
    /// `masked` holds protocol indices, 0-based, in any order, repeated or not; unused measurements
    /// in it have no effect. Masked values of frame and reference frame are never read and may be
    /// NaN.
    ///
    /// The image equals, up to rounding, that of a reconstruction built without these measurements
    /// at the same prior weight `mu = lambda^2 s`. This is not the same lambda, because the scale `s`
    /// is a mean over the used measurements:
    /// [`OneStepGaussNewton::restricted_to`](crate::OneStepGaussNewton::restricted_to), whose scale
    /// is `s'`, gives the same image at lambda times `sqrt(s / s')`. A frame with a failed channel
    /// therefore has the same smoothness and amplitude as neighbouring frames.
    ///
    /// Masking `k` measurements costs an additional `k^2 r + k^3 / 3` flops: negligible for a
    /// handful, half a frame for one electrode of 16. The workspace keeps the memory
    /// (`k^2 + k r` values) and allocates only when a set is larger than any before.
    ///
    /// # Errors
    /// The errors of [`reconstruct_into`](Self::reconstruct_into);
    /// [`InverseError::UnknownMeasurement`]; [`InverseError::NothingUsed`];
    /// [`InverseError::MaskedDominates`] if the hyperparameter is so small that the expected rounding
    /// error exceeds 1e-6 of the image (1e-5 and below for one electrode of 16; the worst accepted
    /// case of 20 000 random problems had an error of 9e-6), unless the remaining measurements equal
    /// the reference: that image is zero for any hyperparameter.
    pub fn reconstruct_masked_into(
        &self,
        frame: &[f64],
        reference_frame: &[f64],
        masked: &[usize],
        workspace: &mut Workspace,
        image: &mut [f64],
    ) -> Result<FrameStatus, InverseError> {
        self.check_memory(workspace, image)?;
        let Workspace { difference, missing, .. } = workspace;
        missing.choose(&self.channels, masked)?;
        let indices = &missing.indices;
        let status =
            self.channels.difference_into(0, frame, reference_frame, indices, difference)?;
        self.complete(status, workspace, image)?;
        Ok(status)
    }

    /// Like [`reconstruct_difference_into`](Self::reconstruct_difference_into), but excludes the
    /// measurements `masked` (protocol indices) in the same way as
    /// [`reconstruct_masked_into`](Self::reconstruct_masked_into).
    ///
    /// # Errors
    /// The errors of both methods.
    pub fn reconstruct_masked_difference_into(
        &self,
        difference: &[f64],
        masked: &[usize],
        workspace: &mut Workspace,
        image: &mut [f64],
    ) -> Result<FrameStatus, InverseError> {
        self.check_memory(workspace, image)?;
        check_length("difference", difference.len(), self.channels.used.len())?;
        workspace.missing.choose(&self.channels, masked)?;
        workspace.difference.copy_from_slice(difference);
        workspace.missing.indices.iter().for_each(|&k| workspace.difference[k] = 0.0);
        let status = self.check_difference(&workspace.difference)?;
        self.complete(status, workspace, image)?;
        Ok(status)
    }

    /// Computes the image of the workspace's difference, which is zero at masked measurements.
    fn complete(
        &self,
        status: FrameStatus,
        workspace: &mut Workspace,
        image: &mut [f64],
    ) -> Result<(), InverseError> {
        let Workspace { difference, coefficients, missing } = workspace;
        if status == FrameStatus::Unchanged {
            // all unmasked data is zero, so the image is zero
            image.fill(0.0);
            return Ok(());
        }
        self.to_coefficients(difference, coefficients);
        let root_weights = &self.channels.root_weights;
        missing.complete(self.data_rows(), root_weights, &self.damping, coefficients)?;
        self.to_image(coefficients, image);
        Ok(())
    }
}
