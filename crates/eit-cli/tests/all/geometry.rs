//! Skins of all geometries through the commands: holes, patches, unequal electrodes, curved surfaces from
//! files, and meshes with faults.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "tests")]

use crate::common::{eit, refuse, succeed, text, write_scene};
use ndarray::Array1;
use serde_json::Value;
use std::path::Path;

/// A tube of radius 0.04 and height 0.1, open at both ends, as an ASCII STL file in millimetres.
fn tube_stl(facets: u32, rings: u32) -> String {
    let corner = |i: u32, j: u32| {
        let angle = std::f64::consts::TAU * f64::from(i % facets) / f64::from(facets);
        let z = 100.0 * f64::from(j) / f64::from(rings);
        format!("vertex {:.6} {:.6} {z:.6}\n", 40.0 * angle.cos(), 40.0 * angle.sin())
    };
    let mut file = String::from("solid tube\n");
    for (i, j) in (0..facets).flat_map(|i| (0..rings).map(move |j| (i, j))) {
        for corners in [[(i, j), (i + 1, j), (i + 1, j + 1)], [(i, j), (i + 1, j + 1), (i, j + 1)]]
        {
            let corners: String = corners.iter().map(|&(i, j)| corner(i, j)).collect();
            file += &format!("facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n");
        }
    }
    file + "endsolid tube\n"
}

/// Eight rim electrodes at the lower end, eight patches half way up.
fn tube_scene(folder: &Path, skin: &str) -> std::path::PathBuf {
    let at = |l: u32, z: f64| {
        let angle = std::f64::consts::TAU * f64::from(l) / 8.0;
        format!("[{:.6}, {:.6}, {z}]", 0.04 * angle.cos(), 0.04 * angle.sin())
    };
    let rim = (0..8).map(|l| at(l, 0.0));
    let positions: Vec<String> = rim.chain((0..8).map(|l| at(l, 0.05))).collect();
    let each = |rim: f64, patch: f64| format!("{:?}", [[rim; 8], [patch; 8]].concat());
    write_scene(
        folder,
        &format!(
            "[skin]\nshape = \"mesh\"\n{skin}\nconductivity_s = 1e-5\n\n[electrodes]\npositions_m = \
             [{}]\nwidth_m = {}\nradius_m = {}\ncontact_impedance_ohm_m = 1.0\n\n[protocol]\ndrive = \
             \"adjacent\"\ncurrent_a = 1e-4\n",
            positions.join(", "),
            each(0.01, 0.0),
            each(0.0, 0.005)
        ),
    )
}

fn json(arguments: &[&str]) -> Value {
    serde_json::from_str(&succeed(&[arguments, &["--json"]].concat())).unwrap()
}

#[test]
fn a_tube_from_an_stl_file_is_meshed_planned_and_solved() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("tube.stl"), tube_stl(48, 20)).unwrap();
    let scene = tube_scene(folder.path(), "file = \"tube.stl\"\nscale_m = 1e-3");
    let path = |name: &str| folder.path().join(name);
    let mut found = Value::Null;
    for name in ["skin.png", "skin.vtu", "skin.msh"] {
        found = json(&["mesh", text(&scene), "--out", text(&path(name))]);
    }
    let measures: Vec<f64> = found["electrode_measures"]
        .as_array()
        .unwrap()
        .iter()
        .map(|m| m.as_f64().unwrap())
        .collect();
    assert_eq!(measures.len(), 16);
    for (l, measure) in measures.iter().enumerate() {
        // an end may snap to a nearby rim node; chords cut a percent off a patch
        let (wanted, within) = if l < 8 { (0.01, 1e-3) } else { (7.854e-5, 0.033) };
        assert!((measure / wanted - 1.0).abs() < within, "{l}: {measure}");
    }
    // 48 facets: the circumference of the polygon, times the height
    let facets = 48.0 * 2.0 * 0.04 * (std::f64::consts::PI / 48.0).sin() * 0.1;
    assert!((found["area_m2"].as_f64().unwrap() / facets - 1.0).abs() < 1e-6);
    assert_eq!(found["mesh_notes"], serde_json::json!([]));
    // the mesh that was written equals the mesh that is solved on
    let (direct, by_file) = (path("direct.npy"), path("by_file.npy"));
    succeed(&["forward", text(&scene), "--out", text(&direct)]);
    let mesh = path("skin.msh");
    succeed(&["forward", text(&scene), "--mesh", text(&mesh), "--out", text(&by_file)]);
    let v: Array1<f64> = ndarray_npy::read_npy(&direct).unwrap();
    let w: Array1<f64> = ndarray_npy::read_npy(&by_file).unwrap();
    assert_eq!((v.len(), &v), (208, &w));
    let plan = json(&["plan", text(&scene)]);
    assert!(plan["stages"].as_array().unwrap().len() >= 4);
    // images are seen from +z, where a tube has no area
    let row = |gain: f64| v.iter().map(|x| format!("{:e}", gain * x)).collect::<Vec<_>>().join(",");
    std::fs::write(path("frames.csv"), format!("{}\n{}\n", row(1.0), row(1.01))).unwrap();
    let frames = path("frames.csv");
    let out = path("images");
    let given = ["--frames", text(&frames), "--reference", "0", "--out", text(&out)];
    let line = refuse(&[&["reconstruct", text(&scene)][..], &given].concat());
    assert!(line.contains("raster") && line.contains("+z"), "{line}");
}

/// The same tube rotated about its axis by one electrode has the same voltages: up to rounding of the file,
/// because the facets lie the same.
#[test]
fn turning_electrodes_by_facets_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("tube.stl"), tube_stl(48, 20)).unwrap();
    let scene = tube_scene(folder.path(), "file = \"tube.stl\"\nscale_m = 1e-3");
    let out = folder.path().join("v.csv");
    succeed(&["forward", text(&scene), "--out", text(&out)]);
    let v: Vec<f64> = std::fs::read_to_string(&out)
        .unwrap()
        .trim()
        .split(',')
        .map(|x| x.parse().unwrap())
        .collect();
    // drive (0, 1) and drive (1, 2): measured pairs follow in the same order, the first pairs are all on the
    // rim; electrode 8 is a patch, so pairs across differ
    let largest = v.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    for k in 0..4 {
        let off = (v[k] - v[13 + k]).abs() / largest;
        assert!(off < 5e-3, "{k}: {off:e}");
    }
}

#[test]
fn built_in_geometries_are_meshed_drawn_and_solved() {
    let folder = tempfile::tempdir().unwrap();
    for (name, electrodes) in [("plate-with-hole", 12), ("patches", 16), ("hemisphere", 16)] {
        let path = |ending: &str| folder.path().join(format!("{name}.{ending}"));
        let found = json(&["mesh", name, "--out", text(&path("png"))]);
        assert_eq!(found["elements_per_electrode"].as_array().unwrap().len(), electrodes);
        assert!(found["smallest_angle_deg"].as_f64().unwrap() > 23.0, "{found}");
        let found = json(&["forward", name, "--out", text(&path("npy"))]);
        assert!(found["solve"]["backward_error"].as_f64().unwrap() < 1e-12, "{found}");
    }
    // the conformal image of paper-disc: the same voltages, each mesh with its own error of 4e-3
    let disc = folder.path().join("disc.npy");
    succeed(&["forward", "paper-disc", "--out", text(&disc)]);
    let read = |path: &Path| -> Array1<f64> { ndarray_npy::read_npy(path).unwrap() };
    let (flat, dome) = (read(&disc), read(&folder.path().join("hemisphere.npy")));
    let largest = flat.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let off = (flat - dome).iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    assert!(off < 1e-2 * largest, "{off:e} of {largest:e}");
    let plan = json(&["plan", "hemisphere"]);
    let error = plan["expected_voltage_error"].as_f64().unwrap();
    assert!((1e-4..2e-2).contains(&error), "{error}");
    // no series: estimated with quadratic elements
    let error = json(&["plan", "patches"])["expected_voltage_error"].as_f64().unwrap();
    assert!((1e-4..2e-2).contains(&error), "{error}");
}

#[test]
fn uneven_widths_on_equal_spacing() {
    let folder = tempfile::tempdir().unwrap();
    let scene = "[skin]\nshape = \"disc\"\nradius_m = 0.1\nconductivity_s = 1e-5\n[electrodes]\n\
                 count = 4\nwidth_m = [0.01, 0.02, 0.03, 0.04]\ncontact_impedance_ohm_m = 1e3\n\
                 [mesh]\nedge_m = 0.01\n";
    let file = write_scene(folder.path(), scene);
    let out = folder.path().join("m.vtu");
    let found = json(&["mesh", text(&file), "--out", text(&out)]);
    for (l, wanted) in [0.01, 0.02, 0.03, 0.04].iter().enumerate() {
        let measure = found["electrode_measures"][l].as_f64().unwrap();
        // chords of the rim
        assert!((measure / wanted - 1.0).abs() < 1e-3, "{l}: {measure}");
    }
    let three = scene.replace("0.03, 0.04]", "0.03]");
    let file = write_scene(folder.path(), &three);
    let line = refuse(&["mesh", text(&file), "--out", text(&out)]);
    assert!(line.contains("width_m has 3 values for 4 electrodes"), "{line}");
}

#[test]
fn mended_meshes_are_used_and_noted_on_stderr_and_in_json() {
    let folder = tempfile::tempdir().unwrap();
    // one facet inverted, one repeated
    let good = tube_stl(24, 8);
    let facet = good.split_inclusive("endfacet\n").next().unwrap().replacen("solid tube\n", "", 1);
    let lines: Vec<&str> = facet.lines().collect();
    let turned =
        [&lines[..2], &[lines[3], lines[2], lines[4]], &lines[5..]].concat().join("\n") + "\n";
    let bad = good.replacen(&facet, &format!("{turned}{facet}"), 1);
    std::fs::write(folder.path().join("tube.stl"), bad).unwrap();
    let scene = tube_scene(folder.path(), "file = \"tube.stl\"\nscale_m = 1e-3");
    let out = folder.path().join("v.npy");
    let output = eit(&["forward", text(&scene), "--out", text(&out), "--json"]);
    assert!(output.status.success());
    let stderr = String::from_utf8(output.stderr).unwrap();
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    let notes: Vec<&str> =
        found["mesh_notes"].as_array().unwrap().iter().map(|n| n.as_str().unwrap()).collect();
    assert_eq!(notes.len(), 2, "{notes:?}");
    assert!(notes[0].contains("1 collapsed or repeated triangles were dropped"), "{notes:?}");
    assert!(notes[1].contains("1 triangles were oriented against the others"), "{notes:?}");
    for note in notes {
        assert!(stderr.contains(&format!("eit: note: {note}")), "{stderr}");
    }
}

#[test]
fn what_a_scene_gets_wrong_about_geometry_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let stl = tube_stl(24, 8);
    std::fs::write(folder.path().join("tube.stl"), &stl).unwrap();
    std::fs::write(folder.path().join("cut.stl"), &stl[..stl.len() / 2]).unwrap();
    let out = folder.path().join("m.vtu");
    let refused = |scene: &Path| refuse(&["mesh", text(scene), "--out", text(&out)]);
    let skin = "file = \"tube.stl\"\nscale_m = 1e-3";
    for (skin, says) in [
        ("file = \"cut.stl\"\nscale_m = 1e-3", "cut.stl: line"),
        ("file = \"tube.stl\"", "scale_m"),
        ("file = \"tube.stl\"\nscale_m = -1.0", "scale_m is -1"),
        ("file = \"tube.ply\"", ".stl or .obj"),
        ("scale_m = 1e-3", "skin.file is missing"),
    ] {
        let line = refused(&tube_scene(folder.path(), skin));
        assert!(line.contains(says), "{skin}: {line}");
    }
    let scene = std::fs::read_to_string(tube_scene(folder.path(), skin)).unwrap();
    for (from, to, says) in [
        ("radius_m = [0.0", "radius_m = [0.01", "electrode 1: width_m 0.01 and radius_m 0.01"),
        ("[0.040000, 0.000000, 0]", "[0.05, 0.0]", "electrode 1 at [0.05, 0.0, 0.0]"),
        ("[0.040000, 0.000000, 0]", "[0.05]", "1 values instead of two or three"),
        ("positions_m", "count = 3\npositions_m", "electrodes.count"),
        ("radius_m = [0.0", "radius_m = [0.0, 0.0", "17 values for 16 electrodes"),
        ("[0.040000, 0.000000, 0.05]", "[0.040000, 0.000000, 0.001]", "electrode 9"),
    ] {
        let broken = scene.replacen(from, to, 1);
        assert_ne!(broken, scene, "{from}");
        let line = refused(&write_scene(folder.path(), &broken));
        assert!(line.contains(says), "{to}: {line}");
        assert!(line.contains("scene.toml: "), "{line}");
    }
    let crossing = "[skin]\nshape = \"polygon\"\noutline = [[0.0, 0.0], [0.1, 0.1], [0.1, 0.0], [0.0, 0.1]]\n\
                    conductivity_s = 1.0\n[electrodes]\ncount = 8\nwidth_m = 0.005\n";
    let line = refused(&write_scene(folder.path(), crossing));
    assert!(line.contains("scene.toml: the outline is invalid at [0.05, 0.05]"), "{line}");
    let bare = "[skin]\nshape = \"disc\"\nradius_m = 0.1\nscale_m = 2.0\nconductivity_s = 1.0\n";
    let line = refused(&write_scene(folder.path(), bare));
    assert!(line.contains("skin.scale_m has no effect without"), "{line}");
}
