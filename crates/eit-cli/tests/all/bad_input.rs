//! Invalid input: exit code 2 and one line that says what is wrong, where, and how to fix it.

use crate::common::{Folder, SMALL, answer, eit, exists, read_text, refuse, stderr, succeed};
use ndarray::Array2;

/// One line of the small scene replaced.
#[test]
fn scenes_that_cannot_be() {
    let folder = Folder::new();
    for (from, to, wanted) in [
        ("radius_m = 0.1", "radius_m = 0.0", "radius"),
        ("radius_m = 0.1", "radius_m = 100.0", "skin.radius_m is 100: lengths are in metres"),
        (
            "shape = \"disc\"\nradius_m = 0.1",
            "shape = \"polygon\"\noutline = [[0, 0], [200, 0], [200, 100], [0, 100]]",
            "skin.outline, corner 2 is 200: lengths are in metres, of which a skin has at most 10; 200 looks like millimetres, which are 0.2 metres",
        ),
        (
            "shape = \"disc\"\nradius_m = 0.1",
            "shape = \"polygon\"\noutline = [[0, 0], [0.2, 0], [0.2, 0.1], [0, 0.1]]\nholes = [[[50, 50], [60, 50], [60, 60]]]",
            "skin.holes, hole 1, corner 1 is 50: lengths are in metres",
        ),
        ("radius_m = 0.1", "radius_m = -1.0", "-1"),
        ("radius_m = 0.1", "radius_m = nan", "NaN"),
        ("radius_m = 0.1", "", "skin.radius_m is missing"),
        ("radius_m = 0.1", "radus_m = 0.1", "did you mean \"radius_m\"?"),
        ("conductivity_s = 1e-5", "conductivity_s = 0.0", "skin.conductivity_s is 0"),
        ("conductivity_s = 1e-5", "conductivity_s = -1e-5", "above zero"),
        ("contact_impedance_ohm_m = 1e3", "contact_impedance_ohm_m = -1.0", "electrode 1 is -1"),
        ("contact_impedance_ohm_m = 1e3", "contact_impedance_ohm_m = [1.0, 2.0]", "2 values for 8"),
        ("width_m = 0.02", "width_m = 0.2", "electrodes 1 and 2 overlap"),
        ("width_m = 0.02", "width_m = 0.0", "width_m"),
        ("count = 8", "count = 3", "no measurement"),
        ("count = 8", "positions_m = [[0.2, 0.0], [0.0, 0.1]]", "from the rim"),
        ("drive = \"adjacent\"", "drive = \"adjacnt\"", "\"adjacent\", \"opposite\", \"skip-N\""),
        ("drive = \"adjacent\"", "measurement_file = \"m.npy\"", "no effect without"),
        ("drive = \"adjacent\"", "drive = \"adjacent\"\npairs = [[0, 1]]", "exclude each other"),
        ("edge_m = 0.012", "edge_m = 0.012\nnodes = 500", "exclude each other"),
        ("drive = \"adjacent\"", "pairs = [[0, 1, 2]]", "3 values instead of two"),
        ("drive = \"adjacent\"", "pairs = [[0, 9]]", "electrode index 9"),
        ("drive = \"adjacent\"", "pairs = [[3, 3]]", "with itself"),
        ("drive = \"adjacent\"", "quadruples_file = \"nowhere.csv\"", "nowhere.csv"),
        ("current_a = 1e-4", "current_a = 0.0", "current_a is 0"),
        ("current_a = 1e-4", "current_a = 1e4", "current_a is 10000: it must be from 1e-9 to 10"),
        ("edge_m = 0.012", "edge_m = -1.0", "edge_m"),
        ("edge_m = 0.012", "edge_m = 1e-7", "limit"),
        ("shape = \"disc\"", "shape = \"mesh\"\nfile = \"f.msh\"", "exclude each other"),
    ] {
        assert!(SMALL.contains(from), "{from}");
        let found = refuse(format!("plan {}", folder.write("scene.toml", SMALL.replace(from, to))));
        assert!(found.contains(wanted), "{to}: {found}");
    }
}

/// Keys added to the small scene.
#[test]
fn keys_that_cannot_be() {
    let folder = Folder::new();
    for (keys, wanted) in [
        ("[reconstruction]\npixels = 0", "reconstruction.pixels is 0"),
        ("[reconstruction]\nhyperparameter = -1.0", "hyperparameter is -1"),
        ("[reconstruction]\nhyperparameter = 1.0\nnoise_figure = 1.0", "no effect"),
        ("[noise]\nadditive_v = -1.0", "noise.additive_v is -1"),
        ("[noise]\nquiet_frames = \"4..6\"", "three or more"),
        ("[noise]\nquiet_frames = \"0..10\"\nadditive_v = 1.0", "exclude each"),
        ("[reconstruction]\nlambda_space = 0.0", "lambda_space is 0"),
        ("[reconstruction]\nlambda_time = 1.0", "no effect without"),
        ("[reconstruction]\nlambda_time = -1.0", "not below zero"),
        ("[reconstruction]\nlamda_space = 1.0", "mean \"lambda_space\"?"),
        ("[reconstruction]\ndelta = \"noisy\"", "a number, \"noise\" or \"paper\""),
        ("[reconstruction]\ndelta = -1.0", "reconstruction.delta is -1"),
        ("[reconstruction]\nlower_s = 1e-6", "must include zero"),
        ("[reconstruction]\nlower_s = 0.0\nupper_s = 0.0", "must include zero"),
        ("[reconstruction]\ntarget_gap = nan", "target_gap is NaN"),
        ("[reconstruction]\ndeadline_s = 0.0", "deadline_s is 0"),
        ("[reconstruction]\ndelta = 1.0\nprior = \"noser\"", "belong to different methods"),
        (
            "[reconstruction]\nmethod = \"time-prior\"\ntarget_gap = 1e-3",
            "no effect with method = \"time-prior\"",
        ),
        (
            "[reconstruction]\nmethod = \"st-tv\"\nnoise_figure = 1.0",
            "no effect with method = \"st-tv\"",
        ),
        (
            "[reconstruction]\nmethod = \"tv\"\nlambda_space = 1.0\nlambda_time = 1.0",
            "use \"st-tv\"",
        ),
        ("[recording]\nscale = 0.0", "recording.scale is 0"),
        ("[recording]\nframe_rate_hz = 0.0", "recording.frame_rate_hz is 0"),
        ("[recording]\nframe_rate_hz = 1e-300", "recording.frame_rate_hz is 0.00"),
        ("[touch]\nradius_m = 7.0", "touch.radius_m is 7: it must be from 0.00001 to 1"),
        ("[touch]\napart_m = 1e-12", "touch.apart_m is 0.000000000001"),
        ("[touch]\ndrift_time_s = -1.0", "touch.drift_time_s is -1"),
    ] {
        let found = refuse(format!("plan {}", folder.scene(keys)));
        assert!(found.contains(wanted), "{keys}: {found}");
    }
}

/// A scene file that is missing, and one whose mesh is: both are named.
#[test]
fn missing_files_are_named() {
    let folder = Folder::new();
    let mut content = SMALL.replace("shape = \"disc\"", "shape = \"mesh\"\nfile = \"nowhere.msh\"");
    for key in ["radius_m = 0.1", "count = 8", "width_m = 0.02", "edge_m = 0.012"] {
        content = content.replace(key, "");
    }
    let scene = folder.write("scene.toml", content);
    for (line, wanted) in [
        (format!("plan {scene}"), "nowhere.msh"),
        ("plan papr-disc".into(), "paper-disc"),
        ("plan papr-disc".into(), "papr-disc"),
        ("reconstruct paper-disc --out unused-folder".into(), "--frames"),
    ] {
        let found = refuse(&line);
        assert!(found.contains(wanted), "{line}: {found}");
    }
}

fn csv(rows: usize, columns: usize, odd: Option<(usize, usize, &str)>) -> String {
    let cell = |r: usize, c: usize| match odd {
        Some((row, column, value)) if (row, column) == (r, c) => value.to_owned(),
        _ => format!("{}", 1.0 + 0.01 * (r * columns + c) as f64),
    };
    let row = |r| (0..columns).map(|c| cell(r, c)).collect::<Vec<_>>().join(",") + "\n";
    (0..rows).map(row).collect()
}

#[test]
fn frames_that_cannot_be() {
    let folder = Folder::new();
    let (scene, out) = (folder.scene(""), folder.path("out"));
    let first = "--reference 0";
    let all_missing = [vec!["nan"; 40].join(","), String::new()].join("\n").repeat(2);
    let header = format!("a,b,3\n{}", csv(2, 40, None));
    type Case<'a> = (&'a str, Vec<u8>, &'a str, &'a [&'a str]);
    let cases: [Case<'_>; 9] = [
        ("f.csv", header.into(), first, &["line 1", "value 1 is \"a\"", "a header, remove it"]),
        ("f.csv", csv(2, 39, None).into(), first, &["39", "40"]),
        // a few missing values are accepted: missing_values.rs
        ("f.csv", all_missing.into(), first, &["no measurement is usable", "80 value(s) missing"]),
        ("f.csv", csv(2, 40, Some((1, 7, "volt"))).into(), first, &["f.csv", "line 2"]),
        ("f.csv", Vec::new(), first, &["f.csv", "empty"]),
        ("f.csv", vec![0, 159, 146, 150, 0, 1, 2], first, &["f.csv"]),
        ("f.npy", b"\x93NUMPY\x01\x00".to_vec(), first, &["f.npy"]),
        ("f.csv", csv(2, 40, None).into(), "", &["no reference frame", "--reference"]),
        ("f.csv", csv(2, 40, None).into(), "--reference 5", &["frames 0 to 1"]),
    ];
    for (name, content, more, wanted) in cases {
        let frames = folder.write(name, content);
        let found = refuse(format!("reconstruct {scene} --frames {frames} --out {out} {more}"));
        assert!(wanted.iter().all(|part| found.contains(part)), "{wanted:?}: {found}");
    }
}

/// Requests beyond memory are rejected with their size before allocation: under a limit of 1.2 GB of address
/// space, where one raster of that many pixels takes 1.8 GB.
#[cfg(unix)]
#[test]
fn images_beyond_memory_are_refused_before_work() {
    let folder = Folder::new();
    for (rows, electrodes, method, wanted) in [
        (302, 8, "st-tv", "302 images of 4096 x 4096 pixels take 41 GB"),
        (302, 8, "gauss-newton", "302 images of 4096 x 4096 pixels take 41 GB"),
        // the images would fit, but not the arrays needed to make them
        (3, 16, "st-tv", "208 measurements on 4096 x 4096 pixels take 28 GB"),
    ] {
        let keys = format!("[reconstruction]\nmethod = \"{method}\"\npixels = 4096\n[mesh]");
        let content =
            SMALL.replace("count = 8", &format!("count = {electrodes}")).replace("[mesh]", &keys);
        let scene = folder.write("scene.toml", content);
        let frames = folder.write("f.csv", csv(rows, electrodes * (electrodes - 3), None));
        let (program, out) = (env!("CARGO_BIN_EXE_eit"), folder.path("out"));
        let line = format!(
            "ulimit -v 1200000; exec '{program}' reconstruct {scene} --frames {frames} --reference 0 --out {out}"
        );
        let output = std::process::Command::new("sh").args(["-c", &line]).output().unwrap();
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(wanted), "{said}");
    }
}

/// The limits themselves are accepted.
#[test]
fn limits_of_electrodes_and_nodes() {
    let folder = Folder::new();
    let plan = |from: &str, to: &str| {
        refuse(format!("plan {}", folder.write("scene.toml", SMALL.replace(from, to))))
    };
    let said = plan("count = 8", "count = 2049");
    assert!(said.contains("2049 electrodes: a skin has at most 2048"), "{said}");
    // rejected all the same: they do not fit the rim
    let said = plan("count = 8", "count = 2048");
    assert!(!said.contains("at most"), "{said}");
    for key in ["nodes", "node_limit"] {
        let said = plan("edge_m = 0.012", &format!("{key} = 20000001"));
        let wanted = format!("mesh.{key} is 20000001: it must be at most 20000000");
        assert!(said.contains(&wanted), "{said}");
        // a scene with another error
        let said = plan("edge_m = 0.012", &format!("{key} = 20000000\n[touch]\nradius_m = -1.0"));
        assert!(said.contains("touch.radius_m is -1"), "{said}");
    }
}

/// Wrong usage is reported on one line too, which points to the help once; a number below zero is one that is not
/// taken, and not another option.
#[test]
fn wrong_usage_is_one_line() {
    let whole = "a whole number, 0 or above";
    for (line, wanted) in [
        ("plan", &["required"][..]),
        ("plan paper-disc --frobnicate", &["'--frobnicate'"]),
        ("nonsense", &["unrecognized subcommand 'nonsense'; see --help"]),
        ("reconstruct paper-disc --out", &["a value is required"]),
        ("simulate paper-disc --seed -1 --out never", &["'--seed <N>'", whole]),
        ("mesh paper-disc --out never.png --nodes -1", &["'--nodes <N>'", whole]),
        ("simulate paper-disc --seed one --out never", &["'--seed <N>'", whole]),
    ] {
        let said = refuse(line);
        assert!(wanted.iter().all(|part| said.contains(part)), "{line}: {said}");
        assert!(said.starts_with("eit: ") && said.matches("--help").count() == 1, "{said}");
        assert!(!wanted.contains(&whole) || !said.contains("tip"), "{said}");
    }
    let said = refuse("replay paper-disc --from never.mcap --speed -1");
    assert!(said.contains("--speed -1: it must be above 0"), "{said}");
}

/// A file stands where results would go, or above it: found before any work, and kept.
#[test]
fn a_file_is_no_folder() {
    let folder = Folder::new();
    let (scene, file) = (folder.scene(""), folder.write("f.csv", csv(2, 40, None)));
    let is_file = "f.csv: is a file, but --out must name a folder here";
    for (line, wanted) in [
        (format!("reconstruct {scene} --frames {file} --reference 0 --out {file}"), is_file),
        (format!("net base {scene} --out {file}"), is_file),
        (format!("man --out {file}"), is_file),
        (format!("reconstruct paper-disc --frames nowhere.csv --out {file}/out"), "cannot write"),
        (format!("demo --out {file}/out"), "cannot write"),
        (format!("forward paper-disc --out {file}/v.csv"), "cannot write"),
    ] {
        let said = refuse(&line);
        assert!(said.contains(wanted), "{line}: {said}");
    }
    assert_eq!(read_text(&file), csv(2, 40, None));
}

/// Contact impedances so far from the sheet's that no digit survives nodal assembly: linear elements are
/// solved differently (`accuracy.rs`), quadratic ones fail and say so; a few decades closer, the voltages
/// come with a warning.
#[test]
fn voltages_without_a_certain_digit_are_refused() {
    let folder = Folder::new();
    let out = folder.path("v.csv");
    let forward = |impedance: &str, elements: &str| {
        let key = format!("contact_impedance_ohm_m = {impedance}");
        let scene = SMALL.replace("contact_impedance_ohm_m = 1e3", &key);
        let scene = folder.write("scene.toml", format!("{scene}elements = \"{elements}\"\n"));
        format!("forward {scene} --out {out}")
    };
    for impedance in ["1e-12", "1e16", "[1e20, 1e3, 1e3, 1e3, 1e3, 1e3, 1e3, 1e3]"] {
        let output = eit(forward(impedance, "quadratic"));
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{impedance}: {said}");
        assert!(said.contains("no digit") || said.contains("decades"), "{said}");
        assert!(!exists(&out));
        let said = succeed(forward(impedance, "linear"));
        assert!(!said.contains("warning"), "{said}");
        std::fs::remove_file(&out).unwrap();
    }
    let said = succeed(forward("1e-5", "quadratic"));
    assert!(said.contains("warning: rounding"), "{said}");
}

/// An existing result survives a run that fails.
#[test]
fn a_failed_run_leaves_the_old_result() {
    let folder = Folder::new();
    let (out, sigma) = (folder.write("v.csv", "old"), folder.write("sigma.csv", "1,2,3\n"));
    let found = refuse(format!("forward paper-disc --conductivity {sigma} --out {out}"));
    assert!(found.contains("3 values") && found.contains("elements"), "{found}");
    assert_eq!(read_text(&out), "old");
    assert_eq!(folder.names(), ["sigma.csv", "v.csv"], "no temporary is left");
}

/// A mesh of two parts and one with a zero conductivity are rejected with the position.
#[test]
fn meshes_and_conductivities_that_cannot_be() {
    let folder = Folder::new();
    let two_parts = folder.write(
        "two_parts.msh",
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n6\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 5 0 0\n\
         5 6 0 0\n6 5 1 0\n$EndNodes\n$Elements\n2\n1 2 2 0 1 1 2 3\n2 2 2 0 1 4 5 6\n\
         $EndElements\n",
    );
    let [out, skin] = folder.paths(["v.csv", "skin.msh"]);
    let found = refuse(format!("forward paper-disc --mesh {two_parts} --out {out}"));
    assert!(found.contains("2 parts"), "{found}");
    let scene = folder.scene("");
    let json = answer(format!("mesh {scene} --out {skin}"));
    let count = json["triangles"].as_u64().unwrap() as usize;
    for bad in [0.0, -1.0] {
        let mut sigma = Array2::from_elem((1, count), 1e-5);
        sigma[[0, 17]] = bad;
        let file = folder.write_array("sigma.npy", &sigma);
        let line = format!("forward {scene} --mesh {skin} --conductivity {file} --out {out}");
        let found = refuse(line);
        assert!(found.contains("element 17") && found.contains(&format!("{bad}")), "{found}");
    }
}

/// The wrong order is detected by reciprocity and reported with the key that fixes it.
#[test]
fn the_wrong_order_is_reported_with_its_key() {
    let folder = Folder::new();
    let with = |key: &str| {
        folder.write("scene.toml", SMALL.replace("current_a", &format!("{key}\ncurrent_a")))
    };
    let [frames, out] = folder.paths(["f.csv", "out"]);
    succeed(format!("forward {} --out {frames}", with("order = \"ascending\"")));
    let more = format!("--frames {frames} --reference 0 --out {out}");
    let found = refuse(format!("reconstruct {} {more}", folder.scene("")));
    assert!(found.contains("order = \"ascending\""), "{found}");
    let unchecked = eit(format!("reconstruct {} {more}", with("check_order = false")));
    assert!(unchecked.status.success(), "the user may insist");
}
