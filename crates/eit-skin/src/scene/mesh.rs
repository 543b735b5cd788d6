//! How a scene's mesh comes about.

use crate::error::SkinError;
use eit_mesh::{Mesh, MeshSettings, PlacedElectrode, RimElectrodes, SkinShape};
use std::path::{Path, PathBuf};

/// Generated, or from a file.
pub enum SceneMesh {
    /// Generated from a shape.
    Generated { shape: SkinShape, electrodes: SceneElectrodes, settings: MeshSettings },
    /// Read from a file, in units of `scale_m` metres; with electrodes put on it where it has none.
    File { path: PathBuf, scale_m: f64, electrodes: Vec<PlacedElectrode>, settings: MeshSettings },
}

/// The electrodes that a scene describes.
pub enum SceneElectrodes {
    /// All on the rim and of one width.
    Rim(RimElectrodes),
    /// Each at its place and of its size.
    Placed(Vec<PlacedElectrode>),
}

impl SceneElectrodes {
    fn count(&self) -> usize {
        match self {
            Self::Rim(electrodes) => electrodes.count(),
            Self::Placed(electrodes) => electrodes.len(),
        }
    }
}

impl SceneMesh {
    /// A mesh file that brings its electrodes.
    pub fn file(path: &Path) -> Self {
        let (electrodes, settings) = (Vec::new(), MeshSettings::default());
        Self::File { path: path.to_path_buf(), scale_m: 1.0, electrodes, settings }
    }

    /// Number of electrodes, where it is known before meshing.
    pub fn electrodes(&self) -> Option<usize> {
        match self {
            Self::Generated { electrodes, .. } => Some(electrodes.count()),
            Self::File { electrodes, .. } if electrodes.is_empty() => None,
            Self::File { electrodes, .. } => Some(electrodes.len()),
        }
    }

    /// Generates or reads the mesh.
    pub fn build(&self) -> Result<Mesh, SkinError> {
        self.build_noted().map(|(mesh, _)| mesh)
    }

    /// The mesh, and what was mended in the file that it came from.
    pub fn build_noted(&self) -> Result<(Mesh, Vec<String>), SkinError> {
        let (path, scale_m, electrodes, settings) = match self {
            Self::Generated { shape, electrodes: SceneElectrodes::Rim(rim), settings } => {
                return Ok((eit_mesh::generate(shape, rim, settings)?, Vec::new()));
            }
            Self::Generated { shape, electrodes: SceneElectrodes::Placed(placed), settings } => {
                return Ok((eit_mesh::generate_placed(shape, placed, settings)?, Vec::new()));
            }
            Self::File { path, scale_m, electrodes, settings } => {
                (path, *scale_m, electrodes, settings)
            }
        };
        // a file that cannot be read is bad input, unlike one that cannot be written
        let (mesh, repairs) =
            eit_mesh::read_mesh(path, scale_m).map_err(|e| SkinError::input(e.to_string()))?;
        let notes = repairs.notes().into_iter().map(|n| format!("{}: {n}", path.display()));
        let notes = notes.collect();
        if electrodes.is_empty() {
            return Ok((mesh, notes));
        }
        let own = mesh.electrodes().len();
        if own > 0 {
            return Err(SkinError::input(format!(
                "{} brings {own} electrodes and the scene has electrodes.positions_m: keep one",
                path.display()
            )));
        }
        Ok((eit_mesh::place_electrodes(mesh.surface(), electrodes, settings)?, notes))
    }
}
