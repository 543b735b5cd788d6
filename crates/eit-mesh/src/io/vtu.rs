//! Writes a mesh to a VTU file (VTK's XML format for unstructured grids), for ParaView and similar
//! programs.
//!
//! Format: VTK file formats, "UnstructuredGrid". Arrays are inline base64 of little-endian values
//! preceded by their length in bytes (`header_type="UInt64"`), so every value, including NaN, is
//! restored bit for bit; VTK's text arrays cannot hold NaN.

use super::{ElementField, check_fields, io_error, patch_numbers, rim_edges, rim_triangles};
use crate::{Mesh, MeshError};
use std::io::{self, Write};

/// Writes nodes, triangles and electrodes as a VTU file.
///
/// Cells are the triangles in mesh order, then the edges of the rim electrodes as lines, electrode
/// by electrode. The cell array `electrode` holds the 1-based electrode number of a line or patch
/// triangle, 0 on bare skin. Each field becomes a cell array; a line takes the value of its
/// triangle. Coordinates are metres and are restored bit for bit.
///
/// `out` receives many small writes: pass a [`BufWriter`](std::io::BufWriter) and flush it.
///
/// # Errors
/// [`MeshError::WrongLength`] for a field that does not match the mesh, [`MeshError::BadFieldName`]
/// for a name that is not valid in XML or is "electrode", [`MeshError::Io`].
pub fn write_vtu(
    mesh: &Mesh,
    out: &mut impl Write,
    fields: &[ElementField<'_>],
) -> Result<(), MeshError> {
    check_fields(mesh, fields)?;
    let bad = |f: &&ElementField<'_>| f.name == "electrode" || f.name.contains(char::is_control);
    if let Some(field) = fields.iter().find(bad) {
        return Err(MeshError::BadFieldName { name: field.name.into() });
    }
    write(mesh, out, fields).map_err(|error| io_error(&error))
}

fn write(mesh: &Mesh, out: &mut impl Write, fields: &[ElementField<'_>]) -> io::Result<()> {
    let surface = mesh.surface();
    let triangles = surface.triangles();
    let edges: Vec<(usize, [u32; 2])> = rim_edges(mesh).collect();
    let numbers = patch_numbers(mesh).into_iter().chain(edges.iter().map(|edge| edge.0));
    let cells = triangles.len() + edges.len();
    let node = |&n: &u32| i64::from(n).to_le_bytes();
    let ends = (1..=triangles.len()).map(|t| 3 * t);
    let ends = ends.chain((1..=edges.len()).map(|e| 3 * triangles.len() + 2 * e));
    // VTK's numbers for triangles and lines
    let kinds = (0..cells).map(|c| if c < triangles.len() { 5_u8 } else { 3 });

    writeln!(
        out,
        "<?xml version=\"1.0\"?>\n\
         <VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" \
         header_type=\"UInt64\">\n<UnstructuredGrid>\n\
         <Piece NumberOfPoints=\"{}\" NumberOfCells=\"{cells}\">\n<Points>",
        surface.nodes().len()
    )?;
    let points = surface.nodes().iter().flatten().map(|x| x.to_le_bytes());
    array(out, "type=\"Float64\" Name=\"Points\" NumberOfComponents=\"3\"", points)?;
    writeln!(out, "</Points>\n<Cells>")?;
    let connectivity =
        triangles.iter().flatten().chain(edges.iter().flat_map(|edge| &edge.1)).map(node);
    array(out, "type=\"Int64\" Name=\"connectivity\"", connectivity)?;
    array(out, "type=\"Int64\" Name=\"offsets\"", ends.map(|end| (end as i64).to_le_bytes()))?;
    array(out, "type=\"UInt8\" Name=\"types\"", kinds.map(u8::to_le_bytes))?;
    writeln!(out, "</Cells>\n<CellData>")?;
    let numbers = numbers.map(|number| (number as i64).to_le_bytes());
    array(out, "type=\"Int64\" Name=\"electrode\"", numbers)?;
    let on_edges = rim_triangles(mesh);
    for field in fields {
        let values = field.values.iter().chain(on_edges.iter().map(|&t| &field.values[t]));
        let values = values.map(|x| x.to_le_bytes());
        array(out, &format!("type=\"Float64\" Name=\"{}\"", escape(field.name)), values)?;
    }
    writeln!(out, "</CellData>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>")
}

/// Writes one data array: its length in bytes and its values, together in base64.
fn array<const N: usize>(
    out: &mut impl Write,
    attributes: &str,
    values: impl Iterator<Item = [u8; N]>,
) -> io::Result<()> {
    let mut bytes = vec![0; 8];
    values.for_each(|value| bytes.extend(value));
    let length = (bytes.len() - 8) as u64;
    bytes[..8].copy_from_slice(&length.to_le_bytes());
    writeln!(out, "<DataArray {attributes} format=\"binary\">\n{}\n</DataArray>", base64(&bytes))
}

/// Base64 with padding (RFC 4648, section 4).
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let byte = |k: usize| u32::from(group.get(k).copied().unwrap_or(0));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for k in 0..4 {
            let digit = DIGITS[(bits >> (18 - 6 * k)) as usize & 63];
            text.push(if k <= group.len() { char::from(digit) } else { '=' });
        }
    }
    text
}

/// Escapes text for an XML attribute.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
