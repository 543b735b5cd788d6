//! Frames from an array of a file.

use std::path::Path;

use super::ReadOptions;
use super::number::Numbers;
use super::table::Table;
use crate::error::{HwError, Place};
use crate::recording::{Format, FrameOrientation, Layout, Note, Recording, Unit};

/// An array as it is stored; there are as many numbers as its shape states.
pub(super) struct Array<'a> {
    pub shape: Vec<usize>,
    /// Whether the first index changes fastest.
    pub fortran: bool,
    pub real: Numbers<'a>,
    pub imaginary: Option<Numbers<'a>>,
}

impl Array<'_> {
    /// Returns its frames; `path` is used in messages only.
    ///
    /// `[measurement]` is one frame, and so is, with [`FrameOrientation::Rows`], a matrix of one
    /// column (with a note); for other matrices see [`FrameOrientation`]. With rows,
    /// `[frame, drive, electrode]` is read too. The layout is [`Layout::ProtocolOrder`], the unit
    /// [`Unit::Arbitrary`]. A value that is NaN or infinite counts as missing and is flagged
    /// [`Quality::NON_FINITE`](crate::Quality::NON_FINITE).
    ///
    /// # Errors
    /// [`HwError`] for another shape, an odd number of rows or columns where they alternate, and
    /// complex numbers where real ones should alternate.
    pub(super) fn recording(
        self,
        format: Format,
        options: &ReadOptions,
        path: &Path,
    ) -> Result<Recording, HwError> {
        let Self { shape, fortran, real, imaginary } = self;
        let orientation = options.frames_are.unwrap_or_default();
        let by_rows = orientation == FrameOrientation::Rows;
        let place = || Place::file(path);
        // columns are those of a drive after those of the drive before
        let (rows, drives, of_drive) = match shape[..] {
            [values] | [values, 1] if by_rows => (1, 1, values),
            [values] => (values, 1, 1),
            [rows, columns] => (rows, 1, columns),
            [frames, drives, electrodes] if by_rows => (frames, drives, electrodes),
            _ => return Err(HwError::Shape { place: place(), shape }),
        };
        if shape.contains(&0) {
            return Err(HwError::NoFrames { place: place(), skipped: 0 });
        }
        if imaginary.is_some() && options.complex {
            let meant = "tables of real numbers";
            let (key, format) = ("complex", "complex");
            return Err(HwError::UnusedKey { place: place(), key, format, meant });
        }
        let columns = drives * of_drive;
        let vectors = if by_rows { [rows, columns] } else { [columns, rows] };
        let complex = imaginary.is_some();
        let mut table = Table::new(vectors, orientation, options.complex, complex, path)?;
        let mut parts = imaginary.map(Numbers::values);
        for (at, value) in real.values().enumerate() {
            let (row, column) = if fortran {
                let (row, rest) = (at % rows, at / rows);
                (row, rest % drives * of_drive + rest / drives)
            } else {
                (at / columns, at % columns)
            };
            let (vector, index) = if by_rows { (row, column) } else { (column, row) };
            table.put(vector, index, value, parts.as_mut().and_then(Iterator::next).unwrap_or(0.0));
        }
        let (layout, unit) = (Layout::ProtocolOrder, Unit::Arbitrary);
        let mut recording = Recording::new(table.contents(), layout, unit, format, path)?;
        recording.frames_are = Some(orientation);
        recording.matrix = (orientation == FrameOrientation::Matrix).then_some([rows, columns]);
        if by_rows && matches!(shape[..], [_, 1]) {
            recording.notes.push(Note::OneColumn { rows: columns });
        }
        Ok(recording.with_missing())
    }
}
