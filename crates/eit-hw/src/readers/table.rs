//! Tables of numbers, and their division into frames.

use std::path::Path;

use ndarray::{Array2, ArrayView2, Axis, Slice};

use crate::error::{HwError, Place};
use crate::recording::FrameOrientation;

/// Arranges `values` as [frame, value].
///
/// # Errors
/// [`HwError::NoFrames`] if there are none, so that no reader returns an empty recording.
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
    // readers push complete rows only; a shape error would mean that there is no complete one
    Array2::from_shape_vec((values.len() / columns, columns), values).map_err(|_| none())
}

/// Returns the real and, if they alternate, imaginary parts of the frames of a table [row, column].
///
/// # Errors
/// [`HwError::Count`] for an odd number of rows or columns that should alternate, and
/// [`HwError::NoFrames`] for an empty table.
pub(super) fn oriented(
    table: Array2<f64>,
    orientation: FrameOrientation,
    complex: bool,
    path: &Path,
) -> Result<(Array2<f64>, Option<Array2<f64>>), HwError> {
    let (vectors, what) = match orientation {
        FrameOrientation::Rows => (table, "rows"),
        FrameOrientation::Columns | FrameOrientation::Matrix => (table.reversed_axes(), "columns"),
    };
    let (count, length) = vectors.dim();
    let joined = |part: ArrayView2<f64>| {
        let values = if orientation == FrameOrientation::Matrix { part.len() } else { length };
        frames(part.iter().copied().collect(), values, path, 0)
    };
    if !complex {
        return Ok((joined(vectors.view())?, None));
    }
    if !count.is_multiple_of(2) {
        return Err(HwError::Count {
            place: Place::file(path),
            what,
            found: count,
            wanted: count + 1,
            mend: "real and imaginary alternate: add the last one or set `[recording] complex = \
                   false`",
        });
    }
    let every_other = |first| vectors.slice_axis(Axis(0), Slice::new(first, None, 2));
    Ok((joined(every_other(0))?, Some(joined(every_other(1))?)))
}
