//! Where a skin's mesh comes from.

use super::check::check_length;
use crate::error::SkinError;
use eit_mesh::{Mesh, MeshSettings, PlacedElectrode, RimElectrodes, SkinShape};
use std::path::{Path, PathBuf};

/// Source of a skin's mesh.
#[derive(Debug, Clone, PartialEq)]
pub enum MeshSource {
    /// Generated from a shape.
    Generated {
        /// Outline and holes, or a dome.
        shape: SkinShape,
        /// Positions and sizes of the electrodes.
        electrodes: ElectrodeSource,
        /// Density, adjusted to the requested number of nodes if one is stated.
        settings: MeshSettings,
        /// Density before adjustment to a number of nodes.
        base: MeshSettings,
    },
    /// Read from a file.
    File {
        /// Gmsh, STL or OBJ.
        path: PathBuf,
        /// Metres per unit of the file.
        scale_m: f64,
        /// Electrodes placed on the surface if the file has none.
        electrodes: Vec<PlacedElectrode>,
        /// Density around placed electrodes.
        settings: MeshSettings,
    },
}

/// The electrodes of a generated skin.
#[derive(Debug, Clone, PartialEq)]
pub enum ElectrodeSource {
    /// All on the rim and of equal width.
    Rim(RimElectrodes),
    /// Each with its own position and size.
    Placed(Vec<PlacedElectrode>),
}

/// A mesh, and the repairs made to its file.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct BuiltMesh {
    /// Mesh with its electrodes.
    pub mesh: Mesh,
    /// One line per repair.
    pub notes: Vec<String>,
}

impl ElectrodeSource {
    /// Returns the number of electrodes.
    pub fn count(&self) -> usize {
        match self {
            Self::Rim(electrodes) => electrodes.count(),
            Self::Placed(electrodes) => electrodes.len(),
        }
    }
}

impl MeshSource {
    /// Creates a source for a mesh file that contains its electrodes.
    pub(crate) fn file(path: impl AsRef<Path>) -> Self {
        let path = path.as_ref();
        let (electrodes, settings) = (Vec::new(), MeshSettings::default());
        Self::File { path: path.to_path_buf(), scale_m: 1.0, electrodes, settings }
    }

    /// Returns whether the source is a mesh file.
    pub fn is_file(&self) -> bool {
        matches!(self, Self::File { .. })
    }

    /// Returns the number of electrodes if it is known before meshing.
    pub fn electrodes(&self) -> Option<usize> {
        match self {
            Self::Generated { electrodes, .. } => Some(electrodes.count()),
            Self::File { electrodes, .. } if electrodes.is_empty() => None,
            Self::File { electrodes, .. } => Some(electrodes.len()),
        }
    }

    /// Returns the same skin with about this many nodes.
    ///
    /// # Errors
    ///
    /// A mesh file, whose nodes are fixed; electrodes that do not fit their rim.
    pub fn with_nodes(&self, nodes: usize) -> Result<Self, SkinError> {
        let Self::Generated { shape, electrodes, base, .. } = self else {
            return Err(SkinError::argument("nodes", "a mesh file has the nodes that it has"));
        };
        let settings = match electrodes {
            ElectrodeSource::Rim(rim) => base.for_nodes(shape, rim, nodes)?,
            ElectrodeSource::Placed(placed) => base.for_nodes_placed(shape, placed, nodes)?,
        };
        let (shape, electrodes) = (shape.clone(), electrodes.clone());
        Ok(Self::Generated { shape, electrodes, settings, base: base.clone() })
    }

    /// Generates a mesh of the family searched for a required accuracy ([`MeshSettings::similar`]).
    ///
    /// # Errors
    ///
    /// A mesh file, or a mesh that cannot be generated.
    pub(crate) fn similar(&self, scale: f64) -> Result<Mesh, SkinError> {
        let Self::Generated { shape, electrodes, base, .. } = self else {
            return Err(SkinError::input("a mesh file is one mesh, not a family"));
        };
        // the search has its own limit
        let node_limit = MeshSettings::default().node_limit;
        let settings = MeshSettings { node_limit, ..base.clone() };
        Ok(match electrodes {
            ElectrodeSource::Rim(rim) => {
                let settings = settings.similar(shape, rim.width_m, scale)?;
                eit_mesh::generate(shape, rim, &settings)?
            }
            ElectrodeSource::Placed(placed) => {
                let widths = placed.iter().map(PlacedElectrode::width_m);
                let narrowest_m = widths.fold(f64::INFINITY, f64::min);
                let settings = settings.similar(shape, narrowest_m, scale)?;
                eit_mesh::generate_placed(shape, placed, &settings)?
            }
        })
    }

    /// Generates or reads the mesh.
    ///
    /// # Errors
    ///
    /// A file that cannot be read; two sets of electrodes; a mesh that cannot be generated.
    pub fn build(&self) -> Result<BuiltMesh, SkinError> {
        let whole = |mesh| BuiltMesh { mesh, notes: Vec::new() };
        let (path, scale_m, electrodes, settings) = match self {
            Self::Generated { shape, electrodes: ElectrodeSource::Rim(rim), settings, .. } => {
                return Ok(whole(eit_mesh::generate(shape, rim, settings)?));
            }
            Self::Generated {
                shape,
                electrodes: ElectrodeSource::Placed(placed),
                settings,
                ..
            } => {
                return Ok(whole(eit_mesh::generate_placed(shape, placed, settings)?));
            }
            Self::File { path, scale_m, electrodes, settings } => {
                (path, *scale_m, electrodes, settings)
            }
        };
        // a file that cannot be read is invalid input, unlike one that cannot be written
        let (mesh, repairs) =
            eit_mesh::read_mesh(path, scale_m).map_err(|e| SkinError::input(e.to_string()))?;
        let key = || format!("{}: a coordinate times skin.scale_m", path.display());
        let coordinates_m = mesh.surface().nodes().iter().flatten();
        check_length(key, coordinates_m.fold(0.0, |most: f64, part| most.max(part.abs())))?;
        let notes = repairs.notes().into_iter().map(|n| format!("{}: {n}", path.display()));
        let notes = notes.collect();
        if electrodes.is_empty() {
            return Ok(BuiltMesh { mesh, notes });
        }
        let own = mesh.electrodes().len();
        if own > 0 {
            return Err(SkinError::input(format!(
                "{} brings {own} electrodes and the scene has electrodes.positions_m: keep one",
                path.display()
            )));
        }
        let mesh = eit_mesh::place_electrodes(mesh.surface(), electrodes, settings)?;
        Ok(BuiltMesh { mesh, notes })
    }
}
