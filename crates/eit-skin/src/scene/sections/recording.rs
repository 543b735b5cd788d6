//! Section `[recording]` of a scene file.

use crate::scene::FrameRange;
use eit_hw::{Component, FrameOrientation};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// `[recording]`
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RecordingSettings {
    /// Files with the frames.
    pub file: Option<OneOrManyFiles>,
    /// Name of the format, if the file name extension does not tell.
    pub format: Option<String>,
    /// How a table is arranged.
    pub frames_are: Option<FrameOrientation>,
    /// Which array of a file of several has the frames.
    pub array: Option<String>,
    /// Whether a table holds complex numbers.
    #[serde(default)]
    pub complex: bool,
    /// Which real quantity is computed from complex data.
    #[serde(default)]
    pub component: Component,
    /// Row of the frequency in a Sciospec file.
    pub frequency_row: Option<usize>,
    /// The reference frame, which is subtracted.
    pub reference: Option<Reference>,
    /// Frames before this one are skipped.
    pub first_frame: Option<usize>,
    /// Frames per second, if the file does not tell.
    pub frame_rate_hz: Option<f64>,
    /// What the values are.
    #[serde(default)]
    pub values: ValueKind,
    /// Factor for every voltage: -1 reverses the polarity, 1e-3 converts millivolts to volts.
    pub scale: Option<f64>,
}

/// What an instrument reports of a voltage V; factors do not matter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ValueKind {
    /// V.
    #[default]
    Voltage,
    /// 1 / V, as impedance converters do that measure the current of a given voltage.
    Reciprocal,
    /// 20 lg |V|.
    Decibel,
    /// V squared, a power.
    Squared,
}

impl ValueKind {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Voltage, Self::Reciprocal, Self::Decibel, Self::Squared];

    /// The voltage of a value; not finite if there is none.
    pub fn voltage(self, value: f64) -> f64 {
        match self {
            Self::Voltage => value,
            Self::Reciprocal => value.recip(),
            Self::Decibel => 10.0_f64.powf(value / 20.0),
            Self::Squared => value.sqrt(),
        }
    }

    /// What an instrument reports of a voltage.
    pub fn of_voltage(self, voltage: f64) -> f64 {
        match self {
            Self::Voltage => voltage,
            Self::Reciprocal => voltage.recip(),
            Self::Decibel => 20.0 * voltage.abs().log10(),
            Self::Squared => voltage * voltage,
        }
    }

    /// The name in a scene, and what it means.
    pub fn name(self) -> (&'static str, &'static str) {
        match self {
            Self::Voltage => ("voltage", "V"),
            Self::Reciprocal => ("reciprocal", "1 / V"),
            Self::Decibel => ("decibel", "20 lg V"),
            Self::Squared => ("squared", "V squared"),
        }
    }
}

/// One file, or several whose frames are concatenated.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(untagged, expecting = "a file name, or a list of them")]
pub enum OneOrManyFiles {
    /// A single file.
    One(PathBuf),
    /// Several files, in the order of their frames.
    Many(Vec<PathBuf>),
}

/// `recording.reference` or `--reference`: a frame number, "mean", "N..M" or a file.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(untagged, expecting = "a frame number, \"mean\", \"N..M\" or a file name")]
pub enum Reference {
    /// One frame, from 0.
    Frame(usize),
    /// "mean", "N..M" (frames N to M - 1) or a file.
    Text(String),
}

/// Fewer frames do not show the noise.
pub(crate) const LEAST_REFERENCE_FRAMES: usize = 8;

impl Reference {
    /// Number of frames if they are the first ones of the recording and enough for a reference of live frames.
    pub fn first_frames(&self) -> Option<usize> {
        let Self::Text(text) = self else { return None };
        let range: FrameRange = text.parse().ok()?;
        let is_enough = range.start == 0 && range.end >= LEAST_REFERENCE_FRAMES;
        is_enough.then_some(range.end)
    }

    /// Returns whether a text names a file rather than frames.
    pub(crate) fn is_file(text: &str) -> bool {
        let is_range = text.parse::<FrameRange>().is_ok();
        text != "mean" && !is_range && text.parse::<usize>().is_err()
    }
}
