//! Which electrodes and which unit recorded values have.

use crate::frame::Quadruple;

/// Which electrodes the values of a frame belong to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Layout {
    /// The file does not name electrodes: values are taken to be in the order of the scene's
    /// protocol, and must be as many.
    ProtocolOrder,
    /// The electrodes of each value.
    Quadruples(Vec<Quadruple>),
    /// Potentials of all electrodes against a common ground for each drive: value
    /// `drive * electrodes + electrode`. The measurement `[a, b, m, n]` is the difference
    /// u(m) - u(n) under the drive `[a, b]`, or its negative under `[b, a]`.
    Potentials {
        /// Where current enters and leaves, per drive.
        drives: Vec<[u32; 2]>,
        /// Potentials per drive.
        electrodes: usize,
    },
}

impl Layout {
    /// How many values it names; [`Layout::ProtocolOrder`] fits any number.
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
pub enum Unit {
    /// Volt.
    Volt,
    /// Ohm: voltage over measured current.
    Ohm,
    /// Not stated by the file: counts, or volts of an unknown scale.
    Arbitrary,
}
