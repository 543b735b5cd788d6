//! Reads STL files, binary and ASCII, in which each triangle has its own three corners.
//!
//! Format: 3D Systems, *StereoLithography Interface Specification* (1989). A binary file has a
//! header of 80 bytes, the number of triangles (`u32`), and 50 bytes per triangle: normal and three
//! corners (twelve `f32`) and two bytes for free use, all little-endian. An ASCII file contains
//! keywords and numbers. Normals are ignored: they add nothing to the order of the corners, and
//! files with wrong normals are common.
//!
//! Why not the crate `stl_io`: it rounds the numbers of ASCII files to `f32`, and its errors give
//! neither line nor triangle (docs/DESIGN.md).

use super::Soup;
use super::lines::{Lines, short};
use crate::MeshError;

/// Bytes before the first triangle: a header of 80, and the number of triangles.
const START: usize = 84;
/// Bytes per triangle.
const RECORD: usize = 50;

/// Returns the triangles of a file with unmerged corners.
pub(super) fn triangles(bytes: &[u8], file: &str) -> Result<Soup, MeshError> {
    if is_text(bytes) { text(bytes, file) } else { binary(bytes, file) }
}

/// Returns the number of triangles that a binary file declares, and the file length they imply.
fn declared(bytes: &[u8]) -> Option<(u64, u64)> {
    let count = bytes.get(START - 4..START)?.first_chunk::<4>()?;
    let count = u64::from(u32::from_le_bytes(*count));
    Some((count, START as u64 + RECORD as u64 * count))
}

/// Binary files often begin with "solid" too, so a matching length takes precedence.
fn is_text(bytes: &[u8]) -> bool {
    if declared(bytes).is_some_and(|(_, length)| length == bytes.len() as u64) {
        return false;
    }
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).trim_ascii_start();
    let solid = text.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    // however a file begins, an early zero byte shows that it is not text
    solid && !bytes.iter().take(1024).any(|&b| b == 0)
}

fn binary(bytes: &[u8], file: &str) -> Result<Soup, MeshError> {
    let error = |problem| MeshError::Parse { file: file.into(), line: 0, problem };
    let found = bytes.len();
    let Some((count, length)) = declared(bytes) else {
        return Err(error(format!(
            "{found} bytes are no STL file: a binary file has {START} bytes before its first \
             triangle, an ASCII file begins with \"solid\""
        )));
    };
    if length != found as u64 {
        let whole = found.saturating_sub(START) / RECORD;
        return Err(error(format!(
            "the header declares {count} triangles ({length} bytes), but the file has {found} \
             bytes ({whole} triangles): is it cut off?"
        )));
    }
    let mut soup = Soup::default();
    for (triangle, record) in bytes[START..].chunks_exact(RECORD).enumerate() {
        let mut numbers = record
            .chunks_exact(4)
            .map(|n| n.first_chunk::<4>().map_or(f64::NAN, |n| f64::from(f32::from_le_bytes(*n))));
        let corners: [[f64; 3]; 4] =
            std::array::from_fn(|_| std::array::from_fn(|_| numbers.next().unwrap_or(f64::NAN)));
        // the first three numbers are the normal
        for (k, &corner) in corners[1..].iter().enumerate() {
            if corner.iter().any(|x| !x.is_finite()) {
                return Err(error(format!(
                    "corner {k} of triangle {triangle} (from byte {}) is {corner:?}: every \
                     coordinate must be finite",
                    START + RECORD * triangle
                )));
            }
        }
        soup.push([corners[1], corners[2], corners[3]]);
    }
    Ok(soup)
}

fn text(bytes: &[u8], file: &str) -> Result<Soup, MeshError> {
    let mut lines = Lines::new(bytes, file);
    let mut soup = Soup::default();
    let mut facet: Option<Vec<[f64; 3]>> = None;
    let mut ended = false;
    while let Some(line) = lines.next_line() {
        let mut fields = lines.fields(&line);
        let word: String = fields.next("a word")?;
        match (word.to_ascii_lowercase().as_str(), &mut facet) {
            ("facet", None) => facet = Some(Vec::with_capacity(3)),
            ("vertex", Some(corners)) => {
                corners.push(fields.position()?);
                fields.finish()?;
            }
            ("endfacet", Some(corners)) => {
                let Ok(three) = <[[f64; 3]; 3]>::try_from(corners.as_slice()) else {
                    let found = corners.len();
                    return Err(lines.error(format!("{found} corners where a facet has three")));
                };
                soup.push(three);
                facet = None;
            }
            ("outer" | "endloop", Some(_)) => {}
            ("solid", None) => ended = false,
            ("endsolid", None) => ended = true,
            (_, inside) => {
                let wanted = match inside {
                    Some(_) => "\"outer loop\", \"vertex\", \"endloop\" or \"endfacet\"",
                    None => "\"facet\" or \"endsolid\"",
                };
                let word = short(&word);
                return Err(lines.error(format!("expected {wanted}, found \"{word}\"")));
            }
        }
    }
    if facet.is_some() || !ended {
        return Err(lines.error("the file ends before endsolid: is it cut off?"));
    }
    Ok(soup)
}
