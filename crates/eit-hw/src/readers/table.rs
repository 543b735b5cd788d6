//! Frames from the rows or columns of a table of numbers.

use std::path::Path;

use crate::error::{HwError, Place};
use crate::recording::{Contents, FrameOrientation};

/// Frames of a table, filled value by value. Its vectors (rows or columns) are frames or, of a
/// matrix, parts of the one frame; they may alternate between real and imaginary parts.
pub(super) struct Table {
    real: Vec<f64>,
    imaginary: Option<Vec<f64>>,
    /// Number of values of a vector.
    length: usize,
    /// 2 if vectors alternate between real and imaginary parts, otherwise 1.
    parts: usize,
    value_count: usize,
}

impl Table {
    /// Creates the frames of `count` vectors of `length` values, which are complex or alternate.
    ///
    /// # Errors
    /// [`HwError::Count`] for an odd number of vectors that should alternate.
    pub(super) fn new(
        [count, length]: [usize; 2],
        orientation: FrameOrientation,
        alternate: bool,
        complex: bool,
        path: &Path,
    ) -> Result<Self, HwError> {
        if alternate && !count.is_multiple_of(2) {
            return Err(HwError::count(
                Place::file(path),
                if orientation == FrameOrientation::Rows { "rows" } else { "columns" },
                [count, count + 1],
                "real and imaginary alternate: add the last one or set `[recording] complex = \
                       false`",
            ));
        }
        let parts = if alternate { 2 } else { 1 };
        let size = count / parts * length;
        let value_count = if orientation == FrameOrientation::Matrix { size } else { length };
        let imaginary = (alternate || complex).then(|| vec![0.0; size]);
        Ok(Self { real: vec![0.0; size], imaginary, length, parts, value_count })
    }

    /// Sets a value of a vector, and its imaginary part if the table is complex.
    pub(super) fn put(&mut self, vector: usize, index: usize, value: f64, imaginary: f64) {
        let at = vector / self.parts * self.length + index;
        match &mut self.imaginary {
            Some(parts) if self.parts == 2 && vector % 2 == 1 => parts[at] = value,
            Some(parts) if self.parts == 1 => (self.real[at], parts[at]) = (value, imaginary),
            _ => self.real[at] = value,
        }
    }

    pub(super) fn contents(self) -> Contents {
        let Self { real, imaginary, value_count, .. } = self;
        Contents { real, imaginary, value_count, ..Contents::default() }
    }
}
