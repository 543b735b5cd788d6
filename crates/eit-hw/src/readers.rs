//! Readers of recorded files, one per format, and recognition of the format.

mod array;
#[cfg(feature = "arrays")]
mod arrays;
mod black_sensor;
pub(crate) mod csv;
mod files;
mod goe;
mod khu;
mod lct;
#[cfg(feature = "arrays")]
mod mat;
mod npy;
#[cfg(feature = "arrays")]
mod npz;
mod number;
mod recognise;
mod sciospec;
mod serial_log;
mod table;
mod text;

pub use npy::read_array;
pub use serial_log::SerialLogOptions;

use std::path::Path;

use self::files::file_bytes;
use crate::error::{HwError, Place, shortened};
use crate::recording::{Format, FrameOrientation, Recording};

/// First bytes of an MCAP file.
pub(crate) const MCAP_MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// Options of all readers; each reader uses its own.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct ReadOptions {
    /// `[recording] frames_are`: what forms one frame of [`Format::Csv`] and of an array of two axes
    /// of [`Format::Npy`], [`Format::Npz`] and [`Format::Mat`]; rejected for other formats. `None` is
    /// what fits [`measurements`](Self::measurements) in the last two, else [`FrameOrientation::Rows`].
    pub frames_are: Option<FrameOrientation>,
    /// `[recording] complex`: rows (or columns, also those of a matrix) of a table of real numbers
    /// alternate: real parts of frame 0, imaginary parts of frame 0, real parts of frame 1 and so on.
    /// Rejected for other formats.
    pub complex: bool,
    /// `[recording] array`: name of the array with the frames, for [`Format::Npz`] and [`Format::Mat`];
    /// rejected for other formats. `None` is the only one that fits.
    pub array: Option<String>,
    /// Number of measurements of the protocol, which tells the array with the frames from others.
    pub measurements: Option<usize>,
    /// `[recording] frequency_row`: index of the frequency to read, from 0, for [`Format::Sciospec`].
    pub frequency_row: usize,
    /// Options for [`Format::SerialLog`].
    pub serial_log: SerialLogOptions,
}

impl ReadOptions {
    /// Rejects keys for tables if the format is not a table.
    fn check(&self, format: Format, path: &Path) -> Result<(), HwError> {
        let of_several = matches!(format, Format::Mat | Format::Npz);
        let is_table = of_several || matches!(format, Format::Csv | Format::Npy);
        let (key, meant) = if self.array.is_some() && !of_several {
            ("array", "mat and npz files")
        } else if self.frames_are.is_some() && !is_table {
            ("frames_are", "tables (csv, npy, mat, npz)")
        } else if self.complex && !is_table {
            ("complex", "tables (csv, npy, mat, npz)")
        } else {
            return Ok(());
        };
        let (place, format) = (Place::file(path), format.name());
        Err(HwError::UnusedKey { place, key, format, meant })
    }
}

/// Reads a recording in the given format or, without one, in the recognised format.
///
/// A recording of this crate that was split into parts is read under its own name,
/// without the number of a part.
///
/// A folder with `.eit` files is Sciospec; one with KHU's `ProjectionTableSendLog.txt` is KHU. A
/// file is recognised by the first rule that applies:
/// - first bytes `\x93NUMPY`: NPY; `\x89MCAP`: MCAP; a zip archive: NPZ;
/// - the version and byte order of a MATLAB file of version 5 at byte 124: MAT;
/// - first line `#MEAS`: LCT;
/// - a line `time_pc [s],` at the start: log of the board `black_sensor`;
/// - ending `.eit`, `.get`, `.npy`, `.mat` or `.csv`: that format;
/// - other text with a line `s`, `ref:` or `data:`: serial log; other text: CSV.
///
/// Text that may be either of the last two (lines of as many numbers as in a serial log, without
/// any `s`) and everything else is an error that names the key `[recording] format`.
///
/// # Errors
/// Any [`HwError`] of the reader; [`HwError::Unrecognised`] and [`HwError::Ambiguous`];
/// [`HwError::UnusedKey`] if the options describe the layout of a table but the format is not one.
pub fn read_recording(
    path: impl AsRef<Path>,
    format: Option<Format>,
    options: &ReadOptions,
) -> Result<Recording, HwError> {
    let path = path.as_ref();
    if path.is_dir() {
        let format = match format {
            Some(format) => format,
            None => recognise::folder(path)?,
        };
        options.check(format, path)?;
        return match format {
            Format::Sciospec => sciospec::read(path, options.frequency_row),
            Format::Khu => khu::read(path),
            other => Err(HwError::Folder { place: Place::file(path), format: other.name() }),
        };
    }
    if format == Some(Format::Khu) {
        return khu::read(path);
    }
    // message by message, so that the file is not held in memory besides its frames
    #[cfg(feature = "mcap")]
    if format.is_none_or(|format| format == Format::Mcap) && crate::capture::is_recording(path)? {
        options.check(Format::Mcap, path)?;
        return crate::capture::read_frames(path);
    }
    let bytes = file_bytes(path, format.map_or("single-file", Format::name))?;
    let format = match format {
        Some(format) => format,
        None => recognise::file(&bytes, path, &options.serial_log)?,
    };
    parse_recording(&bytes, path, format, options)
}

/// Parses the content of a file of this format; `path` is used in messages only.
///
/// # Errors
/// Any [`HwError`] of the reader; [`HwError::UnusedKey`] as for [`read_recording`];
/// [`HwError::NotAFolder`] for [`Format::Khu`], which is a folder.
pub fn parse_recording(
    bytes: &[u8],
    path: impl AsRef<Path>,
    format: Format,
    options: &ReadOptions,
) -> Result<Recording, HwError> {
    let path = path.as_ref();
    options.check(format, path)?;
    match format {
        Format::Csv => csv::parse(bytes, path, options),
        Format::Npy => npy::parse(bytes, path)?.recording(format, options, path),
        #[cfg(feature = "arrays")]
        Format::Npz => npz::parse(bytes, path, options),
        #[cfg(feature = "arrays")]
        Format::Mat => mat::parse(bytes, path, options),
        #[cfg(not(feature = "arrays"))]
        Format::Npz | Format::Mat => {
            Err(HwError::Unsupported { place: Place::file(path), format: format.name() })
        }
        Format::Sciospec => sciospec::parse(bytes, path, options.frequency_row),
        Format::Goe => goe::parse(bytes, path),
        Format::Lct => lct::parse(bytes, path),
        Format::Khu => Err(HwError::NotAFolder { place: Place::file(path), format: "khu" }),
        Format::BlackSensor => black_sensor::parse(bytes, path),
        Format::SerialLog => serial_log::parse(bytes, path, &options.serial_log),
        #[cfg(feature = "mcap")]
        Format::Mcap => crate::capture::parse(bytes, path)?.recording(path),
        #[cfg(not(feature = "mcap"))]
        Format::Mcap => Err(HwError::Unsupported { place: Place::file(path), format: "mcap" }),
    }
}

/// The error of a field of a file, whose text is shortened.
fn wrong_field(
    place: Place,
    field: &'static str,
    text: &str,
    wanted: &'static str,
    mend: &'static str,
) -> HwError {
    HwError::Field { place, field, text: shortened(text), wanted, mend }
}
