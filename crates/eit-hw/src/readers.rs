//! Readers of recorded files, one per format, and recognition of the format.
//!
//! Each reader has a pure `parse` from bytes and a `read` that opens the file. The path given to
//! `parse` is used in messages only.

pub mod black_sensor;
pub mod csv;
pub mod goe;
pub mod khu;
pub mod lct;
pub mod npy;
pub mod sciospec;
pub mod serial_log;

mod files;
mod recognise;
mod table;
mod text;

use std::path::Path;

use self::files::file_bytes;
use crate::error::{HwError, Place};
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
    /// `[recording] frames_are`: the layout of frames, for [`Format::Csv`] and [`Format::Npy`];
    /// rejected for other formats. `None` defers to `csv` and `npy`.
    pub frames_are: Option<FrameOrientation>,
    /// `[recording] complex`: rows (or columns) alternate real and imaginary parts, for
    /// [`Format::Csv`] and [`Format::Npy`]; rejected for other formats. `false` defers to `csv` and
    /// `npy`.
    pub complex: bool,
    /// Options for [`Format::Csv`].
    pub csv: csv::CsvOptions,
    /// Options for [`Format::Npy`].
    pub npy: npy::NpyOptions,
    /// Options for [`Format::Sciospec`].
    pub sciospec: sciospec::SciospecOptions,
    /// Options for [`Format::SerialLog`].
    pub serial_log: serial_log::SerialLogOptions,
}

impl ReadOptions {
    fn csv(&self) -> csv::CsvOptions {
        csv::CsvOptions {
            orientation: self.frames_are.unwrap_or(self.csv.orientation),
            complex: self.complex || self.csv.complex,
        }
    }

    fn npy(&self) -> npy::NpyOptions {
        npy::NpyOptions {
            orientation: self.frames_are.unwrap_or(self.npy.orientation),
            complex: self.complex || self.npy.complex,
        }
    }

    /// Rejects keys for tables if the format is not a table.
    fn check(&self, format: Format, path: &Path) -> Result<(), HwError> {
        let key = match format {
            Format::Csv | Format::Npy => None,
            _ if self.frames_are.is_some() => Some("frames_are"),
            _ => self.complex.then_some("complex"),
        };
        key.map_or(Ok(()), |key| {
            let (place, format) = (Place::file(path), format.name());
            Err(HwError::UnusedKey { place, key, format, meant: "csv and npy tables" })
        })
    }
}

/// Reads a recording in the given format or, without one, in the recognised format.
///
/// A recording of this crate that was split into parts is read under its own name,
/// without the number of a part.
///
/// A folder with `.eit` files is Sciospec; one with KHU's `ProjectionTableSendLog.txt` is KHU. A
/// file is recognised by the first rule that applies:
/// - first bytes `\x93NUMPY`: NPY; `\x89MCAP`: MCAP;
/// - first line `#MEAS`: LCT;
/// - a line `time_pc [s],` at the start: log of the board `black_sensor`;
/// - ending `.eit`, `.get`, `.npy` or `.csv`: that format;
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
            Format::Sciospec => sciospec::read(path, &options.sciospec),
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
    // neither is an array, which is read in pieces
    if format.is_none_or(|format| format == Format::Npy) && npy::is_npy(path)? {
        options.check(Format::Npy, path)?;
        return npy::read(path, &options.npy());
    }
    let bytes = file_bytes(path, format.map_or("single-file", Format::name))?;
    let format = match format {
        Some(format) => format,
        None => recognise::file(&bytes, path, &options.serial_log)?,
    };
    options.check(format, path)?;
    match format {
        Format::Csv => csv::parse_owned(bytes, path, &options.csv()),
        Format::Npy => npy::parse(&bytes, path, &options.npy()),
        Format::Sciospec => sciospec::parse(&bytes, path, &options.sciospec),
        Format::Goe => goe::parse(&bytes, path),
        Format::Lct => lct::parse(&bytes, path),
        Format::Khu => Err(HwError::NotAFolder { place: Place::file(path), format: "khu" }),
        Format::BlackSensor => black_sensor::parse(&bytes, path),
        Format::SerialLog => serial_log::parse(&bytes, path, &options.serial_log),
        #[cfg(feature = "mcap")]
        Format::Mcap => crate::capture::parse(&bytes, path)?.recording(path),
        #[cfg(not(feature = "mcap"))]
        Format::Mcap => Err(HwError::Unsupported { place: Place::file(path), format: "mcap" }),
    }
}
