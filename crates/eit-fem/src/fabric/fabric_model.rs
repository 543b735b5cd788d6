//! The simulated fabric with its electrodes.

use super::conductivity::Elements;
use super::motion::Motion;
use super::settings::{FabricSettings, Weave};
use crate::error::FemError;
use crate::model::{Anisotropy, ForwardModel};
use crate::protocol::Protocol;
use eit_mesh::Mesh;

/// Simulated fabric with electrodes.
#[derive(Debug, Clone)]
pub struct Fabric {
    pub(super) mesh: Mesh,
    pub(super) model: ForwardModel,
    pub(super) settings: FabricSettings,
    pub(super) conductivity_s: f64,
    pub(super) contact_impedance: Vec<f64>,
    pub(super) elements: Elements,
    pub(super) motion: Motion,
}

impl Fabric {
    /// Creates a fabric on a mesh, which may be curved. `conductivity_s` is the sheet conductivity, siemens;
    /// `contact_impedance` has one value per electrode (ohm metre for rim electrodes, ohm square
    /// metre for patches).
    ///
    /// # Errors
    /// Those of [`ForwardModel::new`] and [`FabricSettings::validate`]; a conductivity that is not
    /// finite and above zero.
    pub fn new(
        mesh: &Mesh,
        protocol: &Protocol,
        conductivity_s: f64,
        contact_impedance: &[f64],
        settings: &FabricSettings,
    ) -> Result<Self, FemError> {
        settings.validate(mesh.electrodes().len())?;
        let fits = conductivity_s > 0.0;
        FemError::require("conductivity_s", conductivity_s, fits, "finite and above zero")?;
        let mut model = ForwardModel::new(mesh, protocol, contact_impedance)?;
        let Weave { ratio, angle_deg, .. } = settings.weave;
        if ratio != 1.0 {
            let weave = Anisotropy::uniform(mesh.surface(), ratio, angle_deg.to_radians())?;
            model = model.with_anisotropy(&weave)?;
        }
        Ok(Self {
            elements: Elements::new(mesh.surface(), settings.membrane.length_m()),
            motion: Motion::new(mesh, settings),
            mesh: mesh.clone(),
            model,
            settings: settings.clone(),
            conductivity_s,
            contact_impedance: contact_impedance.to_vec(),
        })
    }
}
