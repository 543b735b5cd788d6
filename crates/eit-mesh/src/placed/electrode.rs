//! An electrode given by its position.

use crate::MeshError;

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
        if self.position_m.iter().any(|x| !x.is_finite()) {
            let (position_m, distance_m) = (self.position_m, f64::NAN);
            let what = "point of the skin";
            let tolerance_m = 0.0;
            return Err(MeshError::OffSurface {
                electrode,
                position_m,
                distance_m,
                tolerance_m,
                what,
            });
        }
        Ok(())
    }
}
