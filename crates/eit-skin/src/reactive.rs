//! Skins that store charge: the complex forward model.

use crate::error::SkinError;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::skin::{Body, MeshOverride, REAL_BYTES, warning_of_loss};
use eit_fem::{AdmittivityModel, AdmittivityReport, Complex64};
use eit_mesh::Mesh;

/// A skin whose capacitances carry current: mesh and complex forward model.
#[derive(Debug)]
pub struct ReactiveSkin {
    /// Name for titles.
    pub name: String,
    /// The skin's surface with its electrodes.
    pub mesh: Mesh,
    /// Ready to solve.
    pub model: AdmittivityModel,
    /// Of the untouched sheet, siemens per square.
    pub background: Complex64,
    /// Of the drive current.
    pub frequency_hz: f64,
    /// What was mended in the mesh file.
    pub notes: Vec<String>,
    /// Whether the mesh is that of a file.
    pub from_file: bool,
    /// Capacitance of the sheet, farad per square.
    capacitance_f: f64,
}

impl ReactiveSkin {
    /// Sets up a skin that stores charge.
    ///
    /// # Errors
    ///
    /// A scene that cannot be built; the message names key, value and place.
    pub fn set_up(
        scene: &Scene,
        mesh: &MeshOverride,
        progress: &mut Progress,
    ) -> Result<Self, SkinError> {
        let Body { choice, protocol, source } = Body::of(scene, mesh, 2.0 * REAL_BYTES, progress)?;
        let impedance = scene.complex_contact_impedance(choice.mesh.electrodes().len())?;
        let model = progress
            .stage("forward model", || AdmittivityModel::new(&choice.mesh, &protocol, &impedance))
            .map_err(|e| SkinError::from(e).within(&scene.place))?;
        Ok(Self {
            name: scene.name.clone(),
            mesh: choice.mesh,
            model,
            background: scene.admittivity_of(scene.skin.conductivity_s),
            frequency_hz: scene.frequency_hz(),
            notes: choice.notes,
            from_file: source.is_file(),
            capacitance_f: scene.skin.sheet_capacitance_f.unwrap_or(0.0),
        })
    }

    /// Admittivity of a sheet of this conductivity and the skin's capacitance, siemens per square.
    pub fn admittivity_of(&self, conductivity_s: f64) -> Complex64 {
        eit_fem::admittivity(conductivity_s, self.capacitance_f, self.frequency_hz)
    }
}

/// Refuses voltages that rounding may have made worthless; warns where it may have cost digits.
///
/// # Errors
///
/// An expected loss above a tenth of the largest voltage.
pub fn rounding_warning(report: &AdmittivityReport) -> Result<Option<String>, SkinError> {
    warning_of_loss(report.expected_loss)
}
