//! STL and OBJ files, and repairs of meshes from files.

use crate::surfaces::{binary_stl, half_sphere, obj, rectangle, text_stl};
use eit_mesh::{
    Electrode, GmshVersion, Mesh, MeshError, Repairs, Surface, parse_gmsh, parse_obj, parse_stl,
    read_mesh, write_gmsh,
};
use proptest::prelude::*;

/// Line and description of the error in a file.
fn refused(result: Result<(Surface, Repairs), MeshError>) -> (usize, String) {
    match result.unwrap_err() {
        MeshError::Parse { file, line, problem } => {
            assert_eq!(file, "link");
            (line, problem)
        }
        other => panic!("{other}"),
    }
}

/// Checks that the corners agree triangle by triangle, to `within`.
fn assert_same_shape(found: &Surface, wanted: &Surface, within: f64) {
    let sizes = |s: &Surface| [s.nodes().len(), s.triangles().len(), s.rim_edges().len()];
    assert_eq!(sizes(found), sizes(wanted));
    for t in 0..wanted.triangles().len() {
        let (p, q) = (found.corners(t), wanted.corners(t));
        let off = p.iter().flatten().zip(q.iter().flatten()).map(|(a, b)| (a - b).abs());
        assert!(off.into_iter().all(|off| off <= within), "triangle {t}: {p:?} {q:?}");
    }
}

#[test]
fn every_format_gives_the_surface_that_was_written() {
    let surface = half_sphere(3, 40.0);
    let (text, repairs) = parse_stl(text_stl(&surface).as_bytes(), "link", 1.0).unwrap();
    assert_same_shape(&text, &surface, 0.0);
    // each of the 54 triangles has its own three corners
    assert_eq!(repairs.merged_nodes, 3 * 54 - surface.nodes().len());
    assert_eq!(repairs.notes(), Vec::<String>::new(), "nothing to report of a clean file");
    // f32 rounds at 6e-8 of the coordinate
    let (binary, _) = parse_stl(&binary_stl(&surface), "link", 1.0).unwrap();
    assert_same_shape(&binary, &surface, 40.0 * 6e-8);
    let (read, repairs) = parse_obj(obj(&surface).as_bytes(), "link", 1.0).unwrap();
    assert_same_shape(&read, &surface, 0.0);
    assert_eq!(read.nodes(), surface.nodes(), "an OBJ file keeps the order of its vertices");
    assert_eq!((repairs.merged_nodes, repairs.notes().len()), (0, 0));
}

#[test]
fn lengths_are_scaled_and_files_are_known_by_their_ending() {
    let surface = half_sphere(1, 40.0);
    let folder = tempfile::tempdir().unwrap();
    let bare = Mesh::new(surface.clone(), vec![]).unwrap();
    let mut msh = Vec::new();
    write_gmsh(&bare, &mut msh, GmshVersion::V4_1, &[]).unwrap();
    let files = [
        ("a.stl", text_stl(&surface).into_bytes()),
        ("a.OBJ", obj(&surface).into_bytes()),
        ("a.msh", msh),
    ];
    for (name, bytes) in files {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let (mesh, _) = read_mesh(&path, 1e-3).unwrap();
        let top = mesh.surface().bounds_m()[1][2];
        assert!((top - 0.04).abs() < 1e-17, "{name}: {top}");
        let error = read_mesh(&path, f64::NAN).unwrap_err();
        assert!(matches!(error, MeshError::OutOfRange { quantity: "scale_m", .. }), "{error}");
    }
    let error = read_mesh(folder.path().join("a.ply"), 1.0).unwrap_err().to_string();
    assert!(error.contains(".stl") && error.contains("a.ply"), "{error}");
    for name in ["b.stl", "b.msh"] {
        let path = folder.path().join(name);
        let error = read_mesh(&path, 1.0).unwrap_err();
        assert!(matches!(&error, MeshError::Io { path: named, .. } if path == *named), "{error:?}");
    }
}

#[test]
fn truncated_stl_files_are_named() {
    let surface = half_sphere(1, 1.0);
    let binary = binary_stl(&surface);
    for length in 0..binary.len() {
        let (_, problem) = refused(parse_stl(&binary[..length], "link", 1.0));
        // a header alone that begins with "solid" reads as text
        let said = ["cut off", "no STL file", "expected"];
        assert!(said.iter().any(|s| problem.contains(s)), "{length} bytes: {problem}");
        if length >= 84 {
            assert!(problem.contains("declares 6 triangles"), "{length} bytes: {problem}");
        }
    }
    let text = text_stl(&surface);
    for length in 5..text.find("endsolid").unwrap() + 8 {
        let (line, problem) = refused(parse_stl(&text.as_bytes()[..length], "link", 1.0));
        assert!(line > 0, "{length} bytes: {problem}");
    }
    let (line, problem) = refused(parse_stl(&text.as_bytes()[..300], "link", 1.0));
    assert_eq!(line, text[..300].lines().count());
    assert!(problem.contains("cut off") || problem.contains("ends before"), "{problem}");
}

#[test]
fn faults_in_stl_files_have_a_place() {
    let surface = half_sphere(1, 1.0);
    let text = text_stl(&surface);
    for (from, to, wanted, says) in [
        ("vertex", "vertxe", 4, "vertxe"),
        ("endloop", "vertex 1 2 3\n    endloop", 9, "4 corners"),
        ("vertex 1e0", "vertex NaN", 5, "not finite"),
    ] {
        assert!(text.contains(from), "{from}");
        let broken = text.replacen(from, to, 1);
        let (line, problem) = refused(parse_stl(broken.as_bytes(), "link", 1.0));
        assert_eq!((line, problem.contains(says)), (wanted, true), "{problem}");
    }
    let mut binary = binary_stl(&surface);
    // the third corner of triangle 2
    binary[84 + 2 * 50 + 36..][..4].copy_from_slice(&f32::INFINITY.to_le_bytes());
    let (_, problem) = refused(parse_stl(&binary, "link", 1.0));
    assert!(problem.contains("corner 2 of triangle 2 (from byte 184)"), "{problem}");
}

#[test]
fn obj_faces_of_any_size_and_negative_numbers() {
    let file = "# a roof\no link\nv 0 0 0\nv 1 0 0 1.0\nv 1 1 0.5 0.2 0.2 0.2\nv 0 1 0.5\n\
                vn 0 0 1\nusemtl grey\nf 1/1/1 2//1 3 4\ng top\nv 1 2 0\nv 0 2 0\nf -4 -2 -1 -3\n";
    let (surface, _) = parse_obj(file.as_bytes(), "link", 1.0).unwrap();
    assert_eq!(surface.triangles(), [[0, 1, 2], [0, 2, 3], [2, 4, 5], [2, 5, 3]]);
    let refused = |text: &str| refused(parse_obj(text.as_bytes(), "link", 1.0));
    let start = "v 0 0 0\nv 2 0 0\nv 1 0.1 0\nv 1 2 0\n";
    for (face, says) in [
        ("f 1 2", "2 corners"),
        ("f 1 2 9", "\"9\" does not exist: 4 stand above"),
        ("f 1 2 0", "\"0\" does not exist"),
        ("f 1 2 -5", "\"-5\" does not exist"),
        ("f 1 2 x", "number of a vertex"),
        ("f 1 2 3 \\", "continued"),
        // corner 3 is dented
        ("f 1 3 2 4", "not convex"),
    ] {
        let (line, problem) = refused(&format!("{start}{face}\n"));
        assert_eq!((line, problem.contains(says)), (5, true), "{face}: {problem}");
    }
    assert!(refused(start).1.contains("4 vertices, but no face"));
    assert_eq!(refused("v 0 0\n").0, 1);
}

/// Two triangles that form a square, with whatever faults a test adds.
fn square() -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let nodes = vec![[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]];
    (nodes, vec![[0, 1, 2], [0, 2, 3]])
}

#[test]
fn harmless_faults_are_mended_and_noted() {
    let (mut nodes, mut triangles) = square();
    nodes.push([5.0, 5.0, 0.0]); // unused
    nodes.push([1.0 + 1e-8, 0.0, 0.0]); // duplicate of node 1
    nodes.push([2.0, 0.5, 0.0]);
    triangles.push([5, 2, 6]); // reversed, uses the duplicate
    triangles.push([1, 5, 2]); // collapsed
    triangles.push([3, 0, 2]); // duplicate of triangle 1
    let (surface, repairs) = Surface::repaired(nodes, triangles, 1e-6).unwrap();
    assert_eq!((surface.nodes().len(), surface.triangles().len()), (5, 3));
    assert_eq!((repairs.merged_nodes, repairs.dropped_nodes), (1, 1));
    assert_eq!((repairs.dropped_triangles, repairs.turned_triangles, repairs.slivers), (2, 1, 0));
    let notes = repairs.notes();
    assert_eq!(notes.len(), 4, "{notes:?}");
    assert_eq!(repairs.to_string(), notes.join("\n"));
    let flat: f64 = surface.areas_m2().iter().sum();
    assert!((flat - 1.5).abs() < 1e-15);
    // a surface that faces down is as valid as one that faces up
    let (nodes, triangles) = square();
    let down = triangles.iter().map(|t| [t[0], t[2], t[1]]).collect();
    let (_, repairs) = Surface::repaired(nodes, down, 0.0).unwrap();
    assert_eq!(repairs.notes(), Vec::<String>::new());
}

#[test]
fn slivers_are_kept_and_noted() {
    let nodes = vec![[0., 0., 0.], [1., 0., 0.], [0.5, 1e-3, 0.], [0.5, 1.0, 0.]];
    let triangles = vec![[0, 1, 2], [0, 2, 3], [2, 1, 3]];
    let (surface, repairs) = Surface::repaired(nodes, triangles, 1e-9).unwrap();
    assert_eq!((surface.triangles().len(), repairs.slivers), (3, 1));
    let worst = repairs.worst.unwrap();
    // 4 sqrt(3) 0.5e-3 / 1.5
    assert_eq!(worst.0, 0);
    assert!((worst.2 - 2.0 * 3f64.sqrt() * 1e-3 / 1.5).abs() < 1e-8, "{worst:?}");
    assert!(repairs.notes()[0].contains("triangle 0"), "{repairs}");
}

/// The index is that in the file, not that after repair.
#[test]
fn faults_that_change_the_skin_are_refused_with_index_and_place() {
    let (mut nodes, mut triangles) = square();
    nodes.insert(0, [9.0, 9.0, 0.0]); // unused: shifts every index
    triangles.iter_mut().flatten().for_each(|n| *n += 1);
    triangles.insert(0, [1, 1, 2]); // collapsed: shifts the triangles
    let with = |node: [f64; 3], triangle: [u32; 3]| {
        let (mut nodes, mut triangles) = (nodes.clone(), triangles.clone());
        nodes.push(node);
        triangles.push(triangle);
        Surface::repaired(nodes, triangles, 1e-9).unwrap_err()
    };
    // a third triangle on the diagonal, nodes 1 and 3 of the file
    let error = with([0.0, 0.0, 1.0], [1, 3, 5]);
    let MeshError::NonManifoldEdge { edge, triangles: 3, position_m } = error else {
        panic!("{error}")
    };
    assert_eq!((edge, position_m), ([1, 3], [0.5, 0.5, 0.0]));
    // flat, but with three nodes
    let error = with([2.0, 0.0, 0.0], [1, 2, 5]);
    let MeshError::ZeroArea { triangle: 3, nodes: [1, 2, 5], position_m, .. } = error else {
        panic!("{error}")
    };
    assert_eq!(position_m, [1.0, 0.0, 0.0]);
    let error = Surface::repaired(nodes.clone(), vec![[1, 2, 7]], 1e-9).unwrap_err();
    assert_eq!(error, MeshError::UnknownNode { triangle: 0, node: 7, nodes: 5 });
}

/// Two plates of a Gmsh file whose common side was meshed twice.
fn two_plates(apart_m: f64) -> String {
    let right = 1.0 + apart_m;
    format!(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n\
         $PhysicalNames\n1\n1 1 \"electrode_1\"\n$EndPhysicalNames\n\
         $Nodes\n10\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n5 {right} 0 0\n6 2 0 0\n7 2 1 0\n\
         8 {right} 1 0\n9 1 2 0\n10 7 7 0\n$EndNodes\n\
         $Elements\n6\n1 1 2 1 1 6 7\n2 2 2 9 1 1 2 3\n3 2 2 9 1 1 3 4\n4 2 2 9 2 5 6 7\n\
         5 2 2 9 2 5 7 8\n6 2 2 9 1 4 3 9\n$EndElements\n"
    )
}

fn read_msh(content: impl AsRef<[u8]>) -> (Mesh, Repairs) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("skin.msh");
    std::fs::write(&path, content).unwrap();
    read_mesh(&path, 1.0).unwrap()
}

#[test]
fn gmsh_parts_with_common_places_are_joined() {
    let (mesh, repairs) = read_msh(two_plates(0.0));
    assert_eq!((mesh.surface().nodes().len(), mesh.surface().triangles().len()), (7, 5));
    assert_eq!((repairs.merged_nodes, repairs.dropped_nodes), (2, 1));
    assert_eq!(repairs.notes().len(), 2, "{repairs}");
    // the electrode is on the right side of the second plate
    assert_eq!(mesh.electrode_measure(0), Some(1.0));
    assert_eq!(mesh.electrode_centre_m(0), Some([2.0, 0.5, 0.0]));
    // apart, they are two skins
    let error = parse_gmsh(two_plates(1e-6).as_bytes(), "two.msh").unwrap_err();
    assert!(error.to_string().contains("2 parts"), "{error}");
}

#[test]
fn a_cut_in_a_gmsh_mesh_stays_and_is_noted() {
    // four triangles around a centre, cut from there to the corner [1, 1], which exists twice
    let nodes =
        vec![[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.], [0.5, 0.5, 0.], [1., 1., 0.]];
    let surface = Surface::new(nodes, vec![[0, 1, 4], [1, 2, 4], [5, 3, 4], [3, 0, 4]]).unwrap();
    let mesh = Mesh::new(surface, vec![Electrode::Rim(vec![[0, 1]])]).unwrap();
    let mut bytes = Vec::new();
    write_gmsh(&mesh, &mut bytes, GmshVersion::V2_2, &[]).unwrap();
    let (read, repairs) = read_msh(bytes);
    assert_eq!((read, repairs.coincident_nodes), (mesh, 1));
    assert!(repairs.notes()[0].contains("cut"), "{repairs}");
}

/// An electrode without edges, and one on an inner edge, as if a hole had been filled.
#[test]
fn electrodes_that_cover_nothing_are_refused_with_their_line() {
    let text = two_plates(0.0);
    let refused = |electrode| {
        let text = text.replace("1 1 2 1 1 6 7", electrode);
        parse_gmsh(text.as_bytes(), "f.msh").unwrap_err().to_string()
    };
    let error = refused("1 1 2 5 1 6 7");
    assert!(error.contains("line 6") && error.contains("electrode_1"), "{error}");
    let error = refused("1 1 2 1 1 1 3");
    // the middle of the diagonal
    assert!(error.contains("not on the rim") && error.contains("[0.5, 0.5, 0.0]"), "{error}");
    assert!(error.contains("line 23"), "{error}");
}

proptest! {
    #![proptest_config(fixtures::cases(256))]

    #[test]
    fn readers_never_panic_on_damaged_files(
        noise in prop::collection::vec(any::<u8>(), 0..400),
        at in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        keep in any::<prop::sample::Index>(),
    ) {
        let surface = half_sphere(2, 1.0);
        let files =
            [binary_stl(&surface), text_stl(&surface).into_bytes(), obj(&surface).into_bytes()];
        let damaged = files.map(|mut bytes| {
            for (index, value) in &at {
                let index = index.index(bytes.len());
                bytes[index] = *value;
            }
            bytes.truncate(1 + keep.index(2 * bytes.len()));
            bytes
        });
        let solid = [b"solid ".as_slice(), &noise].concat();
        for bytes in damaged.into_iter().chain([noise, solid]) {
            let _ = parse_stl(&bytes, "link", 1.0);
            let _ = parse_obj(&bytes, "link", 1.0);
        }
    }

    /// A rectangle of triangles with separate corners, jittered within the tolerance, is restored.
    #[test]
    fn jittered_corners_are_merged(
        columns in 1..6u32, rows in 1..6u32,
        jitter in prop::collection::vec(-1.0..1.0f64, 600),
    ) {
        let surface = rectangle(columns, rows, 1.0, 1.0);
        let mut jitter = jitter.into_iter().cycle();
        let mut nodes = Vec::new();
        let mut triangles = Vec::new();
        for t in 0..surface.triangles().len() {
            let first = nodes.len() as u32;
            triangles.push([first, first + 1, first + 2]);
            nodes.extend(surface.corners(t).map(|p| p.map(|x| x + 2e-7 * jitter.next().unwrap())));
        }
        let count = nodes.len();
        // at most 2 sqrt(3) 2e-7 = 7e-7 apart
        let (merged, repairs) = Surface::repaired(nodes, triangles, 1e-6).unwrap();
        prop_assert_eq!(merged.nodes().len(), surface.nodes().len());
        prop_assert_eq!(merged.triangles().len(), surface.triangles().len());
        prop_assert_eq!(repairs.merged_nodes, count - surface.nodes().len());
    }
}
