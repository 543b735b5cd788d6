//! An electrode given by its position.

use crate::MeshError;
use crate::rim_electrodes::{RimInterval, SMALLEST};

/// An electrode to be placed on a skin.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PlacedElectrode {
    /// Centre, metres; moved to the nearest point of the skin or of its rim. Flat skins lie at z =
    /// 0.
    pub position_m: [f64; 3],
    /// The area or length it covers.
    pub contact: Contact,
}

/// The area or length that an electrode covers.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Contact {
    /// A length of rim.
    Rim {
        /// Length measured along the rim, metres.
        width_m: f64,
    },
    /// A round patch of the skin: everything within the radius of the centre, measured in space,
    /// that is connected to the centre.
    Patch {
        /// Radius, metres.
        radius_m: f64,
    },
}

impl PlacedElectrode {
    /// Creates an electrode on the rim.
    pub fn rim(position_m: [f64; 3], width_m: f64) -> Self {
        Self { position_m, contact: Contact::Rim { width_m } }
    }

    /// Creates a round patch.
    pub fn patch(position_m: [f64; 3], radius_m: f64) -> Self {
        Self { position_m, contact: Contact::Patch { radius_m } }
    }

    /// Returns the width or diameter, metres.
    pub fn width_m(&self) -> f64 {
        match self.contact {
            Contact::Rim { width_m } => width_m,
            Contact::Patch { radius_m } => 2.0 * radius_m,
        }
    }

    /// Rejects positions and sizes that are not finite, and sizes below rounding error.
    pub(crate) fn check(&self, electrode: usize, least_m: f64) -> Result<(), MeshError> {
        let (quantity, value) = match self.contact {
            Contact::Rim { width_m } => ("width_m", width_m),
            Contact::Patch { radius_m } => ("radius_m", radius_m),
        };
        if !(value.is_finite() && value >= least_m) {
            let must = "finite and at least 1e-8 of the skin's size";
            return Err(MeshError::ElectrodeSize { electrode, quantity, value, must });
        }
        match self.position_m.iter().all(|x| x.is_finite()) {
            true => Ok(()),
            false => self.check_distance(electrode, f64::NAN, 0.0, "point of the skin"),
        }
    }

    /// Rejects a position too far from the skin.
    pub(crate) fn check_distance(
        &self,
        electrode: usize,
        distance_m: f64,
        tolerance_m: f64,
        what: &'static str,
    ) -> Result<(), MeshError> {
        // NaN fails this comparison
        if distance_m <= tolerance_m {
            return Ok(());
        }
        let position_m = self.position_m;
        Err(MeshError::OffSurface { electrode, position_m, distance_m, tolerance_m, what })
    }

    /// Returns the rim that an electrode covers around a rim point (loop, arc length).
    pub(crate) fn interval(
        &self,
        electrode: usize,
        (loop_index, centre_m): (usize, f64),
        length_m: f64,
        resolution_m: f64,
    ) -> Result<RimInterval, MeshError> {
        let width_m = self.width_m();
        if width_m > length_m - SMALLEST * resolution_m {
            let (quantity, value) = ("width_m", width_m);
            let must = "shorter than the rim that the electrode lies on";
            return Err(MeshError::ElectrodeSize { electrode, quantity, value, must });
        }
        let start_m = (centre_m - 0.5 * width_m).rem_euclid(length_m);
        Ok(RimInterval { loop_index, start_m, width_m })
    }
}
