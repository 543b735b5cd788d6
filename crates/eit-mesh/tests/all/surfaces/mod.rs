//! Surfaces built by hand, independent of the mesh generator.

use eit_mesh::{Electrode, Mesh, SkinShape, Surface};
use std::f64::consts::TAU;

/// Delaunay refinement stops at 28 degrees; smoothing costs a few of them at worst.
pub(crate) const LEAST_ANGLE_DEG: f64 = 25.0;

pub(crate) fn polygon(outline_m: Vec<[f64; 2]>, holes_m: Vec<Vec<[f64; 2]>>) -> SkinShape {
    SkinShape::Polygon { outline_m, holes_m }
}

pub(crate) fn area_m2(surface: &Surface) -> f64 {
    surface.areas_m2().iter().sum()
}

/// Corners of a rectangle, counter-clockwise from the lower left one.
pub(crate) fn box_m([left, low]: [f64; 2], [right, high]: [f64; 2]) -> Vec<[f64; 2]> {
    vec![[left, low], [right, low], [right, high], [left, high]]
}

/// A disc of concentric rings: ring k has 6 k nodes, and there are `6 rings^2` triangles.
pub(crate) fn disc(rings: u32, radius_m: f64) -> Surface {
    let ring_start = |k: u32| if k == 0 { 0 } else { 1 + 3 * k * (k - 1) };
    let (mut nodes, mut triangles) = (vec![[0.0; 3]], Vec::new());
    for k in 1..=rings {
        let radius = radius_m * f64::from(k) / f64::from(rings);
        for i in 0..6 * k {
            let angle = TAU * f64::from(i) / f64::from(6 * k);
            nodes.push([radius * angle.cos(), radius * angle.sin(), 0.0]);
        }
        let outer = |i: u32| ring_start(k) + i % (6 * k);
        let inner = |i: u32| ring_start(k - 1) + if k == 1 { 0 } else { i % (6 * (k - 1)) };
        for sector in 0..6 {
            for i in 0..k {
                let (o, n) = (sector * k + i, sector * (k - 1) + i);
                triangles.push([inner(n), outer(o), outer(o + 1)]);
                if i + 1 < k {
                    triangles.push([inner(n), outer(o + 1), inner(n + 1)]);
                }
            }
        }
    }
    Surface::new(nodes, triangles).unwrap()
}

/// A rectangle with its lower left corner at the origin, of 2 x columns x rows right triangles.
pub(crate) fn rectangle(columns: u32, rows: u32, width_m: f64, height_m: f64) -> Surface {
    let node = |c: u32, r: u32| r * (columns + 1) + c;
    let (mut nodes, mut triangles) = (Vec::new(), Vec::new());
    for r in 0..=rows {
        for c in 0..=columns {
            let (x, y) = (f64::from(c) / f64::from(columns), f64::from(r) / f64::from(rows));
            nodes.push([width_m * x, height_m * y, 0.0]);
            if r < rows && c < columns {
                let (a, b, d, e) = (node(c, r), node(c + 1, r), node(c, r + 1), node(c + 1, r + 1));
                triangles.push([a, b, e]);
                triangles.push([a, e, d]);
            }
        }
    }
    Surface::new(nodes, triangles).unwrap()
}

pub(crate) fn moved(surface: &Surface, position: impl Fn([f64; 3]) -> [f64; 3]) -> Surface {
    let nodes = surface.nodes().iter().map(|&p| position(p)).collect();
    Surface::new(nodes, surface.triangles().to_vec()).unwrap()
}

/// Electrodes 1 (two edges) and 3 (one reversed edge) on the rim; 2 is a patch of scattered triangles.
pub(crate) fn with_electrodes(surface: Surface) -> Mesh {
    let rim = surface.rim_edges();
    let electrodes = vec![
        Electrode::Rim(vec![rim[1], rim[0]]),
        Electrode::Patch(vec![0, 2, 3]),
        Electrode::Rim(vec![[rim[4][1], rim[4][0]]]),
    ];
    Mesh::new(surface, electrodes).unwrap()
}

/// The upper half of a sphere, its rim at z = 0: a disc of rings in stereographic projection.
pub(crate) fn half_sphere(rings: u32, radius_m: f64) -> Surface {
    moved(&disc(rings, 1.0), |[x, y, _]| {
        let square = x * x + y * y;
        [2.0 * x, 2.0 * y, (1.0 - square).max(0.0)].map(|k| radius_m * k / (1.0 + square))
    })
}

pub(crate) fn binary_stl(surface: &Surface) -> Vec<u8> {
    // many programs begin binary files with the same word as text files
    let mut bytes = b"solid exported".to_vec();
    bytes.resize(80, b' ');
    bytes.extend((surface.triangles().len() as u32).to_le_bytes());
    for t in 0..surface.triangles().len() {
        bytes.extend([0; 12]);
        for x in surface.corners(t).into_iter().flatten() {
            bytes.extend((x as f32).to_le_bytes());
        }
        bytes.extend([0; 2]);
    }
    bytes
}

/// A surface as an ASCII STL file with all digits.
pub(crate) fn text_stl(surface: &Surface) -> String {
    let mut text = String::from("solid skin\n");
    for t in 0..surface.triangles().len() {
        text += "  facet normal 0 0 0\n    outer loop\n";
        for [x, y, z] in surface.corners(t) {
            text += &format!("      vertex {x:e} {y:e} {z:e}\n");
        }
        text += "    endloop\n  endfacet\n";
    }
    text + "endsolid skin\n"
}

/// A surface as an OBJ file with all digits.
pub(crate) fn obj(surface: &Surface) -> String {
    let nodes = surface.nodes().iter().map(|[x, y, z]| format!("v {x:e} {y:e} {z:e}\n"));
    let faces = surface.triangles().iter().map(|t| {
        let [a, b, c] = t.map(|n| n + 1);
        format!("f {a} {b}/1 {c}//2\n")
    });
    nodes.chain(faces).collect()
}
