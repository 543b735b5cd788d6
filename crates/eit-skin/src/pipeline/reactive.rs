//! Scenes that store charge: the complex forward model.

use super::REAL_BYTES;
use super::mesh_choice::Choice;
use crate::error::SkinError;
use crate::progress::Progress;
use crate::scene::Scene;
use eit_fem::{AdmittivityModel, AdmittivityReport};
use eit_mesh::Mesh;
use std::path::Path;

/// Mesh and complex forward model of a scene.
pub struct ReactiveSetup {
    /// The skin.
    pub mesh: Mesh,
    /// Ready to solve.
    pub model: AdmittivityModel,
    /// What was mended in the mesh file.
    pub notes: Vec<String>,
}

/// Mesh and complex forward model of a scene that stores charge; `mesh_file` overrides its mesh.
pub fn setup(
    scene: &Scene,
    mesh_file: Option<&Path>,
    progress: &mut Progress,
) -> Result<ReactiveSetup, SkinError> {
    let (Choice { mesh, notes, .. }, protocol) =
        super::skin(scene, (mesh_file, None), 2.0 * REAL_BYTES, progress)?;
    let impedance = scene.complex_contact_impedance(mesh.electrodes().len())?;
    let model = progress
        .stage("forward model", || AdmittivityModel::new(&mesh, &protocol, &impedance))
        .map_err(|e| SkinError::from(e).within(&scene.place))?;
    Ok(ReactiveSetup { mesh, model, notes })
}

/// Refuses voltages that rounding may have made worthless; warns where it may have cost digits.
pub fn certain(report: &AdmittivityReport) -> Result<Option<String>, SkinError> {
    super::certain_but_for(report.expected_loss)
}
