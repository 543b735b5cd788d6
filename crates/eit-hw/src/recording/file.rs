//! A recorded file in memory.

use std::path::{Path, PathBuf};

use ndarray::Array2;

use super::format::Format;
use super::layout::{Layout, Unit};
use super::note::{Note, Skipped};
use super::orientation::FrameOrientation;
use crate::error::{HwError, Place};
use crate::frame::Quality;

/// Every complete frame of a recorded file, in file order.
///
/// Complex values are stored as separate real and imaginary parts, since most files are real.
/// [`frames_for`](Self::frames_for) selects the measurements of a protocol.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Recording {
    /// Real parts, or the values of a real recording, [frame, value].
    pub real: Array2<f64>,
    /// Imaginary parts, [frame, value]; `None` for a real recording.
    pub imaginary: Option<Array2<f64>>,
    /// Flags of each value, [frame, value].
    pub quality: Array2<Quality>,
    /// Electrodes of each value.
    pub layout: Layout,
    /// Unit of the values.
    pub unit: Unit,
    /// Time of each frame by the instrument's clock, in seconds since the first frame.
    pub device_time_s: Option<Vec<f64>>,
    /// Frequency of the current in hertz, if the file states it.
    pub frequency_hz: Option<f64>,
    /// Amplitude of the current in ampere, if the file states it; the values are not scaled by it.
    pub current_a: Option<f64>,
    /// Index of the frame that the file marks as its reference, from 0.
    pub reference_frame: Option<usize>,
    /// Format of the file.
    pub format: Format,
    /// Orientation in which a table was read; `None` for other formats.
    pub frames_are: Option<FrameOrientation>,
    /// Path of the file or folder, as the caller gave it.
    pub path: PathBuf,
    /// Incomplete frames that were skipped.
    pub skipped: Skipped,
    /// Information for the user that is not an error.
    pub notes: Vec<Note>,
}

impl Recording {
    /// Creates a recording of good values without further information.
    pub(crate) fn new(
        real: Array2<f64>,
        imaginary: Option<Array2<f64>>,
        layout: Layout,
        unit: Unit,
        format: Format,
        path: &Path,
    ) -> Self {
        Self {
            quality: Array2::default(real.raw_dim()),
            real,
            imaginary,
            layout,
            unit,
            device_time_s: None,
            frequency_hz: None,
            current_a: None,
            reference_frame: None,
            format,
            frames_are: None,
            path: path.to_path_buf(),
            skipped: Skipped::default(),
            notes: Vec::new(),
        }
    }

    /// Flags values that are NaN or infinite, and adds a note. For tables, which cannot mark
    /// missing values otherwise.
    pub(crate) fn with_missing(mut self) -> Self {
        let is_finite = |at| {
            let parts = std::iter::once(&self.real).chain(&self.imaginary);
            parts.into_iter().all(|part| part.get(at).is_some_and(|value: &f64| value.is_finite()))
        };
        let (mut values, mut first) = (0, None);
        for (at, quality) in self.quality.indexed_iter_mut() {
            if !is_finite(at) {
                *quality |= Quality::NON_FINITE;
                values += 1;
                first.get_or_insert(at);
            }
        }
        let note = first.map(|(frame, value)| Note::MissingValues { values, frame, value });
        self.notes.extend(note);
        self
    }

    /// Returns the number of frames.
    pub fn frame_count(&self) -> usize {
        self.real.nrows()
    }

    /// Returns the number of values per frame, in the file's own layout.
    pub fn value_count(&self) -> usize {
        self.real.ncols()
    }

    pub(crate) fn place(&self) -> Place {
        Place::file(&self.path)
    }

    /// Checks that the fields are consistent: they are public, so anyone may have set them.
    /// [`FrameMap::new`](super::FrameMap::new) checks the layout.
    pub(super) fn check(&self) -> Result<(), HwError> {
        let fits = |field, found: usize, wanted: usize| {
            if found == wanted {
                Ok(())
            } else {
                Err(HwError::Inconsistent { place: self.place(), field, found, wanted })
            }
        };
        let (frames, values) = self.real.dim();
        fits("quality", self.quality.nrows(), frames)?;
        fits("quality", self.quality.ncols(), values)?;
        if let Some(imaginary) = &self.imaginary {
            fits("imaginary", imaginary.nrows(), frames)?;
            fits("imaginary", imaginary.ncols(), values)?;
        }
        if let Some(times) = &self.device_time_s {
            fits("device_time_s", times.len(), frames)?;
        }
        Ok(())
    }
}
