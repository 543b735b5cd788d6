//! Converts meshes and rasters to drawing data.

use crate::{ElectrodeDrawing, Extent, SkinDrawing, View};
use eit_mesh::{Electrode, Mesh, Raster, Surface};
use std::collections::HashMap;

impl SkinDrawing {
    /// Creates the drawing of a mesh seen from +z, for images on this raster, whose extent it
    /// takes.
    pub fn from_raster(mesh: &Mesh, raster: &Raster) -> Self {
        let [x_min_m, x_max_m, y_min_m, y_max_m] = raster.extent_m();
        skin_with_extent(mesh, &View::TOP, Extent { x_min_m, x_max_m, y_min_m, y_max_m })
    }

    /// Creates the drawing of a mesh in a view; its extent is the bounding box.
    pub fn from_mesh(mesh: &Mesh, view: &View) -> Self {
        let mut extent = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
        for &node in mesh.surface().nodes() {
            let [x, y] = view.flat(node);
            extent = [extent[0].min(x), extent[1].max(x), extent[2].min(y), extent[3].max(y)];
        }
        let [x_min_m, x_max_m, y_min_m, y_max_m] = extent;
        skin_with_extent(mesh, view, Extent { x_min_m, x_max_m, y_min_m, y_max_m })
    }
}

fn skin_with_extent(mesh: &Mesh, view: &View, extent: Extent) -> SkinDrawing {
    let surface = mesh.surface();
    let flat = |node: u32| view.flat(surface.nodes()[node as usize]);
    let electrodes = mesh.electrodes().iter().enumerate().map(|(l, electrode)| {
        let edges = match electrode {
            Electrode::Rim(edges) => edges.clone(),
            Electrode::Patch(triangles) => patch_rim(surface, triangles),
        };
        let rim_m = chains(&edges).into_iter().next().unwrap_or_default();
        let rim_m = rim_m.iter().map(|&n| flat(n)).collect();
        ElectrodeDrawing { number: l + 1, rim_m, drawn: true }
    });
    let outlines_m = chains(surface.rim_edges())
        .iter()
        .map(|chain| chain.iter().map(|&n| flat(n)).collect())
        .collect();
    SkinDrawing { outlines_m, electrodes: electrodes.collect(), extent }
}

/// Outer edges of a set of triangles: those that belong to only one of them.
fn patch_rim(surface: &Surface, triangles: &[u32]) -> Vec<[u32; 2]> {
    let mut edges: HashMap<[u32; 2], ([u32; 2], usize)> = HashMap::new();
    for &t in triangles {
        let corners = surface.triangles()[t as usize];
        for k in 0..3 {
            let edge = [corners[k], corners[(k + 1) % 3]];
            let key = [edge[0].min(edge[1]), edge[0].max(edge[1])];
            edges.entry(key).or_insert((edge, 0)).1 += 1;
        }
    }
    let mut rim: Vec<[u32; 2]> =
        edges.into_values().filter(|(_, count)| *count == 1).map(|(edge, _)| edge).collect();
    rim.sort_unstable();
    rim
}

/// Joins directed edges into chains of nodes, longest first; a closed chain repeats its first node.
fn chains(edges: &[[u32; 2]]) -> Vec<Vec<u32>> {
    let mut next: HashMap<u32, u32> = edges.iter().map(|e| (e[0], e[1])).collect();
    let ends: std::collections::HashSet<u32> = edges.iter().map(|e| e[1]).collect();
    // open chains start at nodes where no edge ends
    let mut starts: Vec<u32> = edges.iter().map(|e| e[0]).filter(|n| !ends.contains(n)).collect();
    starts.extend(edges.iter().map(|e| e[0]));
    let mut found = Vec::new();
    for start in starts {
        let mut chain = vec![start];
        while let Some(node) = chain.last().and_then(|last| next.remove(last)) {
            chain.push(node);
        }
        if chain.len() > 1 {
            found.push(chain);
        }
    }
    found.sort_by_key(|chain| std::cmp::Reverse(chain.len()));
    found
}
