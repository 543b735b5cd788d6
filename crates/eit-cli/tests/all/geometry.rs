//! Skins of all geometries through the commands.

use crate::common::{
    Folder, answer, eit, largest, number, parse, read_array, read_text, refuse, refuse_each, says,
    stderr, stdout, succeed,
};
use ndarray::Array1;
use serde_json::Value;

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

/// The scene of a tube: eight rim electrodes at the lower end, eight patches half way up.
fn tube_scene(folder: &Folder, skin: &str) -> String {
    let at = |l: u32, z: f64| {
        let angle = std::f64::consts::TAU * f64::from(l) / 8.0;
        format!("[{:.6}, {:.6}, {z}]", 0.04 * angle.cos(), 0.04 * angle.sin())
    };
    let rim = (0..8).map(|l| at(l, 0.0));
    let positions: Vec<String> = rim.chain((0..8).map(|l| at(l, 0.05))).collect();
    let each = |rim: f64, patch: f64| format!("{:?}", [[rim; 8], [patch; 8]].concat());
    let (positions, widths, radii) = (positions.join(", "), each(0.01, 0.0), each(0.0, 0.005));
    let content = format!(
        "[skin]\nshape = \"mesh\"\n{skin}\nconductivity_s = 1e-5\n\n[electrodes]\npositions_m = \
         [{positions}]\nwidth_m = {widths}\nradius_m = {radii}\ncontact_impedance_ohm_m = 1.0\n\n\
         [protocol]\ndrive = \"adjacent\"\ncurrent_a = 1e-4\n"
    );
    folder.write("scene.toml", content)
}

const TUBE: &str = "file = \"tube.stl\"\nscale_m = 1e-3";

/// A folder with the file of a tube and its scene.
fn tube(stl: String) -> (Folder, String) {
    let folder = Folder::new();
    folder.write("tube.stl", stl);
    let scene = tube_scene(&folder, TUBE);
    (folder, scene)
}

#[test]
fn a_tube_from_an_stl_file_is_meshed_planned_and_solved() {
    let (folder, scene) = tube(tube_stl(48, 20));
    let path = |name: &str| folder.path(name);
    let mut found = Value::Null;
    for name in ["skin.png", "skin.vtu", "skin.msh"] {
        found = answer(format!("mesh {scene} --out {}", path(name)));
    }
    let measures = found["electrode_measures"].as_array().unwrap().iter();
    let measures: Vec<f64> = measures.map(|m| m.as_f64().unwrap()).collect();
    assert_eq!(measures.len(), 16);
    for (l, measure) in measures.iter().enumerate() {
        // an end may snap to a nearby rim node; chords cut a percent off a patch
        let (wanted, within) = if l < 8 { (0.01, 1e-3) } else { (7.854e-5, 0.033) };
        assert!((measure / wanted - 1.0).abs() < within, "{l}: {measure}");
    }
    // 48 facets: the circumference of the polygon, times the height
    let facets = 48.0 * 2.0 * 0.04 * (std::f64::consts::PI / 48.0).sin() * 0.1;
    assert!((number(&found, "area_m2") / facets - 1.0).abs() < 1e-6);
    assert_eq!(found["mesh_notes"], serde_json::json!([]));
    // the mesh that was written equals the mesh that is solved on
    let [v, w] = ["", &format!("--mesh {}", path("skin.msh"))].map(|mesh| -> Array1<f64> {
        succeed(format!("forward {scene} {mesh} --out {}", path("v.npy")));
        read_array(path("v.npy"))
    });
    assert_eq!((v.len(), &v), (208, &w));
    // rotated about its axis by one electrode the tube is the same, up to rounding of the file, because the facets lie
    // the same: drives (0, 1) and (1, 2) measure the same on the rim, where the first pairs are
    for k in 0..4 {
        let off = (v[k] - v[13 + k]).abs() / largest(&v);
        assert!(off < 5e-3, "{k}: {off:e}");
    }
    let plan = answer(format!("plan {scene}"));
    assert!(plan["stages"].as_array().unwrap().len() >= 4);
    // images are seen from +z, where a tube has no area
    let row = |gain: f64| v.iter().map(|x| format!("{:e}", gain * x)).collect::<Vec<_>>().join(",");
    let frames = folder.write("frames.csv", format!("{}\n{}\n", row(1.0), row(1.01)));
    let given = format!("--frames {frames} --reference 0 --out {}", path("images"));
    says(&refuse(format!("reconstruct {scene} {given}")), "raster…+z");
}

#[test]
fn built_in_geometries_are_meshed_drawn_and_solved() {
    let folder = Folder::new();
    for (name, electrodes) in [("plate-with-hole", 12), ("patches", 16), ("hemisphere", 16)] {
        let path = |ending: &str| folder.path(&format!("{name}.{ending}"));
        let found = answer(format!("mesh {name} --out {}", path("png")));
        assert_eq!(found["elements_per_electrode"].as_array().unwrap().len(), electrodes);
        assert!(number(&found, "smallest_angle_deg") > 23.0, "{found}");
        let found = answer(format!("forward {name} --out {}", path("npy")));
        assert!(number(&found["solve"], "backward_error") < 1e-12, "{found}");
    }
    // the conformal image of paper-disc: the same voltages, each mesh with its own error of 4e-3
    let disc = folder.path("disc.npy");
    succeed(format!("forward paper-disc --out {disc}"));
    let (flat, dome): (Array1<f64>, Array1<f64>) =
        (read_array(&disc), read_array(folder.path("hemisphere.npy")));
    let (off, size) = (largest(&(&flat - &dome)), largest(&flat));
    assert!(off < 1e-2 * size, "{off:e} of {size:e}");
    // patches have no series: estimated with quadratic elements
    for name in ["hemisphere", "patches"] {
        let plan = answer(format!("plan {name}"));
        let error = number(&plan, "expected_voltage_error");
        assert!((1e-4..2e-2).contains(&error), "{error}");
    }
}

#[test]
fn mended_meshes_are_used_and_noted_on_stderr_and_in_json() {
    // one facet inverted, one repeated
    let good = tube_stl(24, 8);
    let facet = good.split_inclusive("endfacet\n").next().unwrap().replacen("solid tube\n", "", 1);
    let lines: Vec<&str> = facet.lines().collect();
    let turned =
        [&lines[..2], &[lines[3], lines[2], lines[4]], &lines[5..]].concat().join("\n") + "\n";
    let bad = good.replacen(&facet, &format!("{turned}{facet}"), 1);
    let (folder, scene) = tube(bad);
    let out = folder.path("v.npy");
    let output = eit(format!("forward {scene} --out {out} --json"));
    assert!(output.status.success());
    let (said, found) = (stderr(&output), parse(&stdout(&output)));
    let notes: Vec<&str> =
        found["mesh_notes"].as_array().unwrap().iter().map(|n| n.as_str().unwrap()).collect();
    assert_eq!(notes.len(), 2, "{notes:?}");
    assert!(notes[0].contains("1 collapsed or repeated triangles were dropped"), "{notes:?}");
    assert!(notes[1].contains("1 triangles were oriented against the others"), "{notes:?}");
    for note in notes {
        assert!(said.contains(&format!("eit: note: {note}")), "{said}");
    }
}

#[test]
fn what_a_scene_gets_wrong_about_geometry_is_refused() {
    let stl = tube_stl(24, 8);
    let (folder, scene) = tube(stl.clone());
    folder.write("cut.stl", &stl[..stl.len() / 2]);
    let scene = read_text(scene);
    let out = folder.path("m.vtu");
    let line = |scene: String| format!("mesh {scene} --out {out}");
    for (skin, says) in [
        ("file = \"cut.stl\"\nscale_m = 1e-3", "cut.stl: line"),
        ("file = \"tube.stl\"", "scale_m"),
        ("file = \"tube.stl\"\nscale_m = -1.0", "scale_m is -1"),
        ("file = \"tube.ply\"", ".stl or .obj"),
        ("scale_m = 1e-3", "skin.file is missing"),
    ] {
        refuse_each([(line(tube_scene(&folder, skin)), says)]);
    }
    let crossing = "[skin]\nshape = \"polygon\"\noutline = [[0.0, 0.0], [0.1, 0.1], [0.1, 0.0], [0.0, 0.1]]\n\
                    conductivity_s = 1.0\n[electrodes]\ncount = 8\nwidth_m = 0.005\n";
    let scaled = "[skin]\nshape = \"disc\"\nradius_m = 0.1\nscale_m = 2.0\nconductivity_s = 1.0\n";
    for (from, to, says) in [
        ("radius_m = [0.0", "radius_m = [0.01", "electrode 1: width_m 0.01 and radius_m 0.01"),
        ("[0.040000, 0.000000, 0]", "[0.05, 0.0]", "electrode 1 at [0.05, 0.0, 0.0]"),
        ("[0.040000, 0.000000, 0]", "[0.05]", "1 values instead of two or three"),
        ("positions_m", "count = 3\npositions_m", "electrodes.count"),
        ("radius_m = [0.0", "radius_m = [0.0, 0.0", "17 values for 16 electrodes"),
        ("[0.040000, 0.000000, 0.05]", "[0.040000, 0.000000, 0.001]", "electrode 9"),
        (&scene, crossing, "the outline is invalid at [0.05, 0.05]"),
        (&scene, scaled, "skin.scale_m has no effect without"),
    ] {
        assert!(scene.contains(from), "{from}");
        let line = line(folder.write("scene.toml", scene.replacen(from, to, 1)));
        refuse_each([(line, format!("scene.toml: …{says}"))]);
    }
}
