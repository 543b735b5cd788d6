//! An electrode by position.

use crate::MeshError;

/// An electrode wanted at a place of a skin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacedElectrode {
    /// Its centre, metres; moved to the nearest point of the skin or of its rim. Flat skins lie at
    /// z = 0.
    pub position_m: [f64; 3],
    /// What it covers.
    pub contact: Contact,
}

/// What an electrode covers.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Contact {
    /// A length of rim.
    Rim {
        /// Length measured along the rim, metres.
        width_m: f64,
    },
    /// A round patch of the skin: all of it that is nearer to the centre than the radius, in
    /// space, and hangs together with the centre.
    Patch {
        /// Radius, metres.
        radius_m: f64,
    },
}

impl PlacedElectrode {
    /// An electrode on the rim.
    pub fn rim(position_m: [f64; 3], width_m: f64) -> Self {
        Self { position_m, contact: Contact::Rim { width_m } }
    }

    /// A round patch.
    pub fn patch(position_m: [f64; 3], radius_m: f64) -> Self {
        Self { position_m, contact: Contact::Patch { radius_m } }
    }

    /// Width or diameter, metres.
    pub fn width_m(&self) -> f64 {
        match self.contact {
            Contact::Rim { width_m } => width_m,
            Contact::Patch { radius_m } => 2.0 * radius_m,
        }
    }

    /// Refuses positions and sizes that are no numbers, or lost in rounding.
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
