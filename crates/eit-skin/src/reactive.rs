//! Reactive skins, whose capacitances carry current: the complex forward model.

use crate::error::SkinError;
use crate::limits::warning_of_loss;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::skin::{Body, MeshOverride, REAL_BYTES};
use eit_fem::{AdmittivityModel, AdmittivityReport, Complex64};
use eit_mesh::Mesh;

/// A reactive skin: mesh and complex forward model.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct ReactiveSkin {
    /// Name for titles.
    pub name: String,
    /// The skin's surface with its electrodes.
    pub mesh: Mesh,
    /// Forward model, ready to solve.
    pub model: AdmittivityModel,
    /// Admittivity of the untouched sheet, siemens per square.
    pub background: Complex64,
    /// Frequency of the drive current, hertz.
    pub frequency_hz: f64,
    /// Repairs made to the mesh file.
    pub notes: Vec<String>,
    /// Whether the mesh was read from a file.
    pub from_file: bool,
    /// Capacitance of the sheet, farad per square.
    capacitance_f: f64,
}

impl ReactiveSkin {
    /// Builds a reactive skin.
    ///
    /// # Errors
    ///
    /// A scene that cannot be built; the message names key, value and location.
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

    /// Returns the admittivity of a sheet with this conductivity and the skin's capacitance, siemens per
    /// square.
    pub fn admittivity_of(&self, conductivity_s: f64) -> Complex64 {
        eit_fem::admittivity(conductivity_s, self.capacitance_f, self.frequency_hz)
    }
}

/// Rejects voltages that rounding may have made meaningless; warns if it may have cost digits.
///
/// # Errors
///
/// An expected loss above a tenth of the largest voltage.
pub fn rounding_warning(report: &AdmittivityReport) -> Result<Option<String>, SkinError> {
    warning_of_loss(report.expected_loss)
}
