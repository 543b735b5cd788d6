//! Reads a mesh from a file; the extension determines the format.

use super::gmsh_read::mended_gmsh;
use super::{Soup, obj, stl};
use crate::repair::size_m;
use crate::{Mesh, MeshError, Repairs, Surface};
use std::path::Path;

/// Corners in an STL or OBJ file closer than this fraction of the surface's longest side are one
/// node. Both formats usually hold seven digits, and programs may round the corners of neighbouring
/// triangles differently.
const MERGE: f64 = 1e-6;

/// Reads a skin from a Gmsh (`.msh`), STL (`.stl`) or OBJ (`.obj`) file, repairing harmless faults,
/// and returns it with a record of the repairs.
///
/// Lengths in the file are multiplied by `scale_m`: 1 for metres, 1e-3 for millimetres. A Gmsh file
/// may contain electrodes (see [`parse_gmsh`](crate::parse_gmsh)); the other formats have none, and
/// [`place_electrodes`](crate::place_electrodes) adds them by position.
///
/// # Errors
/// [`MeshError::Io`] if the file cannot be read or is not a regular file, [`MeshError::OutOfRange`]
/// for a scale not between 1e-9 and 1e9, [`MeshError::Parse`] for any error in the file.
pub fn read_mesh(path: impl AsRef<Path>, scale_m: f64) -> Result<(Mesh, Repairs), MeshError> {
    let path = path.as_ref();
    let name = path.display().to_string();
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    let known = ["msh", "stl", "obj"];
    let Some(ending) = ending.filter(|e| known.contains(&e.as_str())) else {
        let problem = "a skin is read from a .msh (Gmsh), .stl or .obj file".to_owned();
        return Err(MeshError::Parse { file: name, line: 0, problem });
    };
    let bytes = read_file(path)?;
    let bare = |(surface, repairs)| Ok((Mesh::new(surface, Vec::new())?, repairs));
    match ending.as_str() {
        "stl" => parse_stl(&bytes, &name, scale_m).and_then(bare),
        "obj" => parse_obj(&bytes, &name, scale_m).and_then(bare),
        _ => mended_gmsh(&bytes, &name, checked(scale_m)?),
    }
}

/// Parses a surface from the bytes of a binary or ASCII STL file; lengths are multiplied by
/// `scale_m`.
///
/// In the file each triangle has its own corners: those within 1e-6 of the surface's longest side
/// of each other are merged into one node. Collapsed and duplicate triangles are dropped; normals
/// are ignored.
///
/// `file` is the file name used in error messages.
///
/// # Errors
/// As [`read_mesh`]; triangles are counted from 0 in the file's order.
pub fn parse_stl(bytes: &[u8], file: &str, scale_m: f64) -> Result<(Surface, Repairs), MeshError> {
    let scale_m = checked(scale_m)?;
    let (surface, mut repairs) = surface(stl::triangles(bytes, file)?, file, scale_m)?;
    repairs.unshared = true;
    Ok((surface, repairs))
}

/// Parses a surface from the bytes of a Wavefront OBJ file; lengths are multiplied by `scale_m`.
///
/// Faces with more than three corners are split into triangles. Vertices within 1e-6 of the
/// surface's longest side of each other are merged into one node. Normals, textures, materials,
/// groups, lines and points are ignored. OBJ does not record its length: a file cut off between two
/// lines reads as a smaller surface.
///
/// `file` is the file name used in error messages.
///
/// # Errors
/// As [`read_mesh`]; vertices and triangles are counted from 0 in the file's order.
pub fn parse_obj(bytes: &[u8], file: &str, scale_m: f64) -> Result<(Surface, Repairs), MeshError> {
    let scale_m = checked(scale_m)?;
    surface(obj::triangles(bytes, file)?, file, scale_m)
}

fn checked(scale_m: f64) -> Result<f64, MeshError> {
    let must = "between 1e-9 and 1e9 (metres per unit of the file)";
    let is_valid = (1e-9..=1e9).contains(&scale_m);
    MeshError::check_range(is_valid, "scale_m", scale_m, must).map(|()| scale_m)
}

fn surface(mut soup: Soup, file: &str, scale_m: f64) -> Result<(Surface, Repairs), MeshError> {
    soup.nodes.iter_mut().flatten().for_each(|x| *x *= scale_m);
    let merge_m = MERGE * size_m(&soup.nodes);
    Surface::repaired(soup.nodes, soup.triangles, merge_m).map_err(|error| {
        let problem = error.to_string();
        MeshError::Parse { file: file.into(), line: 0, problem }
    })
}

/// Reads all bytes of a file; rejects devices and pipes, which may have no end.
pub(super) fn read_file(path: &Path) -> Result<Vec<u8>, MeshError> {
    let failed = |reason: String| MeshError::Io { path: path.display().to_string(), reason };
    let data = std::fs::metadata(path).map_err(|error| failed(error.to_string()))?;
    if !data.is_file() {
        return Err(failed("is not a regular file".to_owned()));
    }
    std::fs::read(path).map_err(|error| failed(error.to_string()))
}
