//! Images of frames that lack some of their measurements.

use super::reconstructor::{Reconstructor, Workspace};
use crate::InverseError;
use crate::check::check_length;
use crate::data::FrameStatus;

impl Reconstructor {
    /// [`reconstruct_into`](Self::reconstruct_into) without the measurements `masked` of this frame
    /// (protocol indices, 0-based, in any order, repeated or not; unused ones change nothing).
    /// Their values in frame and reference frame are never looked at: they may be NaN.
    ///
    /// Equal, up to rounding, to a reconstruction built without them at the same weight of the
    /// prior `mu = lambda^2 s`, not at the same lambda, since the scale `s` is a mean over the used
    /// measurements:
    /// [`OneStepGaussNewton::restricted_to`](crate::OneStepGaussNewton::restricted_to) gives the
    /// same image at the lambda times `sqrt(s / s')`, with its own scale `s'`. So a frame with a
    /// failed channel has the smoothness and the amplitude of its neighbours.
    ///
    /// For `k` masked ones costs `k^2 r + k^3 / 3` flops beside the frame's own: nothing to speak of
    /// for a handful, half a frame more for one electrode of 16. Memory for it (`k^2 + k r` values)
    /// is kept in the workspace: it allocates where a set is larger than any before.
    ///
    /// # Errors
    /// As [`reconstruct_into`](Self::reconstruct_into); [`InverseError::UnknownMeasurement`];
    /// [`InverseError::NothingUsed`]; [`InverseError::MaskedDominates`] for a hyperparameter so
    /// small that an error above 1e-6 of the image is to be expected from rounding (1e-5 and below
    /// for one electrode of 16; the worst let through of 20 000 random problems was off by 9e-6),
    /// unless what is left equals the reference: that image is zero for any hyperparameter.
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

    /// [`reconstruct_difference_into`](Self::reconstruct_difference_into) without the measurements
    /// `masked` (protocol indices), as [`reconstruct_masked_into`](Self::reconstruct_masked_into)
    /// leaves them out.
    ///
    /// # Errors
    /// As both.
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

    /// The image of the workspace's difference, which is zero where it is left out.
    fn complete(
        &self,
        status: FrameStatus,
        workspace: &mut Workspace,
        image: &mut [f64],
    ) -> Result<(), InverseError> {
        let Workspace { difference, coefficients, missing } = workspace;
        if status == FrameStatus::Unchanged {
            // whatever is filled in, nothing speaks against zero
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
