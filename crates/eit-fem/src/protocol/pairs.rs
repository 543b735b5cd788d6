//! Electrode pairs: adjacent, opposite, skip-N and explicit.

use crate::error::FemError;

/// Which pairs of electrodes are used. Except for explicit pairs, pair `d` starts at electrode
/// index `d`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum PairPattern {
    /// `(d, d + 1)` for every electrode.
    #[default]
    Adjacent,
    /// `(d, d + L/2)` for every electrode; `L` even.
    Opposite,
    /// `(d, d + N + 1)` for every electrode: `N` electrodes lie between the two. `Skip(0)` is
    /// adjacent.
    Skip(usize),
    /// Explicit pairs (0-based), in this order.
    Pairs(Vec<[u32; 2]>),
}

impl PairPattern {
    pub(super) fn pairs(
        &self,
        what: &'static str,
        electrodes: usize,
    ) -> Result<Vec<[u32; 2]>, FemError> {
        let step = match self {
            Self::Adjacent => 1,
            Self::Skip(between) => between.saturating_add(1),
            Self::Opposite if electrodes % 2 == 1 => {
                return Err(FemError::NoOpposite { electrodes });
            }
            Self::Opposite => electrodes / 2,
            Self::Pairs(pairs) => {
                for (index, &pair) in pairs.iter().enumerate() {
                    check_pair(what, index, pair, electrodes)?;
                }
                return Ok(pairs.clone());
            }
        };
        if step == 0 || step >= electrodes {
            let (pattern, needed) = (format!("a {what} of step {step}"), step.max(1) + 1);
            return Err(FemError::TooFewElectrodes { electrodes, pattern, needed });
        }
        Ok((0..electrodes).map(|d| [d as u32, ((d + step) % electrodes) as u32]).collect())
    }
}

pub(super) fn check_pair(
    what: &'static str,
    index: usize,
    pair: [u32; 2],
    electrodes: usize,
) -> Result<(), FemError> {
    if let Some(&electrode) = pair.iter().find(|&&e| e as usize >= electrodes) {
        return Err(FemError::UnknownElectrode { what, index, electrode, electrodes });
    }
    if pair[0] == pair[1] {
        return Err(FemError::DegeneratePair { what, index, electrode: pair[0] });
    }
    Ok(())
}

/// Rejects more electrodes than any skin has: adjacent pairs of 4096 give 17 million measurements.
pub(super) fn check_electrodes(electrodes: usize) -> Result<(), FemError> {
    let (quantity, value) = ("the number of electrodes", electrodes as f64);
    FemError::require(quantity, value, electrodes <= 4096, "at most 4096")
}
