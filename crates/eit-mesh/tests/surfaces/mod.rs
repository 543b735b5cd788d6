//! Surfaces made by hand, independent of the mesh generator.
#![allow(dead_code)]
// each test file uses some of them

use eit_mesh::{Electrode, Mesh, Surface};
use std::f64::consts::TAU;

/// A disc of concentric rings around the origin: ring k has 6 k nodes, `6 rings^2` triangles.
pub fn disc(rings: u32, radius_m: f64) -> Surface {
    let ring_start = |k: u32| if k == 0 { 0 } else { 1 + 3 * k * (k - 1) };
    let mut nodes = vec![[0.0; 3]];
    let mut triangles = Vec::new();
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
pub fn rectangle(columns: u32, rows: u32, width_m: f64, height_m: f64) -> Surface {
    let node = |c: u32, r: u32| r * (columns + 1) + c;
    let mut nodes = Vec::new();
    let mut triangles = Vec::new();
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

/// The same triangles with every node moved.
pub fn moved(surface: &Surface, position: impl Fn([f64; 3]) -> [f64; 3]) -> Surface {
    let nodes = surface.nodes().iter().map(|&p| position(p)).collect();
    Surface::new(nodes, surface.triangles().to_vec()).unwrap()
}

/// Electrodes 1 and 3 on the rim (each every fourth edge pair), electrode 2 a patch of triangles
/// that are not neighbours in the list.
pub fn with_electrodes(surface: Surface) -> Mesh {
    let rim = surface.rim_edges();
    let electrodes = vec![
        Electrode::Rim(vec![rim[1], rim[0]]),
        Electrode::Patch(vec![0, 2, 3]),
        Electrode::Rim(vec![[rim[4][1], rim[4][0]]]),
    ];
    Mesh::new(surface, electrodes).unwrap()
}
