//! Readers of recorded files, one per format, and the recognition of the format.
//!
//! Each reader is a pure `parse` from bytes and a `read` that opens the file. The path given to
//! `parse` is only for messages.

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

/// Options of every reader; each reader looks at its own.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadOptions {
    /// `[recording] frames_are`: what one frame is, for [`Format::Csv`] and [`Format::Npy`]; other
    /// formats refuse it. `None`: what `csv` and `npy` say.
    pub frames_are: Option<FrameOrientation>,
    /// `[recording] complex`: rows (or columns) alternate real and imaginary parts, for
    /// [`Format::Csv`] and [`Format::Npy`]; other formats refuse it. `false`: what `csv` and `npy`
    /// say.
    pub complex: bool,
    /// For [`Format::Csv`].
    pub csv: csv::CsvOptions,
    /// For [`Format::Npy`].
    pub npy: npy::NpyOptions,
    /// For [`Format::Sciospec`].
    pub sciospec: sciospec::SciospecOptions,
    /// For [`Format::SerialLog`].
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

    /// Refuses the keys of tables for a format that is none.
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

/// Reads a recording, in the format given or, without one, in the format recognised.
///
/// A folder with `.eit` files is Sciospec, one with KHU's `ProjectionTableSendLog.txt` KHU. Of a
/// file, in this order: the first bytes `\x93NUMPY` are NPY, `\x89MCAP` MCAP; the first line `#MEAS` is LCT;
/// a line `time_pc [s],` at the start is a log of the board `black_sensor`; the
/// endings `.eit`, `.get`, `.npy` and `.csv` are what they say; other text is a serial log if it
/// has a line `s`, `ref:` or `data:`, else CSV. Text that may be either (lines of as many numbers
/// as a serial log has, without any `s`) and all else is an error that names the key
/// `[recording] format`.
///
/// # Errors
/// [`HwError`] of the reader, or [`HwError::Unrecognised`] and [`HwError::Ambiguous`];
/// [`HwError::UnusedKey`] where the options say how a table is laid out and the format is none.
pub fn read_recording(
    path: &Path,
    format: Option<Format>,
    options: &ReadOptions,
) -> Result<Recording, HwError> {
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
    // message by message: the file is not held beside its frames
    #[cfg(feature = "mcap")]
    if format.is_none_or(|format| format == Format::Mcap) && files::begins_with(path, MCAP_MAGIC)? {
        options.check(Format::Mcap, path)?;
        return crate::capture::read_frames(path);
    }
    let bytes = file_bytes(path, format.map_or("single-file", Format::name))?;
    let format = match format {
        Some(format) => format,
        None => recognise::file(&bytes, path, &options.serial_log)?,
    };
    options.check(format, path)?;
    match format {
        Format::Csv => csv::parse(&bytes, path, &options.csv()),
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
