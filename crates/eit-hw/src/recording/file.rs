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
/// Complex values are kept as real and imaginary part: most files have only the one.
/// [`frames_for`](Self::frames_for) turns them into the measurements of a protocol.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Real parts, or the values of a real recording, [frame, value].
    pub real: Array2<f64>,
    /// Imaginary parts, [frame, value]; `None` for a real recording.
    pub imaginary: Option<Array2<f64>>,
    /// Flags of each value, [frame, value].
    pub quality: Array2<Quality>,
    /// Which electrodes each value belongs to.
    pub layout: Layout,
    /// Unit of the values.
    pub unit: Unit,
    /// The instrument's time of each frame in seconds since the first one.
    pub device_time_s: Option<Vec<f64>>,
    /// Frequency of the current, where the file states it.
    pub frequency_hz: Option<f64>,
    /// Amplitude of the current, where the file states it; the values are not scaled by it.
    pub current_a: Option<f64>,
    /// The frame that the file itself marks as its reference (0-based).
    pub reference_frame: Option<usize>,
    /// Format in which it was read.
    pub format: Format,
    /// How the table was read; `None` for a format that is none.
    pub frames_are: Option<FrameOrientation>,
    /// The file or folder, as it was named by the caller.
    pub path: PathBuf,
    /// Frames that were left out because they are cut.
    pub skipped: Skipped,
    /// What a user should know and no error is.
    pub notes: Vec<Note>,
}

impl Recording {
    /// A recording of `real` values with nothing wrong and nothing known but its origin.
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

    /// Flags values that are NaN or infinite, of a table that has no other way to say that a value is
    /// missing, with a note.
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

    /// Number of frames.
    pub fn frame_count(&self) -> usize {
        self.real.nrows()
    }

    /// Number of values a frame, in the file's own layout.
    pub fn value_count(&self) -> usize {
        self.real.ncols()
    }

    pub(crate) fn place(&self) -> Place {
        Place::file(&self.path)
    }

    /// Whether the fields fit each other: they are public, so anyone may have built them. The layout
    /// is left to [`FrameMap::new`](super::FrameMap::new).
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
