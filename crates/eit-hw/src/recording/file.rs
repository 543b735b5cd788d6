//! A recorded file in memory.

use std::path::{Path, PathBuf};

use ndarray::{Array2, ArrayView2};

use super::format::Format;
use super::layout::{Layout, Unit};
use super::note::{Note, Skipped};
use super::orientation::FrameOrientation;
use super::packed::{Packed, Values};
use crate::error::{HwError, Place};
use crate::frame::Quality;

/// Every complete frame of a recorded file, in file order.
///
/// The values are stored exactly and compactly, so that a recording and the reading of it take at
/// most 64 MB plus twice its file, whatever the file holds. [`frames`](Self::frames) unpacks them
/// frame by frame and [`real`](Self::real) all at once, with eight bytes per value.
/// [`frames_for`](Self::frames_for) selects the measurements of a protocol.
///
/// Complex values are stored as separate real and imaginary parts, since most files are real.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Recording {
    /// Real parts, or the values of a real recording, frame by frame.
    real: Packed,
    imaginary: Option<Packed>,
    /// Bits of the flags; `None` if all values are good.
    quality: Option<Packed>,
    frame_count: usize,
    value_count: usize,
    /// Whether commas that were read as separators may be decimal ones.
    pub(crate) may_have_decimal_commas: bool,
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

/// Values of a recording as a reader has packed them.
pub(crate) struct Contents {
    pub real: Packed,
    pub imaginary: Option<Packed>,
    pub quality: Option<Packed>,
    /// Number of values per frame.
    pub value_count: usize,
    /// Number of incomplete frames that were skipped, for messages.
    pub skipped: usize,
}

impl Contents {
    /// Real values without flags.
    pub(crate) fn real(real: Packed, value_count: usize) -> Self {
        Self { real, imaginary: None, quality: None, value_count, skipped: 0 }
    }

    /// Complex values without flags.
    pub(crate) fn complex(real: Packed, imaginary: Packed, value_count: usize) -> Self {
        Self { imaginary: Some(imaginary), ..Self::real(real, value_count) }
    }
}

impl Recording {
    /// Creates a recording without further information.
    ///
    /// # Errors
    /// [`HwError::NoFrames`] if there are none, so that no reader returns an empty recording.
    pub(crate) fn new(
        contents: Contents,
        layout: Layout,
        unit: Unit,
        format: Format,
        path: &Path,
    ) -> Result<Self, HwError> {
        let Contents { real, imaginary, quality, value_count, skipped } = contents;
        let frame_count = real.len().checked_div(value_count).unwrap_or_default();
        if frame_count == 0 {
            return Err(HwError::NoFrames { place: Place::file(path), skipped });
        }
        Ok(Self {
            real: real.finished(),
            imaginary: imaginary.map(Packed::finished),
            quality: quality.map(Packed::finished),
            frame_count,
            value_count,
            may_have_decimal_commas: false,
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
        })
    }

    /// Replaces the values, for example by filtered ones; all arrays are [frame, value].
    ///
    /// # Errors
    /// [`HwError::NoFrames`] for empty arrays, and [`HwError::Inconsistent`] if they differ in size.
    pub fn with_values(
        self,
        real: ArrayView2<'_, f64>,
        imaginary: Option<ArrayView2<'_, f64>>,
        quality: ArrayView2<'_, Quality>,
    ) -> Result<Self, HwError> {
        let (frames, values) = real.dim();
        self.fits("quality", quality.nrows(), frames)?;
        self.fits("quality", quality.ncols(), values)?;
        if let Some(imaginary) = &imaginary {
            self.fits("imaginary", imaginary.nrows(), frames)?;
            self.fits("imaginary", imaginary.ncols(), values)?;
        }
        if real.is_empty() {
            return Err(HwError::NoFrames { place: self.place(), skipped: 0 });
        }
        let of = |array: ArrayView2<'_, f64>| Packed::of(array.iter().copied(), values);
        let bits = quality.iter().map(|quality| f64::from(quality.bits()));
        let is_good = quality.iter().all(|quality| quality.is_good());
        Ok(Self {
            real: of(real),
            imaginary: imaginary.map(of),
            quality: (!is_good).then(|| Packed::of(bits, values)),
            frame_count: frames,
            value_count: values,
            ..self
        })
    }

    /// Flags values that are NaN or infinite, and adds a note. For tables, which cannot mark
    /// missing values otherwise.
    pub(crate) fn with_missing(mut self) -> Self {
        let missing = || {
            let mut imaginary = self.imaginary.as_ref().map(Packed::iter);
            self.real.iter().map(move |real| {
                let imaginary = imaginary.as_mut().and_then(Iterator::next);
                !real.is_finite() || imaginary.is_some_and(|value| !value.is_finite())
            })
        };
        let Some(first) = missing().position(|is_missing| is_missing) else { return self };
        let bits = f64::from(Quality::NON_FINITE.bits());
        let flags = missing().map(|is_missing| if is_missing { bits } else { 0.0 });
        let quality = Packed::of(flags, self.value_count);
        self.notes.push(Note::MissingValues {
            values: missing().filter(|is_missing| *is_missing).count(),
            frame: first / self.value_count,
            value: first % self.value_count,
        });
        self.quality = Some(quality);
        self
    }

    /// Returns the number of frames.
    pub fn frame_count(&self) -> usize {
        self.frame_count
    }

    /// Returns the number of values per frame, in the file's own layout.
    pub fn value_count(&self) -> usize {
        self.value_count
    }

    /// Returns whether the values are complex.
    pub fn is_complex(&self) -> bool {
        self.imaginary.is_some()
    }

    /// Unpacks the frames one by one.
    pub fn frames(&self) -> RecordedFrames<'_> {
        let size = self.value_count;
        RecordedFrames {
            real: self.real.iter(),
            imaginary: self.imaginary.as_ref().map(Packed::iter),
            quality: self.quality.as_ref().map(Packed::iter),
            left: self.frame_count,
            frame: RecordedFrame {
                real: vec![0.0; size],
                imaginary: self.imaginary.as_ref().map(|_| vec![0.0; size]),
                quality: vec![Quality::GOOD; size],
            },
        }
    }

    /// Returns the real parts, or the values of a real recording, [frame, value].
    pub fn real(&self) -> Array2<f64> {
        self.array(self.real.iter())
    }

    /// Returns the imaginary parts, [frame, value]; `None` for a real recording.
    pub fn imaginary(&self) -> Option<Array2<f64>> {
        self.imaginary.as_ref().map(|imaginary| self.array(imaginary.iter()))
    }

    /// Returns the flags of each value, [frame, value].
    pub fn quality(&self) -> Array2<Quality> {
        match &self.quality {
            Some(quality) => self.array(quality.iter().map(flags)),
            None => Array2::default((self.frame_count, self.value_count)),
        }
    }

    /// Iterates over the real parts, frame by frame, without unpacking a whole frame.
    pub fn real_values(&self) -> impl ExactSizeIterator<Item = f64> + '_ {
        self.real.iter()
    }

    /// Iterates over the imaginary parts, frame by frame; `None` for a real recording.
    pub fn imaginary_values(&self) -> Option<impl ExactSizeIterator<Item = f64> + '_> {
        self.imaginary.as_ref().map(Packed::iter)
    }

    /// Returns the number of values that are not good.
    pub fn flagged_count(&self) -> usize {
        let flags = self.quality.as_ref().map(|quality| quality.iter().filter(|bits| *bits != 0.0));
        flags.map_or(0, Iterator::count)
    }

    fn array<T: Default + Clone>(&self, values: impl Iterator<Item = T>) -> Array2<T> {
        let mut array = Array2::default((self.frame_count, self.value_count));
        array.iter_mut().zip(values).for_each(|(slot, value)| *slot = value);
        array
    }

    pub(crate) fn place(&self) -> Place {
        Place::file(&self.path)
    }

    fn fits(&self, field: &'static str, found: usize, wanted: usize) -> Result<(), HwError> {
        if found == wanted {
            return Ok(());
        }
        Err(HwError::Inconsistent { place: self.place(), field, found, wanted })
    }

    /// Checks that there is a time for each frame: the field is public, so anyone may have set it.
    /// [`FrameMap::new`](super::FrameMap::new) checks the layout.
    pub(super) fn check(&self) -> Result<(), HwError> {
        match &self.device_time_s {
            Some(times) => self.fits("device_time_s", times.len(), self.frame_count),
            None => Ok(()),
        }
    }
}

/// Flags from their stored bits.
fn flags(bits: f64) -> Quality {
    // stored from flags, so that they are known
    Quality::from_bits(bits as u16).unwrap_or_default()
}

/// A frame of a recording, in the file's own layout.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RecordedFrame {
    /// Real parts, or the values of a real recording.
    pub real: Vec<f64>,
    /// Imaginary parts; `None` for a real recording.
    pub imaginary: Option<Vec<f64>>,
    /// Flags of each value.
    pub quality: Vec<Quality>,
}

/// Unpacks the frames of a [`Recording`] one by one, with the memory of one frame.
#[derive(Clone, Debug)]
pub struct RecordedFrames<'a> {
    real: Values<'a>,
    imaginary: Option<Values<'a>>,
    quality: Option<Values<'a>>,
    left: usize,
    frame: RecordedFrame,
}

impl RecordedFrames<'_> {
    /// Returns the next frame; `None` after the last one.
    pub fn next_frame(&mut self) -> Option<&RecordedFrame> {
        self.left = self.left.checked_sub(1)?;
        let RecordedFrame { real, imaginary, quality } = &mut self.frame;
        // the lists have as many values as all frames together
        real.iter_mut().zip(&mut self.real).for_each(|(slot, value)| *slot = value);
        if let (Some(slots), Some(values)) = (imaginary, &mut self.imaginary) {
            slots.iter_mut().zip(values).for_each(|(slot, value)| *slot = value);
        }
        if let Some(bits) = &mut self.quality {
            quality.iter_mut().zip(bits).for_each(|(slot, bits)| *slot = flags(bits));
        }
        Some(&self.frame)
    }
}
