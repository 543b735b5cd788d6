//! Skins of all geometries through the commands.

use crate::common::*;

/// A tube of radius 0.04 and height 0.1, open at both ends, as an ASCII STL file in millimetres.
fn tube_stl(facets: u32, rings: u32) -> String {
    let corner = |i: u32, j: u32| {
        let angle = std::f64::consts::TAU * f64::from(i % facets) / f64::from(facets);
        let z = 100.0 * f64::from(j) / f64::from(rings);
        format!("vertex {:.6} {:.6} {z:.6}\n", 40.0 * angle.cos(), 40.0 * angle.sin())
    };
    let facet = |corners: [(u32, u32); 3]| {
        let corners = corners.map(|(i, j)| corner(i, j)).concat();
        format!("facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n")
    };
    let square = |(i, j)| {
        facet([(i, j), (i + 1, j), (i + 1, j + 1)]) + &facet([(i, j), (i + 1, j + 1), (i, j + 1)])
    };
    let places = (0..facets).flat_map(|i| (0..rings).map(move |j| (i, j)));
    format!("solid tube\n{}endsolid tube\n", places.map(square).collect::<String>())
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

/// A folder with the file of a tube and its scene.
fn tube(stl: impl AsRef<[u8]>) -> (Folder, String) {
    let folder = Folder::new();
    folder.write("tube.stl", stl);
    let scene = tube_scene(&folder, "file = \"tube.stl\"\nscale_m = 1e-3");
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
    let measures = numbers(&found, "electrode_measures");
    assert_eq!(measures.len(), 16);
    for (l, measure) in measures.iter().enumerate() {
        // an end may snap to a nearby rim node; chords cut a percent off a patch
        let (wanted, within) = if l < 8 { (0.01, 1e-3) } else { (7.854e-5, 0.033) };
        assert!((measure / wanted - 1.0).abs() < within, "{l}: {measure}");
    }
    // 48 facets: the circumference of the polygon, times the height
    let facets = 48.0 * 2.0 * 0.04 * (std::f64::consts::PI / 48.0).sin() * 0.1;
    assert!((number(&found, "area_m2") / facets - 1.0).abs() < 1e-6);
    assert_eq!(found["mesh_notes"], json!([]));
    // the mesh that was written equals the mesh that is solved on
    let [v, w] = ["", &format!("--mesh {}", path("skin.msh"))].map(|mesh| -> Array1<f64> {
        succeed(format!("forward {scene} {mesh} --out {}", path("v.npy")));
        read_array(path("v.npy"))
    });
    assert_eq!((v.len(), &v), (208, &w));
    // turned by one electrode the facets lie the same, up to rounding of the file: so drives (0, 1) and (1, 2) measure
    for k in 0..4 {
        let off = (v[k] - v[13 + k]).abs() / largest(&v);
        assert!(off < 5e-3, "{k}: {off:e}");
    }
    assert!(answer(format!("plan {scene}"))["stages"].as_array().unwrap().len() >= 4);
    // images are seen from +z, where a tube has no area
    let frames = folder.write_array("frames.npy", &ndarray::stack![Axis(0), v, 1.01 * &v]);
    let given = format!("--frames {frames} --reference 0 --out {}", path("images"));
    refuse_each([(format!("reconstruct {scene} {given}"), "raster…+z")]);
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
    let [flat, dome] = [disc, folder.path("hemisphere.npy")].map(read_array::<Ix1>);
    let (off, size) = (largest(&(&flat - &dome)), largest(&flat));
    assert!(off < 1e-2 * size, "{off:e} of {size:e}");
    // measured 4e-3 on the disc; patches have no series: estimated with quadratic elements
    for name in ["paper-disc", "hemisphere", "patches"] {
        let error = number(&answer(format!("plan {name}")), "expected_voltage_error");
        assert!((1e-4..2e-2).contains(&error), "{name}: {error}");
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
    let (folder, scene) = tube(good.replacen(&facet, &format!("{turned}{facet}"), 1));
    let out = folder.path("v.npy");
    let output = eit(format!("forward {scene} --out {out} --json"));
    let (said, found) = (ended(&output, 0), parse(&stdout(&output)));
    let notes = found["mesh_notes"].as_array().unwrap();
    assert_eq!(notes.len(), 2, "{notes:?}");
    let wanted = [
        "1 collapsed or repeated triangles were dropped",
        "1 triangles were oriented against the others",
    ];
    for (note, words) in notes.iter().map(|note| note.as_str().unwrap()).zip(wanted) {
        says(note, words);
        says(&said, format!("eit: note: {note}"));
    }
}

#[test]
fn what_a_scene_gets_wrong_about_geometry_is_refused() {
    let stl = tube_stl(24, 8);
    let (folder, scene) = tube(&stl);
    folder.write("cut.stl", &stl[..stl.len() / 2]);
    let scene = read_text(scene);
    let out = folder.path("m.vtu");
    let line = |scene: String| format!("mesh {scene} --out {out}");
    for (skin, words) in [
        ("file = \"cut.stl\"\nscale_m = 1e-3", "cut.stl: line"),
        ("file = \"tube.stl\"", "scale_m"),
        ("file = \"tube.stl\"\nscale_m = -1.0", "scale_m is -1"),
        ("file = \"tube.ply\"", ".stl or .obj"),
        ("scale_m = 1e-3", "skin.file is missing"),
    ] {
        refuse_each([(line(tube_scene(&folder, skin)), words)]);
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
