//! Invalid input: exit code 2 and one line that says what is wrong, where, and how to fix it.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "tests")]

use crate::common;
use crate::common::{SMALL, eit, refuse, text, write_scene};
use ndarray::Array2;

/// Runs `eit plan` on the small scene with one line replaced.
fn broken(from: &str, to: &str) -> String {
    let folder = tempfile::tempdir().unwrap();
    let content = SMALL.replace(from, to);
    assert_ne!(content, SMALL, "{from} is in the scene");
    refuse(&["plan", text(&write_scene(folder.path(), &content))])
}

#[test]
fn scenes_that_cannot_be() {
    let cases = [
        ("radius_m = 0.1", "radius_m = 0.0", "radius"),
        ("radius_m = 0.1", "radius_m = 100.0", "skin.radius_m is 100: lengths are in metres"),
        (
            "shape = \"disc\"\nradius_m = 0.1",
            "shape = \"polygon\"\noutline = [[0, 0], [200, 0], [200, 100], [0, 100]]",
            "skin.outline, corner 2 is 200: lengths are in metres, of which a skin has at most 10; 200 looks like \
             millimetres, which are 0.2 metres",
        ),
        (
            "shape = \"disc\"\nradius_m = 0.1",
            "shape = \"polygon\"\noutline = [[0, 0], [0.2, 0], [0.2, 0.1], [0, 0.1]]\nholes = [[[50, 50], \
             [60, 50], [60, 60]]]",
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
        ("[mesh]", "[reconstruction]\npixels = 0\n[mesh]", "reconstruction.pixels is 0"),
        ("[mesh]", "[reconstruction]\nhyperparameter = -1.0\n[mesh]", "hyperparameter is -1"),
        (
            "[mesh]",
            "[reconstruction]\nhyperparameter = 1.0\nnoise_figure = 1.0\n[mesh]",
            "no effect",
        ),
        ("[mesh]", "[noise]\nadditive_v = -1.0\n[mesh]", "noise.additive_v is -1"),
        ("[mesh]", "[noise]\nquiet_frames = \"4..6\"\n[mesh]", "three or more"),
        ("[mesh]", "[noise]\nquiet_frames = \"0..10\"\nadditive_v = 1.0\n[mesh]", "exclude each"),
        ("[mesh]", "[reconstruction]\nlambda_space = 0.0\n[mesh]", "lambda_space is 0"),
        ("[mesh]", "[reconstruction]\nlambda_time = 1.0\n[mesh]", "no effect without"),
        ("[mesh]", "[reconstruction]\nlambda_time = -1.0\n[mesh]", "not below zero"),
        ("[mesh]", "[reconstruction]\nlamda_space = 1.0\n[mesh]", "mean \"lambda_space\"?"),
        ("[mesh]", "[reconstruction]\ndelta = \"noisy\"\n[mesh]", "a number, or \"noise\""),
        ("[mesh]", "[reconstruction]\ndelta = -1.0\n[mesh]", "reconstruction.delta is -1"),
        ("[mesh]", "[reconstruction]\nlower_s = 1e-6\n[mesh]", "must include zero"),
        ("[mesh]", "[reconstruction]\nlower_s = 0.0\nupper_s = 0.0\n[mesh]", "must include zero"),
        ("[mesh]", "[reconstruction]\ntarget_gap = nan\n[mesh]", "target_gap is NaN"),
        ("[mesh]", "[reconstruction]\ndeadline_s = 0.0\n[mesh]", "deadline_s is 0"),
        (
            "[mesh]",
            "[reconstruction]\ndelta = 1.0\nprior = \"noser\"\n[mesh]",
            "belong to different methods",
        ),
        (
            "[mesh]",
            "[reconstruction]\nmethod = \"time-prior\"\ntarget_gap = 1e-3\n[mesh]",
            "no effect with method = \"time-prior\"",
        ),
        (
            "[mesh]",
            "[reconstruction]\nmethod = \"st-tv\"\nnoise_figure = 1.0\n[mesh]",
            "no effect with method = \"st-tv\"",
        ),
        (
            "[mesh]",
            "[reconstruction]\nmethod = \"tv\"\nlambda_space = 1.0\nlambda_time = 1.0\n[mesh]",
            "use \"st-tv\"",
        ),
        ("[mesh]", "[recording]\nscale = 0.0\n[mesh]", "recording.scale is 0"),
        ("[mesh]", "[recording]\nframe_rate_hz = 0.0\n[mesh]", "recording.frame_rate_hz is 0"),
        (
            "[mesh]",
            "[recording]\nframe_rate_hz = 1e-300\n[mesh]",
            "recording.frame_rate_hz is 0.00",
        ),
        (
            "[mesh]",
            "[touch]\nradius_m = 7.0\n[mesh]",
            "touch.radius_m is 7: it must be from 0.00001 to 1",
        ),
        ("[mesh]", "[touch]\napart_m = 1e-12\n[mesh]", "touch.apart_m is 0.000000000001"),
        ("[mesh]", "[touch]\ndrift_time_s = -1.0\n[mesh]", "touch.drift_time_s is -1"),
        ("drive = \"adjacent\"", "pairs = [[0, 1, 2]]", "3 values instead of two"),
        ("drive = \"adjacent\"", "pairs = [[0, 9]]", "electrode index 9"),
        ("drive = \"adjacent\"", "pairs = [[3, 3]]", "with itself"),
        ("drive = \"adjacent\"", "quadruples_file = \"nowhere.csv\"", "nowhere.csv"),
        ("current_a = 1e-4", "current_a = 0.0", "current_a is 0"),
        ("current_a = 1e-4", "current_a = 1e4", "current_a is 10000: it must be from 1e-9 to 10"),
        ("edge_m = 0.012", "edge_m = -1.0", "edge_m"),
        ("edge_m = 0.012", "edge_m = 1e-7", "limit"),
        ("shape = \"disc\"", "shape = \"mesh\"\nfile = \"f.msh\"", "exclude each other"),
    ];
    for (from, to, wanted) in cases {
        let found = broken(from, to);
        assert!(found.contains(wanted), "{to}: {found}");
    }
}

#[test]
fn a_scene_with_a_mesh_file_names_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let content = SMALL
        .replace("shape = \"disc\"", "shape = \"mesh\"\nfile = \"nowhere.msh\"")
        .replace("radius_m = 0.1", "")
        .replace("count = 8", "")
        .replace("width_m = 0.02", "")
        .replace("edge_m = 0.012", "");
    let found = refuse(&["plan", text(&write_scene(folder.path(), &content))]);
    assert!(found.contains("nowhere.msh"), "{found}");
}

#[test]
fn unknown_scene_lists_the_built_in_ones() {
    let found = refuse(&["plan", "papr-disc"]);
    assert!(found.contains("paper-disc") && found.contains("papr-disc"), "{found}");
}

/// Reconstructs frames of a file's content against frame 0.
fn reconstruct(name: &str, content: &[u8], more: &[&str]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let scene = write_scene(folder.path(), SMALL);
    let (frames, out) = (folder.path().join(name), folder.path().join("out"));
    std::fs::write(&frames, content).unwrap();
    let mut arguments =
        vec!["reconstruct", text(&scene), "--frames", text(&frames), "--out", text(&out)];
    arguments.extend(more);
    refuse(&arguments)
}

fn csv(rows: usize, columns: usize, odd: Option<(usize, usize, &str)>) -> Vec<u8> {
    let mut content = String::new();
    for r in 0..rows {
        let row: Vec<String> = (0..columns)
            .map(|c| match odd {
                Some((or, oc, value)) if (or, oc) == (r, c) => value.to_owned(),
                _ => format!("{}", 1.0 + 0.01 * (r * columns + c) as f64),
            })
            .collect();
        content.push_str(&row.join(","));
        content.push('\n');
    }
    content.into_bytes()
}

#[test]
fn frames_that_cannot_be() {
    let reference = ["--reference", "0"];
    type Case<'a> = (&'a str, Vec<u8>, &'a [&'a str], &'a [&'a str]);
    let all_missing = [vec!["nan"; 40].join(","), String::new()].join("\n").repeat(2).into_bytes();
    let header = [b"a,b,3\n".to_vec(), csv(2, 40, None)].concat();
    let cases: [Case<'_>; 9] = [
        ("f.csv", header, &reference, &["line 1", "value 1 is \"a\"", "a header, remove it"]),
        ("f.csv", csv(2, 39, None), &reference, &["39", "40"]),
        // a few missing values are accepted: missing_values.rs
        ("f.csv", all_missing, &reference, &["no measurement is usable", "80 value(s) missing"]),
        ("f.csv", csv(2, 40, Some((1, 7, "volt"))), &reference, &["f.csv", "line 2"]),
        ("f.csv", Vec::new(), &reference, &["f.csv", "empty"]),
        ("f.csv", vec![0, 159, 146, 150, 0, 1, 2], &reference, &["f.csv"]),
        ("f.npy", b"\x93NUMPY\x01\x00".to_vec(), &reference, &["f.npy"]),
        ("f.csv", csv(2, 40, None), &[], &["no reference frame", "--reference"]),
        ("f.csv", csv(2, 40, None), &["--reference", "5"], &["frames 0 to 1"]),
    ];
    for (name, content, more, wanted) in cases {
        let found = reconstruct(name, &content, more);
        for part in wanted {
            assert!(found.contains(part), "{part}: {found}");
        }
    }
}

/// Requests beyond memory are rejected with their size before allocation: under a limit of 1.2 GB of address
/// space, where one raster of that many pixels takes 1.8 GB.
#[cfg(unix)]
#[test]
fn images_beyond_memory_are_refused_before_work() {
    let folder = tempfile::tempdir().unwrap();
    let frames = folder.path().join("f.csv");
    let run = |rows: usize, electrodes: usize, method: &str| {
        let keys = format!("[reconstruction]\nmethod = \"{method}\"\npixels = 4096\n[mesh]");
        let content =
            SMALL.replace("count = 8", &format!("count = {electrodes}")).replace("[mesh]", &keys);
        let scene = write_scene(folder.path(), &content);
        std::fs::write(&frames, csv(rows, electrodes * (electrodes - 3), None)).unwrap();
        let line = format!(
            "ulimit -v 1200000; exec {} reconstruct {} --frames {} --reference 0 --out {}",
            env!("CARGO_BIN_EXE_eit"),
            text(&scene),
            text(&frames),
            text(&folder.path().join("out"))
        );
        let output = std::process::Command::new("sh").args(["-c", &line]).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        said
    };
    for method in ["st-tv", "gauss-newton"] {
        let said = run(302, 8, method);
        assert!(said.contains("302 images of 4096 x 4096 pixels take 41 GB"), "{said}");
    }
    // the images would fit, but not the arrays needed to make them
    let said = run(3, 16, "st-tv");
    assert!(said.contains("208 measurements on 4096 x 4096 pixels take 28 GB"), "{said}");
}

/// One line, which points to the help once, with or without a usage line.
#[test]
fn unknown_commands_and_options() {
    let said = refuse(&["nonsense"]);
    assert!(said.contains("unrecognized subcommand 'nonsense'; see --help"), "{said}");
    let said = refuse(&["plan", "paper-disc", "--bogus"]);
    assert!(said.contains("'--bogus'") && said.matches("--help").count() == 1, "{said}");
}

/// The limits themselves are accepted.
#[test]
fn limits_of_electrodes_and_nodes() {
    let folder = tempfile::tempdir().unwrap();
    let plan = |from: &str, to: &str| {
        let scene = write_scene(folder.path(), &SMALL.replace(from, to));
        refuse(&["plan", text(&scene)])
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

#[test]
fn missing_files() {
    let found = refuse(&["reconstruct", "paper-disc", "--out", "unused-folder"]);
    assert!(found.contains("--frames"), "{found}");
}

/// Wrong usage is reported on one line too.
#[test]
fn wrong_usage_is_one_line() {
    for arguments in [
        &["plan"][..],
        &["plan", "paper-disc", "--frobnicate"],
        &["frobnicate"],
        &["mesh", "paper-disc", "--out", "x.png", "--nodes", "-1"],
        &["reconstruct", "paper-disc", "--out"],
    ] {
        let found = refuse(arguments);
        assert!(found.starts_with("eit: ") && found.contains("--help"), "{found}");
    }
}

/// A number below zero is one that is not taken, and not another option.
#[test]
fn numbers_below_zero_are_refused_as_such() {
    for (arguments, wanted) in [
        (&["simulate", "paper-disc", "--seed", "-1", "--out", "never"][..], "'--seed <N>'"),
        (&["mesh", "paper-disc", "--out", "never.png", "--nodes", "-1"], "'--nodes <N>'"),
        (&["simulate", "paper-disc", "--seed", "one", "--out", "never"], "'--seed <N>'"),
    ] {
        let said = refuse(arguments);
        assert!(said.contains(wanted) && said.contains("a whole number, 0 or above"), "{said}");
        assert!(!said.contains("tip"), "{said}");
    }
    let said = refuse(&["replay", "paper-disc", "--from", "never.mcap", "--speed", "-1"]);
    assert!(said.contains("--speed is -1: it must be above 0"), "{said}");
}

/// A file stands where results would go.
#[test]
fn a_file_is_no_folder() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("f.csv");
    std::fs::write(&file, csv(2, 40, None)).unwrap();
    let scene = write_scene(folder.path(), SMALL);
    let [scene, file] = [text(&scene), text(&file)];
    for arguments in [
        &["reconstruct", scene, "--frames", file, "--reference", "0", "--out", file][..],
        &["base", scene, "--out", file],
        &["man", "--out", file],
    ] {
        let said = refuse(arguments);
        assert!(said.contains("f.csv: is a file, but --out must name a folder here"), "{said}");
    }
}

/// Contact impedances so far from the sheet's that no digit survives nodal assembly: linear elements are
/// solved differently (`accuracy.rs`), quadratic ones fail and say so; a few decades closer, the voltages
/// come with a warning.
#[test]
fn voltages_without_a_certain_digit_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("v.csv");
    let scene = |impedance: &str, elements: &str| {
        let key = format!("contact_impedance_ohm_m = {impedance}");
        let scene = SMALL.replace("contact_impedance_ohm_m = 1e3", &key);
        write_scene(folder.path(), &format!("{scene}elements = \"{elements}\"\n"))
    };
    for impedance in ["1e-12", "1e16", "[1e20, 1e3, 1e3, 1e3, 1e3, 1e3, 1e3, 1e3]"] {
        let file = scene(impedance, "quadratic");
        let output = eit(&["forward", text(&file), "--out", text(&out)]);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{impedance}: {stderr}");
        assert!(stderr.contains("no digit") || stderr.contains("decades"), "{stderr}");
        assert!(!out.exists());
        let file = scene(impedance, "linear");
        let answer = common::succeed(&["forward", text(&file), "--out", text(&out)]);
        assert!(!answer.contains("warning"), "{answer}");
        std::fs::remove_file(&out).unwrap();
    }
    let file = scene("1e-5", "quadratic");
    let answer = common::succeed(&["forward", text(&file), "--out", text(&out)]);
    assert!(answer.contains("warning: rounding"), "{answer}");
}

/// A folder that cannot be created is detected before any work: the frames do not even exist.
#[test]
fn unwritable_output_is_found_first() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, "kept").unwrap();
    let below = file.join("out");
    for arguments in [
        vec!["reconstruct", "paper-disc", "--frames", "nowhere.csv", "--out", text(&below)],
        vec!["demo", "--out", text(&below)],
    ] {
        assert!(refuse(&arguments).contains("cannot write"), "{arguments:?}");
    }
    let target = below.join("v.csv");
    assert!(refuse(&["forward", "paper-disc", "--out", text(&target)]).contains("cannot write"));
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "kept");
}

/// An existing result survives a run that fails.
#[test]
fn a_failed_run_leaves_the_old_result() {
    let folder = tempfile::tempdir().unwrap();
    let (out, sigma) = (folder.path().join("v.csv"), folder.path().join("sigma.csv"));
    std::fs::write(&out, "old").unwrap();
    std::fs::write(&sigma, "1,2,3\n").unwrap();
    let arguments = ["forward", "paper-disc", "--conductivity", text(&sigma), "--out", text(&out)];
    let found = refuse(&arguments);
    assert!(found.contains("3 values") && found.contains("elements"), "{found}");
    assert_eq!(std::fs::read_to_string(&out).unwrap(), "old");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "no temporary is left");
}

/// A mesh of two parts and one with a zero conductivity are rejected with the position.
#[test]
fn meshes_and_conductivities_that_cannot_be() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = folder.path().join("two_parts.msh");
    std::fs::write(
        &mesh,
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n6\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 5 0 0\n\
         5 6 0 0\n6 5 1 0\n$EndNodes\n$Elements\n2\n1 2 2 0 1 1 2 3\n2 2 2 0 1 4 5 6\n\
         $EndElements\n",
    )
    .unwrap();
    let out = folder.path().join("v.csv");
    let arguments = ["forward", "paper-disc", "--mesh", text(&mesh), "--out", text(&out)];
    let found = refuse(&arguments);
    assert!(found.contains("2 parts"), "{found}");

    let scene = write_scene(folder.path(), SMALL);
    let skin = folder.path().join("skin.msh");
    common::succeed(&["mesh", text(&scene), "--out", text(&skin)]);
    let count: usize = {
        let answer = common::succeed(&["mesh", text(&scene), "--out", text(&skin), "--json"]);
        let json: serde_json::Value = serde_json::from_str(&answer).unwrap();
        json["triangles"].as_u64().unwrap() as usize
    };
    for bad in [0.0, -1.0] {
        let mut sigma = Array2::from_elem((1, count), 1e-5);
        sigma[[0, 17]] = bad;
        let file = folder.path().join("sigma.npy");
        ndarray_npy::write_npy(&file, &sigma).unwrap();
        let arguments = [
            "forward",
            text(&scene),
            "--mesh",
            text(&skin),
            "--conductivity",
            text(&file),
            "--out",
            text(&out),
        ];
        let found = refuse(&arguments);
        assert!(found.contains("element 17") && found.contains(&format!("{bad}")), "{found}");
    }
}

/// The wrong order is detected by reciprocity and reported with the key that fixes it.
#[test]
fn the_wrong_order_is_reported_with_its_key() {
    let folder = tempfile::tempdir().unwrap();
    let ascending = SMALL.replace("current_a", "order = \"ascending\"\ncurrent_a");
    let scene = write_scene(folder.path(), &ascending);
    let frames = folder.path().join("f.csv");
    common::succeed(&["forward", text(&scene), "--out", text(&frames)]);
    let rotated = write_scene(folder.path(), SMALL);
    let out = folder.path().join("out");
    let arguments = [
        "reconstruct",
        text(&rotated),
        "--frames",
        text(&frames),
        "--reference",
        "0",
        "--out",
        text(&out),
    ];
    let found = refuse(&arguments);
    assert!(found.contains("order = \"ascending\""), "{found}");
    let unchecked = SMALL.replace("current_a", "check_order = false\ncurrent_a");
    let scene = write_scene(folder.path(), &unchecked);
    let arguments: Vec<&str> =
        arguments.iter().map(|a| if *a == text(&rotated) { text(&scene) } else { a }).collect();
    assert!(eit(&arguments).status.success(), "the user may insist");
}
