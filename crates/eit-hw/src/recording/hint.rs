//! Likely reasons for a mismatch between two counts.

use std::fmt;

use super::orientation::FrameOrientation;

/// Likely reason why the number of values or frames in a file does not match the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum CountHint {
    /// As many frames as measurements in a table read by rows: its frames are columns.
    Transposed,
    /// As many frames as measurements in a table read by columns: its frames are rows.
    TransposedColumns,
    /// All values of the table together form one frame.
    OneFrame,
    /// Twice as many values: real and imaginary parts side by side.
    Complex,
    /// Pairs of whole numbers such as `1,5`, which seem to be numbers with decimal commas.
    DecimalComma,
    /// n^2 values for n electrodes, but the protocol drops driven electrodes.
    DrivenKept {
        /// Number of electrodes n.
        electrodes: usize,
    },
    /// No values on driven electrodes, but the protocol keeps them.
    DrivenDropped {
        /// Number of electrodes n.
        electrodes: usize,
    },
    /// Half as many values: one of each reciprocal pair.
    ReciprocalOnly,
    /// One value more: a column of times or of frame numbers beside the measurements.
    OneMore,
    /// Lines that together may be a frame, with nothing that tells which is the first.
    PartOfFrame,
    /// The count of adjacent drive and measurement, n (n - 3).
    Adjacent {
        /// Number of electrodes n.
        electrodes: usize,
    },
    /// The count of opposite drive and adjacent measurement, n (n - 4).
    Opposite {
        /// Number of electrodes n.
        electrodes: usize,
    },
    /// No known reason.
    Unknown,
}

impl CountHint {
    /// Returns the first reason that fits `found` values in each of `frames` frames for `wanted`
    /// measurements. `frames_are` is the orientation in which a table was read; in other formats
    /// nothing can be swapped.
    pub(crate) fn of(
        found: usize,
        frames: usize,
        wanted: usize,
        frames_are: Option<FrameOrientation>,
    ) -> Self {
        // n with n (n - dropped) = count lies between the root and the root plus dropped;
        // four-point measurement needs at least 4 electrodes
        let electrodes = |count: usize, dropped: usize| {
            let root = count.isqrt();
            (root.max(4)..=root.saturating_add(dropped))
                .find(|n| n.checked_mul(n.saturating_sub(dropped)) == Some(count))
        };
        let square = |count: usize| electrodes(count, 0);
        let swapped = frames == wanted && found != frames;
        let one_frame = frames > 1 && found.checked_mul(frames) == Some(wanted);
        if swapped && frames_are == Some(FrameOrientation::Rows) {
            Self::Transposed
        } else if swapped && frames_are == Some(FrameOrientation::Columns) {
            Self::TransposedColumns
        } else if one_frame && frames_are.is_some() {
            Self::OneFrame
        } else if wanted.checked_mul(2) == Some(found) {
            Self::Complex
        } else if let Some(n) =
            square(found).filter(|n| [n * (n - 3), n * (n - 4)].contains(&wanted))
        {
            Self::DrivenKept { electrodes: n }
        } else if let Some(n) =
            square(wanted).filter(|n| [n * (n - 3), n * (n - 4)].contains(&found))
        {
            Self::DrivenDropped { electrodes: n }
        } else if found.checked_mul(2) == Some(wanted) {
            Self::ReciprocalOnly
        } else if wanted.checked_add(1) == Some(found) && frames_are.is_some() {
            Self::OneMore
        } else if let Some(n) = electrodes(found, 3) {
            Self::Adjacent { electrodes: n }
        } else if let Some(n) = electrodes(found, 4) {
            Self::Opposite { electrodes: n }
        } else {
            Self::Unknown
        }
    }
}

impl fmt::Display for CountHint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Transposed => f.write_str(
                "rows and columns look swapped: set `[recording] frames_are = \"columns\"`",
            ),
            Self::TransposedColumns => f.write_str(
                "rows and columns look swapped: set `[recording] frames_are = \"rows\"`",
            ),
            Self::OneFrame => f.write_str(
                "all values together are one frame: write them in one row, or set `[recording] \
                 frames_are = \"matrix\"` for a matrix [measurement, pattern]",
            ),
            Self::Complex => f.write_str(
                "real and imaginary parts seem to be side by side: keep one, or save complex NPY",
            ),
            Self::DecimalComma => f.write_str(
                "the commas seem to be decimal ones, as in 1,5: write points, as in 1.5, and \
                 separate the numbers by semicolons, commas or spaces",
            ),
            Self::DrivenKept { electrodes } => write!(
                f,
                "{electrodes} x {electrodes} values include the driven electrodes: set \
                 `[protocol] driven_electrodes = \"keep\"`"
            ),
            Self::DrivenDropped { electrodes } => write!(
                f,
                "the driven ones of {electrodes} electrodes seem to be omitted: set \
                 `[protocol] driven_electrodes = \"drop\"`"
            ),
            Self::ReciprocalOnly => f.write_str(
                "this looks like one of each reciprocal pair: list them in \
                 `[protocol] quadruples_file`",
            ),
            Self::OneMore => f.write_str(
                "this is one value more than measurements, as with a column of times or frame numbers: remove \
                 that column, and state the rate of recorded frames as `[recording] frame_rate_hz`",
            ),
            Self::PartOfFrame => f.write_str(
                "lines that are parts of a frame need an empty line, or a pause of 40 ms, between frames",
            ),
            Self::Adjacent { electrodes } => write!(
                f,
                "the file fits {electrodes} electrodes with adjacent drive and measurement: set \
                 `[electrodes] count` and `[protocol]` accordingly"
            ),
            Self::Opposite { electrodes } => write!(
                f,
                "the file fits {electrodes} electrodes with opposite drive and adjacent \
                 measurement: set `[electrodes] count` and `[protocol]` accordingly"
            ),
            Self::Unknown => f.write_str("set `[protocol]` to what was recorded"),
        }
    }
}
