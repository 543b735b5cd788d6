//! Protocols of electrode pairs.

use super::pairs::{PairPattern, check_electrodes};
use super::patterns::Protocol;
use crate::error::FemError;

/// Whether a frame includes measurements on current-carrying electrodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum DrivenElectrodes {
    /// Leaves out pairs that include a driven electrode, because their voltages depend on its
    /// contact impedance.
    #[default]
    Drop,
    /// Keeps all pairs.
    Keep,
}

/// Order of the measured pairs under one drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum Order {
    /// Relative to the drive's first electrode `a`: pairs that start at `a`, `a + 1`, ... (mod L).
    /// For adjacent pairs without driven electrodes: `(d + 2 + k, d + 3 + k)`, `k` ascending.
    #[default]
    Rotated,
    /// By the pair's first electrode, from index 0.
    Ascending,
}

/// Settings of a protocol of electrode pairs. Drives are the outer loop, in the order of the drive
/// pattern.
///
/// ```
/// use eit_fem::{PairPattern, PairProtocol};
///
/// // drive opposite electrodes, measure adjacent ones
/// let settings = PairProtocol { drive: PairPattern::Opposite, ..PairProtocol::default() };
/// assert_eq!(settings.quadruples()?[0], [0, 8, 1, 2]);
/// # Ok::<(), eit_fem::FemError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct PairProtocol {
    /// Number of electrodes, `L`.
    pub electrodes: usize,
    /// Current-carrying pairs.
    pub drive: PairPattern,
    /// Measured pairs.
    pub measure: PairPattern,
    /// Whether pairs that include a driven electrode are measured.
    pub driven_electrodes: DrivenElectrodes,
    /// Order of the measured pairs under one drive.
    pub order: Order,
    /// Amplitude of the drive current, ampere.
    pub current_a: f64,
}

impl Default for PairProtocol {
    /// 16 electrodes, adjacent drive and measurement, driven electrodes dropped, rotated order, 0.1
    /// mA: 208 values per frame.
    fn default() -> Self {
        Self {
            electrodes: 16,
            drive: PairPattern::Adjacent,
            measure: PairPattern::Adjacent,
            driven_electrodes: DrivenElectrodes::Drop,
            order: Order::Rotated,
            current_a: 1e-4,
        }
    }
}

impl PairProtocol {
    /// Returns the quadruples `[a, b, m, n]` in protocol order.
    ///
    /// # Errors
    /// Too few electrodes or more than 4096; an odd number of electrodes with opposite pairs;
    /// unknown electrodes; a pair that uses one electrode twice; no measurement left.
    pub fn quadruples(&self) -> Result<Vec<[u32; 4]>, FemError> {
        check_electrodes(self.electrodes)?;
        let drives = self.drive.pairs("drive pair", self.electrodes)?;
        let senses = self.measure.pairs("measured pair", self.electrodes)?;
        let electrodes = self.electrodes as u32;
        let mut quadruples = Vec::with_capacity(drives.len() * senses.len());
        for [a, b] in drives {
            let mut row: Vec<[u32; 2]> = senses
                .iter()
                .copied()
                .filter(|p| {
                    self.driven_electrodes == DrivenElectrodes::Keep
                        || !(p.contains(&a) || p.contains(&b))
                })
                .collect();
            // the sort is stable: explicit pairs with the same first electrode keep their order
            match self.order {
                Order::Rotated => row.sort_by_key(|p| (p[0] + electrodes - a) % electrodes),
                Order::Ascending => row.sort_by_key(|p| p[0]),
            }
            quadruples.extend(row.iter().map(|&[m, n]| [a, b, m, n]));
        }
        if quadruples.is_empty() { Err(FemError::EmptyProtocol) } else { Ok(quadruples) }
    }

    /// Returns the protocol.
    ///
    /// # Errors
    /// Those of [`PairProtocol::quadruples`]; a current that is not finite and above zero.
    pub fn protocol(&self) -> Result<Protocol, FemError> {
        Protocol::from_quadruples(self.electrodes, &self.quadruples()?, self.current_a)
    }
}
