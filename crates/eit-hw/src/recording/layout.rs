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
    /// Potentials of electrodes against a common ground for each drive, in ascending order: of all,
    /// value `drive * electrodes + electrode`, or of all but the two that are driven. The measurement
    /// `[a, b, m, n]` is the difference u(m) - u(n) for the drive `[a, b]`, or its negative for `[b, a]`.
    Potentials {
        /// Electrodes where current enters and leaves, per drive.
        drives: Vec<[u32; 2]>,
        /// Number of electrodes.
        electrodes: usize,
        /// Whether the potentials of the driven electrodes are among them.
        driven: bool,
    },
}

impl Layout {
    /// Returns the number of drives of a protocol's quadruples or of this layout, at least 1.
    pub(crate) fn drives(&self, quadruples: Option<&[Quadruple]>) -> usize {
        let same = |one: &Quadruple, other: &Quadruple| one[..2] == other[..2];
        match self {
            Self::Potentials { drives, .. } => drives.len(),
            _ => quadruples.map_or(1, |all| all.chunk_by(same).count()),
        }
        .max(1)
    }

    /// Returns the number of values in the layout; `None` for [`Layout::ProtocolOrder`], which has
    /// any number.
    pub fn value_count(&self) -> Option<usize> {
        match self {
            Self::ProtocolOrder => None,
            Self::Quadruples(quadruples) => Some(quadruples.len()),
            Self::Potentials { drives, electrodes, driven } => {
                let undriven = electrodes.saturating_sub(2);
                Some(drives.len().saturating_mul(if *driven { *electrodes } else { undriven }))
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
