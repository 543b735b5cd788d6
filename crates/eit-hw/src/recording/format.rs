//! Formats of recorded files, by name.

use std::fmt;
use std::str::FromStr;

use crate::error::{HwError, shortened};

/// A format of recorded files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Format {
    /// Numbers as text, a frame per row, per column or as a matrix. The first of semicolons, commas,
    /// tabs and spaces in the first line of numbers separates fields; `#` starts a comment. Values
    /// are in protocol order, of [`Unit::Arbitrary`](super::Unit::Arbitrary); one that is not finite
    /// is flagged [`Quality::NON_FINITE`](crate::Quality::NON_FINITE).
    Csv,
    /// NumPy array of integers, floats or complex numbers, in either byte and axis order; frames as in
    /// [`Format::Csv`], and `[measurement]` is one frame.
    Npy,
    /// NumPy archive of such arrays, one of which has the frames ([`ReadOptions`](crate::ReadOptions));
    /// needs the feature `arrays`.
    Npz,
    /// MATLAB file of version 5 (`-v6`, `-v7`), one of whose arrays has the frames; needs the feature
    /// `arrays`.
    Mat,
    /// Sciospec `.eit` text frames, one per file: complex potentials of all electrodes in volts.
    Sciospec,
    /// Goe-MF II `.get`: 16 electrodes, 208 values in "rotated" order, of unknown scale.
    Goe,
    /// LCT text of the University of Manchester: complex ohms, measured pairs ascending.
    Lct,
    /// Folder of KHU Mark2.5 scans: complex volts with their quadruples.
    Khu,
    /// Raw serial log of decimal numbers: a line `s`, then the lines of a frame
    /// ([`SerialLogOptions`](crate::SerialLogOptions)). Incomplete frames are skipped and counted.
    SerialLog,
    /// Log of the board `black_sensor`, as its own program writes it: 256 counts, driven electrodes
    /// included.
    BlackSensor,
    /// MCAP recording of a live instrument; needs the feature `mcap`.
    Mcap,
}

impl Format {
    /// Every format.
    pub const ALL: [Self; 11] = [
        Self::Csv,
        Self::Npy,
        Self::Npz,
        Self::Mat,
        Self::Sciospec,
        Self::Goe,
        Self::Lct,
        Self::Khu,
        Self::SerialLog,
        Self::BlackSensor,
        Self::Mcap,
    ];

    /// Returns the name in the scene file: `csv`, `npy`, `npz`, `mat`, `sciospec`, `goe`, `lct`, `khu`,
    /// `serial-log`, `black-sensor`, `mcap`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Csv => "csv",
            Self::Npy => "npy",
            Self::Npz => "npz",
            Self::Mat => "mat",
            Self::Sciospec => "sciospec",
            Self::Goe => "goe",
            Self::Lct => "lct",
            Self::Khu => "khu",
            Self::SerialLog => "serial-log",
            Self::BlackSensor => "black-sensor",
            Self::Mcap => "mcap",
        }
    }

    /// Returns all names, for messages.
    pub(crate) fn known() -> String {
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
