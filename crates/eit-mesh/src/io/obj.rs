//! Reads Wavefront OBJ files: vertices and faces; everything else is ignored.
//!
//! Format: Wavefront, *Advanced Visualizer manual*, appendix B1 (object files). Faces with more
//! than three corners are split into triangles from their first corner. A face that is not convex
//! is rejected, because splitting would flip a triangle.
//!
//! Why not the crate `tobj`: it splits the file into a model for each group and material, each with
//! its own vertices, so a link with two materials falls apart; and its errors give no line
//! (docs/DESIGN.md).

use super::Soup;
use super::lines::{Fields, Lines};
use crate::MeshError;
use eit_core::vector::{dot, normal};

/// Returns the vertices and triangles of a file, in file order.
pub(super) fn triangles(bytes: &[u8], file: &str) -> Result<Soup, MeshError> {
    let mut lines = Lines::new(bytes, file);
    let mut soup = Soup::default();
    while let Some(line) = lines.next_line() {
        let content = line.split('#').next().unwrap_or_default().trim_ascii_end();
        if content.ends_with('\\') {
            return Err(lines.error("lines continued with \\ are not supported: join them"));
        }
        let mut fields = lines.fields(content);
        match content.split_ascii_whitespace().next() {
            Some("v") => {
                fields.next::<String>("v")?;
                // a weight or a colour may follow
                soup.nodes.push(fields.position()?);
            }
            Some("f") => face(content, &mut fields, &mut soup)?,
            _ => {}
        }
    }
    if soup.triangles.is_empty() {
        let (vertices, problem) = (soup.nodes.len(), "no face (a line that begins with f)");
        let problem = format!("{vertices} vertices, but {problem}: a skin consists of faces");
        return Err(MeshError::Parse { file: file.into(), line: 0, problem });
    }
    Ok(soup)
}

/// Reads one face and splits it into triangles.
fn face(line: &str, fields: &mut Fields<'_, '_>, soup: &mut Soup) -> Result<(), MeshError> {
    fields.next::<String>("f")?;
    let corners = line.split_ascii_whitespace().count() - 1;
    if corners < 3 {
        let problem = format!("{corners} corners: a face has at least three");
        return Err(fields.lines.error(problem));
    }
    let mut nodes = Vec::with_capacity(corners);
    for _ in 0..corners {
        let word: String = fields.next("a corner")?;
        nodes.push(node(&word, soup.nodes.len()).map_err(|problem| fields.lines.error(problem))?);
    }
    let fan: Vec<[u32; 3]> =
        nodes[1..].windows(2).map(|side| [nodes[0], side[0], side[1]]).collect();
    let normals: Vec<[f64; 3]> =
        fan.iter().map(|t| normal(t.map(|n| soup.nodes[n as usize]))).collect();
    let whole: [f64; 3] = std::array::from_fn(|k| normals.iter().map(|n| n[k]).sum());
    if corners > 3 && normals.iter().any(|&n| dot(n, whole) <= 0.0) {
        let problem = format!(
            "a face of {corners} corners that is not convex: export the file with triangles"
        );
        return Err(fields.lines.error(problem));
    }
    soup.triangles.extend(fan);
    Ok(())
}

/// Parses the index of a corner such as `7`, `7/1/2` or `-1` (the last vertex read).
fn node(word: &str, count: usize) -> Result<u32, String> {
    let number = word.split('/').next().unwrap_or_default();
    let short = super::lines::short(word);
    let index: i64 = number
        .parse()
        .map_err(|_| format!("expected the number of a vertex, found \"{short}\""))?;
    let found = match index {
        1.. => usize::try_from(index).ok().map(|i| i - 1),
        0 => None,
        _ => usize::try_from(index.unsigned_abs()).ok().and_then(|back| count.checked_sub(back)),
    };
    found.filter(|&i| i < count).and_then(|i| u32::try_from(i).ok()).ok_or_else(|| {
        format!("vertex \"{short}\" does not exist: {count} stand above this line, counted from 1")
    })
}
