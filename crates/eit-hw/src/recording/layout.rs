//! Electrodes and unit of recorded values.

use crate::frame::Quadruple;

/// Electrodes of the values of a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Layout {
    /// The file does not name electrodes: values are assumed to be in the order of the scene's
    /// protocol, and their number must match.
    ProtocolOrder,
    /// Electrodes of each value.
    Quadruples(Vec<Quadruple>),
    /// Potentials of all electrodes against a common ground for each drive: value `drive *
    /// electrodes + electrode`. The measurement `[a, b, m, n]` is the difference u(m) - u(n) for
    /// the drive `[a, b]`, or its negative for `[b, a]`.
    Potentials {
        /// Electrodes where current enters and leaves, per drive.
        drives: Vec<[u32; 2]>,
        /// Number of potentials per drive.
        electrodes: usize,
    },
}

impl Layout {
    /// Returns the number of values in the layout; `None` for [`Layout::ProtocolOrder`], which has
    /// any number.
    pub(crate) fn value_count(&self) -> Option<usize> {
        match self {
            Self::ProtocolOrder => None,
            Self::Quadruples(quadruples) => Some(quadruples.len()),
            Self::Potentials { drives, electrodes } => {
                Some(drives.len().saturating_mul(*electrodes))
            }
        }
    }
}

/// Unit of recorded values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Unit {
    /// Voltages in volts.
    Volt,
    /// Ohm: voltage divided by measured current.
    Ohm,
    /// Not stated by the file: counts, or volts of an unknown scale.
    Arbitrary,
}
