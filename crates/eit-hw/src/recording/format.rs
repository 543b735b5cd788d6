//! Formats of recorded files, by name.

use std::fmt;
use std::str::FromStr;

use crate::error::{HwError, shortened};

/// A format of recorded files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Format {
    /// Numbers as text; see [`csv`](crate::csv).
    Csv,
    /// NumPy array; see [`npy`](crate::npy).
    Npy,
    /// Sciospec `.eit` text frames; see [`sciospec`](crate::sciospec).
    Sciospec,
    /// Goe-MF II `.get`; see [`goe`](crate::goe).
    Goe,
    /// LCT text of the University of Manchester; see [`lct`](crate::lct).
    Lct,
    /// KHU Mark2.5 scans; see [`khu`](crate::khu).
    Khu,
    /// Raw serial log of decimal numbers; see [`serial_log`](crate::serial_log).
    SerialLog,
    /// Log of the board `black_sensor`; see [`black_sensor`](crate::black_sensor).
    BlackSensor,
    /// MCAP recording of a live instrument; needs the feature `mcap`.
    Mcap,
}

impl Format {
    /// Every format.
    pub const ALL: [Self; 9] = [
        Self::Csv,
        Self::Npy,
        Self::Sciospec,
        Self::Goe,
        Self::Lct,
        Self::Khu,
        Self::SerialLog,
        Self::BlackSensor,
        Self::Mcap,
    ];

    /// Returns the name in the scene file: `csv`, `npy`, `sciospec`, `goe`, `lct`, `khu`,
    /// `serial-log`, `black-sensor`, `mcap`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Csv => "csv",
            Self::Npy => "npy",
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
