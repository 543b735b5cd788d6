//! Mesh files that a scene names: no input panics or allocates without limit, and triangles refer
//! to nodes that exist.
#![no_main]

use eit_mesh::{parse_gmsh, parse_obj, parse_stl};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Some((&first, data)) = data.split_first() else { return };
    let surface = match first % 3 {
        0 => parse_stl(data, "fuzz", 1.0),
        1 => parse_obj(data, "fuzz", 1.0),
        _ => {
            if let Ok(mesh) = parse_gmsh(data, "fuzz") {
                let (nodes, triangles) = (mesh.surface().nodes(), mesh.surface().triangles());
                assert!(triangles.iter().flatten().all(|&node| (node as usize) < nodes.len()));
            }
            return;
        }
    };
    if let Ok((surface, _)) = surface {
        let nodes = surface.nodes().len();
        assert!(surface.triangles().iter().flatten().all(|&node| (node as usize) < nodes));
    }
});
