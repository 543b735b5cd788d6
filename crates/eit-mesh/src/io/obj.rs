//! Wavefront OBJ files: vertices and faces; everything else is passed over.
//!
//! Format: Wavefront, *Advanced Visualizer manual*, appendix B1 (object files). Faces with more
//! than three corners are cut into triangles from their first corner, and refused where that would
//! turn a triangle over (the face is not convex).
//!
//! Why not the crate `tobj`: it cuts the file into a model for each group and material, each
//! with vertices of its own, so that a link of two materials falls apart; and its errors name
//! no line (docs/DESIGN.md).

use super::Soup;
use super::lines::{Fields, Lines};
use crate::MeshError;
use crate::surface::{cross, dot, sub};

/// Vertices and triangles of a file, in its order.
pub(super) fn triangles(bytes: &[u8], file: &str) -> Result<Soup, MeshError> {
    let mut lines = Lines::new(bytes, file);
    let mut soup = Soup::default();
    while let Some(line) = lines.next_line() {
        let content = line.split('#').next().unwrap_or_default().trim_ascii_end();
        if content.ends_with('\\') {
            return Err(lines.error("lines continued by \\ are not read: join them"));
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
        let problem = format!("{vertices} vertices, but {problem}: a skin is made of faces");
        return Err(MeshError::Parse { file: file.into(), line: 0, problem });
    }
    Ok(soup)
}

/// Reads one face and cuts it into triangles.
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
    let normals: Vec<[f64; 3]> = fan
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|n| soup.nodes[n as usize]);
            cross(sub(b, a), sub(c, a))
        })
        .collect();
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

/// Index of a corner such as `7`, `7/1/2` or `-1` (the vertex read last).
fn node(word: &str, count: usize) -> Result<u32, String> {
    let number = word.split('/').next().unwrap_or_default();
    let short = super::lines::short(word);
    let index: i64 = number
        .parse()
        .map_err(|_| format!("\"{short}\" is where the number of a vertex is expected"))?;
    let found = match index {
        1.. => usize::try_from(index).ok().map(|i| i - 1),
        0 => None,
        _ => usize::try_from(index.unsigned_abs()).ok().and_then(|back| count.checked_sub(back)),
    };
    found.filter(|&i| i < count).and_then(|i| u32::try_from(i).ok()).ok_or_else(|| {
        format!("vertex \"{short}\" does not exist: {count} stand above this line, from 1")
    })
}
