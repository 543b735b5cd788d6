//! Frames that grow row by row.

use std::path::Path;

use ndarray::Array2;

use crate::error::{HwError, Place};

/// `values` as [frame, value].
///
/// # Errors
/// [`HwError::NoFrames`] where nothing was read, so that no reader returns an empty recording.
pub(super) fn frames(
    values: Vec<f64>,
    columns: usize,
    path: &Path,
    skipped: usize,
) -> Result<Array2<f64>, HwError> {
    let none = || HwError::NoFrames { place: Place::file(path), skipped };
    if values.is_empty() || columns == 0 {
        return Err(none());
    }
    // the readers push whole rows only; a shape error would say that nothing whole is there
    Array2::from_shape_vec((values.len() / columns, columns), values).map_err(|_| none())
}
