//! A recorded file in memory.

use std::path::{Path, PathBuf};

use ndarray::{Array2, ArrayView2, Axis};

use super::format::Format;
use super::layout::{Layout, Unit};
use super::note::{Note, Skipped};
use super::orientation::FrameOrientation;
use crate::error::{HwError, Place};
use crate::frame::{Frame, Quadruple, Quality, check_lengths};

/// Every complete frame of a recorded file, in file order.
///
/// A recording, with the reading of it, takes at most 64 MB plus ten times its file, whatever the
/// file holds. [`frames_for`](Self::frames_for) selects the measurements of a protocol.
///
/// Complex values are stored as separate real and imaginary parts, since most files are real.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Recording {
    /// Real parts, or the values of a real recording, [frame, value].
    pub real: Array2<f64>,
    /// Imaginary parts, [frame, value]; `None` for a real recording.
    pub imaginary: Option<Array2<f64>>,
    /// Flags of each value, [frame, value]; `None` if all values are good.
    pub quality: Option<Array2<Quality>>,
    /// Whether commas that were read as separators may be decimal ones.
    pub(crate) may_have_decimal_commas: bool,
    /// Whether the first value of frames grows in equal steps.
    pub(crate) has_counter: bool,
    /// Rows and columns of the table that is one frame.
    pub(crate) matrix: Option<[usize; 2]>,
    /// Electrodes of each value.
    pub layout: Layout,
    /// Unit of all values, as far as the file states it.
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

/// Values that a reader has collected, frame by frame.
#[derive(Default)]
pub(crate) struct Contents {
    pub(crate) real: Vec<f64>,
    pub(crate) imaginary: Option<Vec<f64>>,
    pub(crate) quality: Option<Vec<Quality>>,
    /// Number of values per frame.
    pub(crate) value_count: usize,
    pub(crate) skipped: Skipped,
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
        let shape = [real.len().checked_div(value_count).unwrap_or_default(), value_count];
        let none = || HwError::NoFrames { place: Place::file(path), skipped: skipped.frames };
        if shape[0] == 0 {
            return Err(none());
        }
        let array = |values| shaped(values, shape).ok_or_else(none);
        let quality = quality.filter(|flags| flags.iter().any(|flags| !flags.is_good()));
        Ok(Self {
            real: array(real)?,
            imaginary: imaginary.map(array).transpose()?,
            quality: quality.map(|flags| shaped(flags, shape).ok_or_else(none)).transpose()?,
            may_have_decimal_commas: false,
            has_counter: false,
            matrix: None,
            layout,
            unit,
            device_time_s: None,
            frequency_hz: None,
            current_a: None,
            reference_frame: None,
            format,
            frames_are: None,
            path: path.to_path_buf(),
            skipped,
            notes: Vec::new(),
        })
    }

    /// Creates a recording of values [frame, value] in volt, in the order of the scene's protocol, with the time of each
    /// frame at this rate. Values that are not finite are flagged.
    ///
    /// # Errors
    /// [`HwError::NoFrames`].
    pub fn of_values(
        values: ArrayView2<'_, f64>,
        frame_rate_hz: Option<f64>,
    ) -> Result<Self, HwError> {
        let (frames, value_count) = values.dim();
        let real = values.iter().copied().collect();
        let contents = Contents { real, value_count, ..Contents::default() };
        let (layout, path) = (Layout::ProtocolOrder, Path::new("values"));
        let recording = Self::new(contents, layout, Unit::Volt, Format::Npy, path)?.with_missing();
        let time_s = |rate_hz: f64| (0..frames).map(|frame| frame as f64 / rate_hz).collect();
        Ok(Self { device_time_s: frame_rate_hz.map(time_s), ..recording })
    }

    /// Flags values that are NaN or infinite, and adds a note. For tables, which cannot mark
    /// missing values otherwise.
    pub(crate) fn with_missing(mut self) -> Self {
        let is_missing = |at: (usize, usize)| {
            let imaginary = self.imaginary.as_ref().map_or(0.0, |imaginary| imaginary[at]);
            !(self.real[at].is_finite() && imaginary.is_finite())
        };
        let mut missing =
            ndarray::indices(self.real.dim()).into_iter().filter(|&at| is_missing(at));
        let Some((frame, value)) = missing.next() else { return self };
        let values = 1 + missing.count();
        let flags = |at| if is_missing(at) { Quality::NON_FINITE } else { Quality::GOOD };
        let quality = Array2::from_shape_fn(self.real.dim(), flags);
        self.notes.push(Note::MissingValues { values, frame, value });
        self.quality = Some(quality);
        self
    }

    /// Arranges a table that names no electrodes as `expected`, that of `count` measurements in the protocol's order, or that of
    /// potentials, with or without those of driven electrodes: leaves out a first column of frame numbers or times, if there is one
    /// more; joins its lines to frames if each holds one value, or those of one drive of the protocol; and turns a matrix whose lines
    /// are drives. A note says so.
    #[must_use]
    pub fn arranged_for(
        self,
        expected: &Layout,
        quadruples: Option<&[Quadruple]>,
        count: usize,
    ) -> Self {
        if self.layout != Layout::ProtocolOrder || self.imaginary.is_some() || count == 0 {
            return self;
        }
        let drives = expected.drives(quadruples);
        let Layout::Potentials { drives: pairs, electrodes, driven } = expected else {
            return self.of_drives(drives, count);
        };
        let mut arranged = self;
        for driven in [*driven, !*driven] {
            let (drives, electrodes) = (pairs.clone(), *electrodes);
            let layout = Layout::Potentials { drives, electrodes, driven };
            let count = layout.value_count().unwrap_or_default();
            arranged = arranged.of_drives(pairs.len().max(1), count);
            if arranged.value_count() == count {
                arranged.layout = layout;
                break;
            }
        }
        arranged
    }

    /// Arranges a table as frames of `count` values of this many drives, if it fits.
    fn of_drives(mut self, drives: usize, count: usize) -> Self {
        if count == 0 {
            return self;
        }
        if self.has_counter && self.value_count() == count + 1 {
            let others: Vec<usize> = (1..=count).collect();
            self.real = self.real.select(Axis(1), &others);
            self.quality = self.quality.map(|quality| quality.select(Axis(1), &others));
            self.notes.push(Note::Counter);
        }
        let of_drive = count / drives;
        let (rows, columns) = self.real.dim();
        let is_line = columns == 1 || (drives * columns == count && drives > 1);
        if self.frames_are == Some(FrameOrientation::Rows)
            && is_line
            && columns != count
            && (rows * columns).is_multiple_of(count)
            && (rows != count || columns == 1)
        {
            let shape = [rows * columns / count, count];
            let quality = self.quality.take().map(|quality| quality.into_iter().collect());
            let joined = shaped(self.real.into_iter().collect(), shape);
            // as many values as before
            self.real = joined.unwrap_or_default();
            self.quality = quality.and_then(|quality| shaped(quality, shape));
            self.notes.push(Note::Joined { lines: count / columns });
        }
        if self.matrix == Some([drives, of_drive]) && drives != of_drive && columns == count {
            // it was read column by column
            let turned = |value: usize| (value % of_drive) * drives + value / of_drive;
            let order: Vec<usize> = (0..count).map(turned).collect();
            self.real = self.real.select(Axis(1), &order);
            self.quality = self.quality.map(|quality| quality.select(Axis(1), &order));
            self.notes.push(Note::Turned { drives });
        }
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

    /// Iterates over the frames, in the file's own layout and numbered from 0.
    pub fn frames(&self) -> impl Iterator<Item = Frame> + '_ {
        let imaginary = self.imaginary.as_ref();
        self.real.rows().into_iter().enumerate().map(move |(index, real)| {
            let good = || vec![Quality::GOOD; real.len()];
            let quality = self.quality.as_ref().map_or_else(good, |all| all.row(index).to_vec());
            Frame {
                values: real.to_vec(),
                imaginary: imaginary.map(|all| all.row(index).to_vec()),
                quality,
                sequence: index as u64,
                epoch: 0,
                device_time_s: self.device_time_s.as_ref().and_then(|all| all.get(index).copied()),
                host_time_s: None,
            }
        })
    }

    /// Checks that the public fields, which anyone may have set, describe the same frames.
    /// [`FrameMap::new`](super::FrameMap::new) checks the layout.
    pub(super) fn check(&self) -> Result<(), HwError> {
        let (frames, values) = self.real.dim();
        let imaginary = self.imaginary.as_ref().map_or((frames, values), Array2::dim);
        let quality = self.quality.as_ref().map_or((frames, values), Array2::dim);
        let times = self.device_time_s.as_ref().map_or(frames, Vec::len);
        let fields = [
            ("imaginary", imaginary.0, frames),
            ("imaginary", imaginary.1, values),
            ("quality", quality.0, frames),
            ("quality", quality.1, values),
            ("device_time_s", times, frames),
        ];
        check_lengths(&self.path, fields)
    }
}

fn shaped<T>(mut values: Vec<T>, shape: [usize; 2]) -> Option<Array2<T>> {
    values.shrink_to_fit();
    Array2::from_shape_vec(shape, values).ok()
}
