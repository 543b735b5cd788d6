//! Reads the sections of an ASCII Gmsh file, version 2.2 or 4.1, without resolving references.
//!
//! Format: Gmsh reference manual, "MSH file format" (4.1) and "MSH file format version 2 (Legacy)".
//! Counts in the file only determine how many lines to expect; nothing is allocated from them, so
//! memory use stays within a small multiple of the file's size.

use super::lines::{Fields, Lines, short};
use crate::MeshError;
use std::collections::HashMap;

/// The line of an error (0: the whole file) and its description.
pub(super) type Problem = (usize, String);

/// A physical group: dimension, tag, name, and the line that names it.
pub(super) struct PhysicalName {
    pub(super) dimension: u8,
    pub(super) tag: u64,
    pub(super) name: String,
    pub(super) line: usize,
}

/// A node: its tag, position (metres) and line.
pub(super) struct Node {
    pub(super) tag: u64,
    pub(super) position_m: [f64; 3],
    pub(super) line: usize,
}

/// Physical tags of an entity of a 4.1 file, without duplicates, and its line.
pub(super) struct Entity {
    pub(super) physical: Vec<u64>,
    pub(super) line: usize,
}

/// Entities by dimension and tag.
pub(super) type Entities = HashMap<(u8, i64), Entity>;

/// A line or triangle: node tags, group (2.2: physical tag; 4.1: entity tag) and line.
pub(super) struct Element<const N: usize> {
    pub(super) nodes: [u64; N],
    pub(super) group: i64,
    pub(super) line: usize,
}

/// Contents of a file, in file order.
#[derive(Default)]
pub(super) struct Sections {
    pub(super) names: Vec<PhysicalName>,
    /// The entities of a 4.1 file; `None` in a 2.2 file.
    pub(super) entities: Option<Entities>,
    pub(super) nodes: Vec<Node>,
    pub(super) edges: Vec<Element<2>>,
    pub(super) triangles: Vec<Element<3>>,
}

/// Reads the sections that describe a mesh, and skips the others.
pub(super) fn read_sections(bytes: &[u8], file: &str) -> Result<Sections, MeshError> {
    let mut lines = Lines::new(bytes, file);
    let mut sections = Sections::default();
    let mut seen: Vec<String> = Vec::new();
    while let Some(line) = lines.next_line() {
        let Some(name) = line.strip_prefix('$') else {
            return Err(lines.error(format!(
                "\"{}\" is outside every section: a Gmsh file starts with $MeshFormat",
                short(&line)
            )));
        };
        // version 2 writes its nodes under this name if they have parameters (Mesh.SaveParametric)
        let kind = if name == "ParametricNodes" { "Nodes" } else { name };
        if KNOWN.contains(&kind) {
            if seen.iter().any(|s| s == kind) {
                return Err(lines.error(format!("section ${kind} appears twice: remove one")));
            }
            if name != "MeshFormat" && seen.first().is_none_or(|s| s != "MeshFormat") {
                return Err(lines.error(format!("section ${name} comes before $MeshFormat")));
            }
            seen.push(kind.to_string());
        }
        let is_4 = sections.entities.is_some();
        match kind {
            "MeshFormat" => sections.entities = mesh_format(&mut lines)?,
            "PhysicalNames" => physical_names(&mut lines, &mut sections)?,
            "Entities" if is_4 => entities(&mut lines, &mut sections)?,
            "Nodes" if is_4 => nodes_4(&mut lines, &mut sections)?,
            "Nodes" => nodes_2(&mut lines, &mut sections, kind != name)?,
            "Elements" if is_4 => elements_4(&mut lines, &mut sections)?,
            "Elements" => elements_2(&mut lines, &mut sections)?,
            "NOD" | "ELM" => return Err(not_read(&lines, 1.0)),
            "PartitionedEntities" => {
                return Err(lines.error(
                    "the mesh is partitioned: save it in one part (Gmsh: Mesh, Unpartition)",
                ));
            }
            other => {
                lines.skip_section(other)?;
                continue;
            }
        }
        lines.end(name)?;
    }
    match KNOWN[..2].iter().chain(["Elements"].iter()).find(|n| !seen.iter().any(|s| s == *n)) {
        Some(missing) => Err(lines.error(format!("the file ends without a section ${missing}"))),
        None => Ok(sections),
    }
}

/// Sections that may appear only once; the first two and `Elements` are required.
const KNOWN: [&str; 5] = ["MeshFormat", "Nodes", "Elements", "PhysicalNames", "Entities"];

/// Parses `version file-type data-size`; returns `None` for 2.2, an empty map of entities for 4.1.
fn mesh_format(lines: &mut Lines<'_>) -> Result<Option<Entities>, MeshError> {
    let line = lines.content("MeshFormat", "its version")?;
    let mut fields = lines.fields(&line);
    let version: f64 = fields.next("the version")?;
    let file_type: u8 = fields.next("the file type (0 ASCII, 1 binary)")?;
    if file_type != 0 {
        return Err(lines.error(
            "the file is binary: save it as ASCII (Gmsh's export dialog offers it, or \
             gmsh IN.msh -save -setnumber Mesh.Binary 0 -o OUT.msh)",
        ));
    }
    if version == 2.2 {
        Ok(None)
    } else if version == 4.1 {
        Ok(Some(HashMap::new()))
    } else {
        Err(not_read(lines, version))
    }
}

fn not_read(lines: &Lines<'_>, version: f64) -> MeshError {
    lines.error(format!(
        "version {version} is not read: save it as 4.1 or 2.2 \
         (gmsh IN.msh -save -format msh41 -o OUT.msh)"
    ))
}

/// A count, then `dimension tag "name"` lines.
fn physical_names(lines: &mut Lines<'_>, sections: &mut Sections) -> Result<(), MeshError> {
    let count: u64 = lines.count("PhysicalNames")?;
    for _ in 0..count {
        let line = lines.content("PhysicalNames", "all its names are there")?;
        let mut fields = lines.fields(&line);
        let dimension = fields.next("the dimension")?;
        let tag: i64 = fields.next("the tag")?;
        let name = fields.rest().trim_matches('"').to_string();
        let tag = tag.unsigned_abs();
        sections.names.push(PhysicalName { dimension, tag, name, line: lines.number });
    }
    Ok(())
}

/// Counts of points, curves, surfaces and volumes, then one line each:
/// `tag box physical-count physical-tags ...` (a point has 3 coordinates for the box's 6).
fn entities(lines: &mut Lines<'_>, sections: &mut Sections) -> Result<(), MeshError> {
    let line = lines.content("Entities", "its counts")?;
    let mut fields = lines.fields(&line);
    let mut counts = [0_u64; 4];
    for count in &mut counts {
        *count = fields.next("a count of entities")?;
    }
    for (dimension, &count) in (0_u8..).zip(&counts) {
        for _ in 0..count {
            let line = lines.content("Entities", "all its entities are there")?;
            let mut fields = lines.fields(&line);
            let tag: i64 = fields.next("the entity's tag")?;
            for _ in 0..if dimension == 0 { 3 } else { 6 } {
                fields.next::<f64>("the entity's box")?;
            }
            let physical_count: u64 = fields.next("the number of physical tags")?;
            let mut physical = Vec::new();
            for _ in 0..physical_count {
                physical.push(fields.next::<i64>("a physical tag")?.unsigned_abs());
            }
            physical.sort_unstable();
            physical.dedup();
            if let Some(entities) = &mut sections.entities {
                entities.insert((dimension, tag), Entity { physical, line: lines.number });
            }
        }
    }
    Ok(())
}

/// A count, then `tag x y z` lines (followed by an entity and parameters if parametric).
fn nodes_2(
    lines: &mut Lines<'_>,
    sections: &mut Sections,
    has_parameters: bool,
) -> Result<(), MeshError> {
    let count = lines.count("Nodes")?;
    for _ in 0..count {
        let line = lines.content("Nodes", "all its nodes are there")?;
        let mut fields = lines.fields(&line);
        let tag = fields.next("the node's tag")?;
        let position_m = fields.position()?;
        if !has_parameters {
            fields.finish()?;
        }
        sections.nodes.push(Node { tag, position_m, line: lines.number });
    }
    Ok(())
}

/// `blocks nodes min-tag max-tag`, then blocks: `dimension entity parametric count`, the tags, the
/// positions (followed by parameters if parametric).
fn nodes_4(lines: &mut Lines<'_>, sections: &mut Sections) -> Result<(), MeshError> {
    let blocks = lines.count("Nodes")?;
    for _ in 0..blocks {
        let line = lines.content("Nodes", "all its blocks are there")?;
        let mut fields = lines.fields(&line);
        fields.next::<i64>("the dimension")?;
        fields.next::<i64>("the entity's tag")?;
        let parametric: i64 = fields.next("the parametric flag")?;
        let count: u64 = fields.next("the number of nodes in the block")?;
        let start = sections.nodes.len();
        for _ in 0..count {
            let line = lines.content("Nodes", "all tags of the block are there")?;
            let mut fields = lines.fields(&line);
            let tag = fields.next("the node's tag")?;
            fields.finish()?;
            sections.nodes.push(Node { tag, position_m: [0.0; 3], line: 0 });
        }
        for node in &mut sections.nodes[start..] {
            let line = lines.content("Nodes", "all positions of the block are there")?;
            let mut fields = lines.fields(&line);
            node.position_m = fields.position()?;
            if parametric == 0 {
                fields.finish()?;
            }
            node.line = lines.number;
        }
    }
    Ok(())
}

/// A count, then `number type tag-count tags ... nodes ...` lines; the first tag is physical.
fn elements_2(lines: &mut Lines<'_>, sections: &mut Sections) -> Result<(), MeshError> {
    let count = lines.count("Elements")?;
    for _ in 0..count {
        let line = lines.content("Elements", "all its elements are there")?;
        let mut fields = lines.fields(&line);
        fields.next::<u64>("the element's number")?;
        let kind = fields.next("the element's type")?;
        let tag_count: u64 = fields.next("the number of tags")?;
        let mut group = 0;
        for tag in 0..tag_count {
            let value: i64 = fields.next("a tag")?;
            if tag == 0 {
                // a negative physical tag means the element is oriented against its entity
                group = value.saturating_abs();
            }
        }
        element(kind, &mut fields, group, sections)?;
    }
    Ok(())
}

/// `blocks elements min-tag max-tag`, then blocks: `dimension entity type count` and
/// `tag nodes ...` lines.
fn elements_4(lines: &mut Lines<'_>, sections: &mut Sections) -> Result<(), MeshError> {
    let blocks = lines.count("Elements")?;
    for _ in 0..blocks {
        let line = lines.content("Elements", "all its blocks are there")?;
        let mut fields = lines.fields(&line);
        fields.next::<i64>("the dimension")?;
        let group = fields.next("the entity's tag")?;
        let kind = fields.next("the element type")?;
        let count: u64 = fields.next("the number of elements in the block")?;
        for _ in 0..count {
            let line = lines.content("Elements", "all elements of the block are there")?;
            let mut fields = lines.fields(&line);
            fields.next::<u64>("the element's tag")?;
            element(kind, &mut fields, group, sections)?;
        }
    }
    Ok(())
}

/// Keeps a line or a triangle, skips a point and rejects all other elements with a hint.
fn element(
    kind: u32,
    fields: &mut Fields<'_, '_>,
    group: i64,
    sections: &mut Sections,
) -> Result<(), MeshError> {
    let line = fields.lines.number;
    match kind {
        1 => sections.edges.push(Element { nodes: fields.tags()?, group, line }),
        2 => sections.triangles.push(Element { nodes: fields.tags()?, group, line }),
        15 => return Ok(()),
        8 | 9 | 20..=28 => {
            return Err(fields.lines.error(format!(
                "element type {kind} is of second or higher order: mesh with order 1 \
                 (gmsh -order 1)"
            )));
        }
        3 | 10 | 16 => {
            return Err(fields.lines.error(
                "a quadrangle: turn recombination off (Mesh.RecombineAll = 0, no Recombine \
                 Surface), because a skin consists of triangles",
            ));
        }
        _ => {
            return Err(fields.lines.error(format!(
                "element type {kind} is not a point, line or triangle: save the surface alone \
                 (mesh with gmsh -2)"
            )));
        }
    }
    fields.finish()
}
