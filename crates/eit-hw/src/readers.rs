//! Readers of recorded files, one per format, and the recognition of the format.
//!
//! Each reader is a pure `parse` from bytes and a `read` that opens the file. The path given to
//! `parse` is only for messages.

pub mod csv;
pub mod goe;
pub mod khu;
pub mod lct;
pub mod npy;
pub mod sciospec;
pub mod serial_log;

mod recognise;
mod table;
mod text;

use std::fmt;
use std::fs;
use std::path::Path;
use std::str::FromStr;

use crate::error::{HwError, Place, shortened};
use crate::recording::{Note, Recording};

/// A format of recorded files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Format {
    /// Numbers as text, see [`csv`].
    Csv,
    /// NumPy array, see [`npy`].
    Npy,
    /// Sciospec `.eit` text frames, see [`sciospec`].
    Sciospec,
    /// Goe-MF II `.get`, see [`goe`].
    Goe,
    /// LCT text of Manchester, see [`lct`].
    Lct,
    /// KHU Mark2.5 scans, see [`khu`].
    Khu,
    /// Raw serial log of lines of decimals, see [`serial_log`].
    SerialLog,
    /// Recording of a live instrument in MCAP; read with the feature `mcap`.
    Mcap,
}

impl Format {
    /// Every format.
    pub const ALL: [Self; 8] = [
        Self::Csv,
        Self::Npy,
        Self::Sciospec,
        Self::Goe,
        Self::Lct,
        Self::Khu,
        Self::SerialLog,
        Self::Mcap,
    ];

    /// Name in the scene file: `csv`, `npy`, `sciospec`, `goe`, `lct`, `khu`, `serial-log`,
    /// `mcap`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Csv => "csv",
            Self::Npy => "npy",
            Self::Sciospec => "sciospec",
            Self::Goe => "goe",
            Self::Lct => "lct",
            Self::Khu => "khu",
            Self::SerialLog => "serial-log",
            Self::Mcap => "mcap",
        }
    }

    /// All names, for messages.
    fn known() -> String {
        Self::ALL.map(|format| format!("\"{format}\"")).join(", ")
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Format {
    type Err = HwError;

    fn from_str(name: &str) -> Result<Self, HwError> {
        Self::ALL
            .into_iter()
            .find(|format| format.name() == name)
            .ok_or_else(|| HwError::UnknownFormat { name: shortened(name), known: Self::known() })
    }
}

/// What one frame is in a table of numbers [row, column].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FrameOrientation {
    /// A row: the table is [frame, measurement].
    #[default]
    Rows,
    /// A column: the table is [measurement, frame].
    Columns,
    /// The whole table, [measurement, pattern], taken with the measurements of one pattern after
    /// the other.
    Matrix,
}

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
/// file, in this order: the first bytes `\x93NUMPY` are NPY, `\x89MCAP` MCAP; the first line `#MEAS` is LCT; the
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
        Format::SerialLog => serial_log::parse(&bytes, path, &options.serial_log),
        #[cfg(feature = "mcap")]
        Format::Mcap => crate::capture::parse(&bytes, path)?.recording(path),
        #[cfg(not(feature = "mcap"))]
        Format::Mcap => Err(HwError::Unsupported { place: Place::file(path), format: "mcap" }),
    }
}

/// Bytes of a file; a folder is an error of its own.
fn file_bytes(path: &Path, format: &'static str) -> Result<Vec<u8>, HwError> {
    if path.is_dir() {
        return Err(HwError::Folder { place: Place::file(path), format });
    }
    fs::read(path).map_err(|source| HwError::Read { place: Place::file(path), source })
}

/// Names of the files of a folder, sorted. A name that is no text belongs to no format.
fn file_names(folder: &Path) -> Result<Vec<String>, HwError> {
    let unreadable = |source| HwError::Read { place: Place::file(folder), source };
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        names.extend(entry.map_err(unreadable)?.file_name().into_string());
    }
    names.sort();
    Ok(names)
}

/// A note where sorted numbers have holes.
fn missing_numbers(numbers: impl Iterator<Item = u64>) -> Option<Note> {
    let (mut count, mut first, mut before) = (0, None, None);
    for number in numbers {
        if let Some(before) = before {
            let gap = number.saturating_sub(before).saturating_sub(1);
            if gap > 0 {
                first = first.or(Some(before + 1));
                count += gap;
            }
        }
        before = Some(number);
    }
    first.map(|first| Note::MissingFrameFiles { count, first })
}
