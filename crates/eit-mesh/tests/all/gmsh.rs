//! Gmsh files: files written by Gmsh and by this crate, and files that must be rejected.

use crate::surfaces;
use eit_mesh::{
    Electrode, ElementField, GmshVersion, Mesh, MeshError, parse_gmsh, read_gmsh, write_gmsh,
};
use proptest::prelude::*;
use std::collections::HashMap;
use std::path::Path;

const VERSIONS: [GmshVersion; 2] = [GmshVersion::V2_2, GmshVersion::V4_1];

fn written(mesh: &Mesh, version: GmshVersion, fields: &[ElementField<'_>]) -> String {
    let mut bytes = Vec::new();
    write_gmsh(mesh, &mut bytes, version, fields).unwrap();
    String::from_utf8(bytes).unwrap()
}

fn assert_round_trip(mesh: &Mesh, version: GmshVersion) {
    let again = parse_gmsh(written(mesh, version, &[]).as_bytes(), "again").unwrap();
    assert_eq!(&again, mesh, "{version:?}");
    // `==` on floats equates -0 and 0
    let bits = |mesh: &Mesh| mesh.surface().nodes().iter().map(|p| p.map(f64::to_bits)).collect();
    let [found, wanted]: [Vec<_>; 2] = [bits(&again), bits(mesh)];
    assert_eq!(found, wanted, "{version:?}");
}

/// A 0.2 m x 0.1 m plate, written by Gmsh 4.15.2. electrode_1 consists of two curves (the left side),
/// electrode_2 is the middle 0.04 m of the right side, electrode_3 is a 0.04 m square that is also in
/// the group "everything", and there is an isolated point.
fn plate(version: &str) -> Mesh {
    let name = format!("tests/files/plate_{version}.msh");
    read_gmsh(Path::new(env!("CARGO_MANIFEST_DIR")).join(name)).unwrap()
}

#[test]
fn reads_what_gmsh_writes() {
    for version in ["22", "41"] {
        let mesh = plate(version);
        let surface = mesh.surface();
        // 98 triangles, 14 of which the 2.2 file repeats; 61 nodes, one of them the isolated point
        // (which Gmsh does not save) and one at each corner
        assert_eq!(surface.triangles().len(), 98);
        let area_m2: f64 = surface.areas_m2().iter().sum();
        // 98 areas of about 2e-4 with rounding 1e-16 each
        assert!((area_m2 - 0.02).abs() < 1e-15, "{area_m2}");
        let measures: Vec<f64> = (0..3).map(|e| mesh.electrode_measure(e).unwrap()).collect();
        for (measure, wanted) in measures.iter().zip([0.1, 0.04, 0.0016]) {
            // the file has 16 digits
            assert!((measure - wanted).abs() < 1e-15, "{measures:?}");
        }
        assert!(matches!(mesh.electrodes()[0], Electrode::Rim(ref e) if e.len() == 4));
        assert!(matches!(mesh.electrodes()[2], Electrode::Patch(ref t) if t.len() == 14));
    }
    assert_eq!(plate("22"), plate("41"));
}

#[test]
fn reads_the_extreme_problem() {
    let Some(folder) = fixtures::peers_problem("extreme") else { return };
    let mesh = read_gmsh(folder.join("mesh.msh")).unwrap();
    let surface = mesh.surface();
    assert_eq!((surface.nodes().len(), surface.triangles().len()), (257, 448));
    assert_eq!(mesh.electrodes().len(), 16);
    // first node of the file, digit by digit
    assert_eq!(surface.nodes()[0], [0.006911683841295721, 0.016432362870023167, 0.0]);
    assert_round_trip(&mesh, VERSIONS[0]);
    assert_round_trip(&read_gmsh(folder.join("mesh_sliver.msh")).unwrap(), VERSIONS[1]);
}

#[test]
fn round_trip_is_exact() {
    let bare = Mesh::new(surfaces::disc(2, 0.1), vec![]).unwrap();
    let square = surfaces::rectangle(1, 1, 1.0, 1.0);
    let all_patch = Mesh::new(square, vec![Electrode::Patch(vec![0, 1])]).unwrap();
    for mesh in [bare, all_patch, surfaces::with_electrodes(surfaces::disc(4, 0.1)), plate("41")] {
        for version in VERSIONS {
            assert_round_trip(&mesh, version);
        }
    }
}

/// Node tags of each element of a file of ours, by the element's tag.
fn elements(text: &str, version: GmshVersion) -> HashMap<u32, Vec<u32>> {
    let elements = text.split("$Elements\n").nth(1).unwrap().split("$End").next().unwrap();
    let lines = elements.lines().skip(1);
    let mut lines = lines.map(|l| l.split(' ').map(|w| w.parse().unwrap()).collect::<Vec<u32>>());
    let mut found = HashMap::new();
    while let Some(line) = lines.next() {
        match version {
            GmshVersion::V2_2 => _ = found.insert(line[0], line[5..].to_vec()),
            // the head of a block ends with its length
            GmshVersion::V4_1 => found.extend(
                lines.by_ref().take(line[3] as usize).map(|line| (line[0], line[1..].to_vec())),
            ),
        }
    }
    found
}

#[test]
fn element_data_follows_the_elements() {
    let mesh = surfaces::with_electrodes(surfaces::disc(2, 0.1));
    let triangles = mesh.surface().triangles();
    let values: Vec<f64> = (0..24).map(|t| 1e-5 * f64::from(t) / 3.0).collect();
    let fields = [ElementField { name: "conductivity_s", values: &values }];
    for version in VERSIONS {
        let text = written(&mesh, version, &fields);
        let data = text.split("$ElementData\n").nth(1).unwrap();
        let rows: Vec<&str> = data.lines().skip(8).take_while(|l| !l.starts_with('$')).collect();
        // three rim edges and 24 triangles
        assert_eq!((rows.len(), data.lines().nth(7)), (27, Some("27")));
        let elements = elements(&text, version);
        for row in rows {
            let (tag, value) = row.split_once(' ').unwrap();
            let nodes = &elements[&tag.parse().unwrap()];
            let owner = triangles.iter().position(|t| nodes.iter().all(|n| t.contains(&(n - 1))));
            assert_eq!(value.parse::<f64>().unwrap(), values[owner.unwrap()]);
        }
        assert_eq!(parse_gmsh(text.as_bytes(), "with data").unwrap(), mesh);
    }
}

#[test]
fn writers_refuse_what_does_not_fit() {
    let mesh = surfaces::with_electrodes(surfaces::disc(2, 0.1));
    let write = |name, values| {
        write_gmsh(&mesh, &mut Vec::new(), VERSIONS[1], &[ElementField { name, values }])
    };
    assert_eq!(
        write("a", &[0.0; 23]),
        Err(MeshError::WrongLength { what: "values per triangle", found: 23, wanted: 24 })
    );
    assert!(matches!(write("a \"b\"", &[0.0; 24]), Err(MeshError::BadFieldName { .. })));
    let full = write_gmsh(&mesh, &mut [0; 9].as_mut_slice(), VERSIONS[1], &[]);
    assert!(matches!(full, Err(MeshError::Io { .. })), "{full:?}");
}

/// A plate of two triangles with sparse tags, an unused node, a point, a negative physical tag,
/// Windows line endings, blank lines and sections to skip.
const SMALL_22: &str = include_str!("../files/small_22.msh");

/// The same in 4.1: parametric nodes, electrode_1 in two entities, non-adjacent blocks of one entity.
const SMALL_41: &str = include_str!("../files/small_41.msh");

#[test]
fn reads_sparse_tags_and_split_groups() {
    assert!(SMALL_22.starts_with("$MeshFormat\r\n"), "the file has lost its Windows line ends");
    let square = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    for (text, edges) in [(SMALL_22, vec![[0, 1]]), (SMALL_41, vec![[0, 1], [1, 2]])] {
        let mesh = parse_gmsh(text.as_bytes(), "small").unwrap();
        assert_eq!(mesh.surface().nodes(), square);
        assert_eq!(mesh.surface().triangles(), [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(mesh.electrodes(), [Electrode::Rim(edges)]);
    }
}

/// With `Mesh.SaveParametric`, version 2 writes an entity and parameters behind each position.
#[test]
fn reads_parametric_nodes_of_version_2() {
    let text = SMALL_22
        .replace("$Nodes", "$ParametricNodes")
        .replace("$EndNodes", "$EndParametricNodes")
        .replace("900 0 0 0", "900 0 0 0 0 2")
        .replace("77 1 1 0", "77 1 1 0 1 3 0.5");
    let mesh = |text: &str| parse_gmsh(text.as_bytes(), "small").unwrap();
    assert_eq!(mesh(&text), mesh(SMALL_22));
    let twice = "$Nodes\n0\n$EndNodes\n$Comments";
    refused(&text, "$Comments", twice, 16, "section $Nodes appears twice");
}

/// Gmsh saves no triangle if curves are physical and the surface is not, or if nothing was meshed.
#[test]
fn a_file_without_triangles_names_the_cause() {
    let triangles = "3 2 2 9 1 900 20 77\n4 2 3 9 1 1 900 77 4000000000000\n";
    let bare = SMALL_22.replacen("$Elements\n4", "$Elements\n2", 1);
    refused(&bare, triangles, "", 0, "add a Physical Surface that contains the skin");
    let error = parse_gmsh(bare.replace(triangles, "").as_bytes(), "bare.msh").unwrap_err();
    assert!(error.to_string().starts_with("bare.msh: the file has physical groups"), "{error}");
    let bare = bare.replacen("1 15 2 0 1 900\n2 1 2 -7", "1 15 2 0 1 900\n2 1 2 0", 1);
    refused(&bare, triangles, "", 0, "no triangle: mesh the surface before saving");
    let blocks = &SMALL_41[SMALL_41.find("2 1 2 1\n3").unwrap()..];
    let lines = "1 5 1 1\n4 20 77\n$EndElements\n";
    let bare = SMALL_41.replacen("5 6 1 6", "3 6 1 6", 1);
    refused(&bare, blocks, lines, 0, "add a Physical Surface that contains the skin");
    refused(SMALL_22, "$MeshFormat", "$NOD", 1, "version 1 is not read: save it as 4.1 or 2.2");
}

/// Asserts that a modified file is rejected at a line with the given words.
fn refused(base: &str, from: &str, to: &str, line: usize, words: &str) {
    assert!(base.contains(from), "{from} is not in the file");
    match parse_gmsh(base.replacen(from, to, 1).as_bytes(), "bad.msh") {
        Err(MeshError::Parse { file, line: found, problem }) => {
            assert_eq!(file, "bad.msh");
            assert!(problem.contains(words), "{from:?} -> {to:?}: {problem}");
            assert!(!problem.contains('\n'), "{problem}");
            assert_eq!(found, line, "{from:?} -> {to:?}: {problem}");
        }
        other => panic!("{from:?} -> {to:?}: {other:?}"),
    }
}

#[test]
fn refuses_files_at_their_line() {
    let bad_22 = |from: &str, to: &str, line, words: &str| refused(SMALL_22, from, to, line, words);
    bad_22("2.2 0 8", "2.2 1 8", 2, "binary: save it as ASCII");
    bad_22("2.2 0", "1 0", 2, "version 1 is not read: save it as 4.1 or 2.2");
    bad_22("2.2 0", "4 0", 2, "version 4 is not read");
    bad_22("$MeshFormat", "MeshFormat", 1, "outside every section");
    bad_22("$EndMeshFormat", "$Nodes", 3, "$EndMeshFormat is missing here");
    bad_22("\"electrode_1\"", "\"electrode_2\"", 0, "electrode_1 is missing, but electrode_2");
    bad_22("\"electrode_1\"", "\"electrode_0\"", 9, "name it electrode_N, N from 1");
    bad_22("\"electrode_1\"", "\"Electrode 1\"", 9, "name it electrode_N");
    bad_22("\"electrode_1\"", "\"electrode_01\"", 9, "without leading zeros");
    bad_22("1 7 \"el", "0 7 \"el", 9, "an electrode has a width");
    bad_22("2 9 \"skin\"", "2 9 \"electrode_1\"", 10, "a physical curve and a physical surface");
    bad_22("2 9 \"skin\"", "1 7 \"electrode_2\"", 10, "group 7 is named electrode_1 and _2");
    bad_22("2 9 \"skin\"", "1 9 \"electrode_2\"", 10, "electrode_2 is named but has no line");
    bad_22("900 0 0 0", "900 0 nan 0", 15, "not finite");
    bad_22("900 0 0 0", "900 0 0", 15, "the line ends before a coordinate");
    bad_22("900 0 0 0", "-1 0 0 0", 15, "expected the node's tag, found \"-1\"");
    bad_22("3 5 5 5", "900 5 5 5", 17, "node 900 again, first on line 15");
    bad_22("$Nodes\n5", "$Nodes\n6", 20, "section $Nodes ends before all its nodes");
    bad_22("$Nodes\n5", "$Nodes\n4", 19, "$EndNodes is missing here");
    bad_22("$Nodes\n5", "$Nodes\n99999999999999999999", 14, "expected a count");
    bad_22("$Nodes\n5", "$Nodes\n18446744073709551615", 20, "section $Nodes ends");
    bad_22("3 2 2 9 1", "3 3 2 9 1", 25, "a quadrangle: turn recombination off");
    bad_22("3 2 2 9 1", "3 9 2 9 1", 25, "of second or higher order: mesh with order 1");
    bad_22("3 2 2 9 1", "3 4 2 9 1", 25, "save the surface alone");
    bad_22("900 20 77", "900 20 21", 25, "node 21 is not in $Nodes");
    bad_22("900 20 77", "900 20 77 1", 25, "one word too many");
    bad_22("900 20 77", "900 20 900", 25, "zero to rounding");
    bad_22("-7 1 900 20", "-7 1 900 77", 24, "not on the rim");
    bad_22("-7 1 900 20", "-7 1 900 3", 24, "node 3 of an electrode belongs to no triangle");
    bad_22("1 15 2 0 1 900", "1 1 2 7 1 900 20", 9, "electrodes 1 and 1 overlap");
    bad_22("$Comments", "$Nodes\n0\n$EndNodes\n$Comments", 16, "section $Nodes appears twice");
    bad_22("$EndElements", "$EndElement", 27, "$EndElements is missing");
    bad_22("$EndComments", "", 27, "section $Comments of line 4 has no $EndComments");
    let elements = &SMALL_22[SMALL_22.find("$Elements").unwrap()..];
    bad_22(elements, "", 20, "the file ends without a section $Elements");

    let bad = |from: &str, to: &str, line, words: &str| refused(SMALL_41, from, to, line, words);
    bad("1 0 0 2 8 -7 2", "1 0 0 2 8 x 2", 11, "expected a physical tag, found \"x\"");
    bad("0 0 2 8 -7 2", "0 0 99999999999 8 -7 2", 11, "the line ends before a physical tag");
    bad("$EndEntities", "$PartitionedEntities", 15, "$EndEntities is missing");
    bad("$Entities", "$PartitionedEntities", 8, "the mesh is partitioned");
    bad("1 4 1 2\n", "1 4 1 99999999999999\n", 21, "\"0\" is one word too many");
    bad("2 1 0 3\n", "2 1 0 4\n", 27, "one word too many");
    bad("5 6 1 6", "6 6 1 6", 43, "section $Elements ends before all its blocks");
    bad("1 4 1 1\n", "1 4 8 1\n", 36, "order 1");
}

#[test]
fn a_cut_file_is_never_read() {
    for text in [SMALL_22, SMALL_41] {
        // the last byte is the line end behind $EndElements
        for length in 0..text.trim_end().len() {
            let cut = text.as_bytes().get(..length).unwrap();
            assert!(parse_gmsh(cut, "cut").is_err(), "{length} bytes");
        }
    }
}

#[test]
fn repeated_parts_do_not_multiply() {
    // every electrode name on one tag, which an entity repeats: rejected at the second name
    let names: String = (1..2000).map(|n| format!("1 7 \"electrode_{n}\"\n")).collect();
    let text = SMALL_41
        .replace("1\n1 7 \"electrode_1\"\n", &format!("1999\n{names}"))
        .replace("0 0 2 8 -7 2 1 -2", &format!("0 0 5000 {}", "7 ".repeat(5000)));
    let error = parse_gmsh(text.as_bytes(), "many").unwrap_err().to_string();
    assert!(error.contains("group 7 is named electrode_1 and _2"), "{error}");
}

proptest! {
    #![proptest_config(fixtures::cases(256))]

    // a mesh of any size and orientation in space is restored bit for bit
    #[test]
    fn round_trip_of_any_coordinates(
        // squared areas must neither vanish nor overflow
        exponent in -60_i32..60,
        axes in prop::array::uniform2(prop::array::uniform3(-1.0_f64..1.0)),
        shift in prop::array::uniform3(-1.0_f64..1.0),
        version in prop::sample::select(VERSIONS.to_vec()),
    ) {
        let [a, b] = axes;
        // the disc keeps a nonzero area
        prop_assume!((0..3).any(|i| {
            let j = (i + 1) % 3;
            (a[i] * b[j] - a[j] * b[i]).abs() > 0.01
        }));
        let scale = 10.0_f64.powi(exponent);
        let surface = surfaces::moved(&surfaces::disc(3, 1.0), |p| {
            std::array::from_fn(|k| scale * (a[k] * p[0] + b[k] * p[1] + shift[k]))
        });
        assert_round_trip(&surfaces::with_electrodes(surface), version);
    }

    #[test]
    fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        prop_assert!(parse_gmsh(&bytes, "any").is_err());
    }

    // a valid file with some bytes changed and a piece cut out: no panic, errors name the file
    #[test]
    fn damaged_files_are_read_or_refused(
        version_4 in any::<bool>(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        cut in any::<(prop::sample::Index, prop::sample::Index)>(),
        from_alphabet in any::<bool>(),
    ) {
        let mut bytes = if version_4 { SMALL_41 } else { SMALL_22 }.as_bytes().to_vec();
        for (place, value) in changes {
            let place = place.index(bytes.len());
            // characters that keep numbers valid reach deeper into the parser than random bytes
            let alphabet = b"0123456789-. \n$e";
            let number = alphabet[value as usize % alphabet.len()];
            bytes[place] = if from_alphabet { number } else { value };
        }
        let (a, b) = (cut.0.index(bytes.len()), cut.1.index(bytes.len()));
        if a < b && b - a < 40 {
            bytes.drain(a..b);
        }
        match parse_gmsh(&bytes, "damaged") {
            Ok(mesh) => prop_assert!(!mesh.surface().triangles().is_empty()),
            Err(MeshError::Parse { file, .. }) => prop_assert_eq!(file, "damaged"),
            Err(other) => prop_assert!(false, "{:?}", other),
        }
    }
}
