//! Tables of numbers, and their division into frames.

use std::path::Path;

use crate::error::{HwError, Place};
use crate::recording::packed::Packed;
use crate::recording::{Contents, FrameOrientation};

/// A table as stored: `length` numbers per row.
pub(super) struct Table {
    pub values: Packed,
    pub length: usize,
}

/// Returns the frames of a table, with real and imaginary parts if they alternate.
///
/// # Errors
/// [`HwError::Count`] for an odd number of rows or columns that should alternate.
pub(super) fn oriented(
    table: Table,
    orientation: FrameOrientation,
    complex: bool,
    path: &Path,
) -> Result<Contents, HwError> {
    let Table { values, length } = table;
    let rows = values.len().checked_div(length).unwrap_or_default();
    let (vectors, count, length) = match orientation {
        FrameOrientation::Rows => (values, rows, length),
        FrameOrientation::Columns | FrameOrientation::Matrix => {
            (values.transposed(length), length, rows)
        }
    };
    let mut parts = Parts::new(count, length, orientation, complex, path)?;
    if !complex {
        return Ok(Contents::real(vectors, parts.value_count));
    }
    vectors.iter().enumerate().for_each(|(index, value)| parts.push(index / length, value));
    Ok(parts.contents())
}

/// Real and imaginary parts, from vectors (rows or columns) that may alternate between them.
pub(super) struct Parts {
    real: Packed,
    imaginary: Option<Packed>,
    alternate: bool,
    /// Number of values per frame.
    value_count: usize,
}

impl Parts {
    /// For `count` vectors of `length` values, each a frame or, of a matrix, part of the one frame.
    ///
    /// # Errors
    /// [`HwError::Count`] for an odd number of vectors that should alternate.
    pub(super) fn new(
        count: usize,
        length: usize,
        orientation: FrameOrientation,
        alternate: bool,
        path: &Path,
    ) -> Result<Self, HwError> {
        if alternate && !count.is_multiple_of(2) {
            return Err(HwError::Count {
                place: Place::file(path),
                what: if orientation == FrameOrientation::Rows { "rows" } else { "columns" },
                found: count,
                wanted: count + 1,
                mend: "real and imaginary alternate: add the last one or set `[recording] complex = \
                       false`",
            });
        }
        let parts = if alternate { 2 } else { 1 };
        let value_count = match orientation {
            FrameOrientation::Matrix => count / parts * length,
            FrameOrientation::Rows | FrameOrientation::Columns => length,
        };
        let list = || Packed::of_rows(value_count);
        Ok(Self { real: list(), imaginary: alternate.then(list), alternate, value_count })
    }

    /// Adds a value of the vector with this index.
    pub(super) fn push(&mut self, vector: usize, value: f64) {
        match &mut self.imaginary {
            Some(imaginary) if self.alternate && vector % 2 == 1 => imaginary.push(value),
            _ => self.real.push(value),
        }
    }

    /// Adds a complex value.
    pub(super) fn push_complex(&mut self, real: f64, imaginary: f64) {
        self.real.push(real);
        self.imaginary.get_or_insert_with(|| Packed::of_rows(self.value_count)).push(imaginary);
    }

    pub(super) fn contents(self) -> Contents {
        let Self { real, imaginary, value_count, .. } = self;
        Contents { imaginary, ..Contents::real(real, value_count) }
    }
}
