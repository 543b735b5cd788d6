//! The commands do what `--help` says.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "tests")]

mod common;

use common::{SMALL, succeed, text, write_scene};
use ndarray::{Array1, Array2, Array3};
use serde_json::Value;

#[test]
fn help_teaches_every_command() {
    let help = succeed(&["--help"]);
    for command in [
        "demo",
        "plan",
        "mesh",
        "forward",
        "jacobian",
        "simulate",
        "reconstruct",
        "report",
        "devices",
        "check",
        "live",
        "record",
        "replay",
        "convert",
        "emulate",
    ] {
        assert!(help.contains(&format!("  {command} ")), "{command}");
        assert!(succeed(&[command, "--help"]).contains("Usage"), "{command}");
    }
}

#[test]
fn plan_says_what_is_done_and_left_out() {
    let json: Value = serde_json::from_str(&succeed(&["plan", "paper-disc", "--json"])).unwrap();
    assert_eq!(json["stages"].as_array().unwrap().len(), 5);
    let left_out = json["left_out"].to_string();
    assert!(left_out.contains("complex") && left_out.contains("U-net"), "{left_out}");
    // measured 4e-3 on the default mesh; a wrong closed form or mesh would be far off
    let error = json["expected_voltage_error"].as_f64().unwrap();
    assert!((1e-4..2e-2).contains(&error), "{error}");
}

/// A mesh written and read back gives the same voltages to the last bit, and the Jacobian has the
/// announced shape.
#[test]
fn mesh_file_forward_and_jacobian_agree() {
    let folder = tempfile::tempdir().unwrap();
    let scene = write_scene(folder.path(), SMALL);
    let path = |name: &str| folder.path().join(name);
    for name in ["skin.vtu", "skin.png", "skin.msh"] {
        succeed(&["mesh", text(&scene), "--out", text(&path(name))]);
    }
    let (direct, by_file) = (path("direct.npy"), path("by_file.npy"));
    succeed(&["forward", text(&scene), "--out", text(&direct)]);
    let mesh = path("skin.msh");
    succeed(&["forward", text(&scene), "--mesh", text(&mesh), "--out", text(&by_file)]);
    let v: Array1<f64> = ndarray_npy::read_npy(&direct).unwrap();
    let w: Array1<f64> = ndarray_npy::read_npy(&by_file).unwrap();
    assert_eq!(v.len(), 40);
    assert_eq!(v, w);
    let jacobian = path("j.npy");
    let answer = succeed(&["jacobian", text(&scene), "--out", text(&jacobian), "--json"]);
    let json: Value = serde_json::from_str(&answer).unwrap();
    let j: Array2<f64> = ndarray_npy::read_npy(&jacobian).unwrap();
    assert_eq!(json["shape"], serde_json::json!([j.nrows(), j.ncols()]));
    // one element 1 % more conductive: the change of the voltages is the Jacobian's column
    let element = j.ncols() / 2;
    let step = 1e-7;
    let mut sigma = Array2::from_elem((1, j.ncols()), 1e-5);
    sigma[[0, element]] += step;
    let (sigma_file, moved) = (path("sigma.npy"), path("moved.npy"));
    ndarray_npy::write_npy(&sigma_file, &sigma).unwrap();
    let arguments =
        ["forward", text(&scene), "--conductivity", text(&sigma_file), "--out", text(&moved)];
    succeed(&arguments);
    let moved: Array1<f64> = ndarray_npy::read_npy(&moved).unwrap();
    let column = j.column(element).to_owned() * step;
    let largest = column.iter().fold(0.0, |m: f64, c| m.max(c.abs()));
    let error = (&moved - &v - &column).iter().fold(0.0, |m: f64, e| m.max(e.abs()));
    // the second-order term of a change of 1 %
    assert!(error < 0.02 * largest, "{error:e} of {largest:e}");
}

/// The demo finds the finger: chain, pictures and report.
#[test]
fn demo_finds_the_fingers() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("demo");
    let answer = succeed(&["demo", "--out", text(&out), "--json"]);
    let json: Value = serde_json::from_str(&answer).unwrap();
    let scores = &json["scores"];
    // measured 0.4 mm and 0.90 / 0.89: one pixel is 3.1 mm
    assert!(scores["one_finger_position_error_m"].as_f64().unwrap() < 2e-3, "{scores}");
    assert!(scores["one_finger_correlation"].as_f64().unwrap() > 0.8, "{scores}");
    assert!(scores["two_fingers_correlation"].as_f64().unwrap() > 0.8, "{scores}");
    let images: Array3<f64> = ndarray_npy::read_npy(out.join("images.npy")).unwrap();
    assert_eq!(images.shape(), [40, 64, 64]);
    assert!(images[[0, 0, 0]].is_nan(), "corners lie outside the disc");
    for name in ["sheet.png", "truth_and_image.png", "movie.gif", "report.json", "frames.npy"] {
        assert!(std::fs::metadata(out.join(name)).unwrap().len() > 1000, "{name}");
    }
}

/// Frames written by the demo reconstruct to the demo's own images, bit for bit, and again.
#[test]
fn reconstruct_repeats_the_demo_from_its_files() {
    let folder = tempfile::tempdir().unwrap();
    let demo = folder.path().join("demo");
    succeed(&["demo", "--out", text(&demo)]);
    let (frames, reference) = (demo.join("frames.npy"), demo.join("reference.npy"));
    let run = |name: &str| {
        let out = folder.path().join(name);
        let (frames, reference) = (text(&frames), text(&reference));
        let arguments = ["--frames", frames, "--reference", reference, "--out", text(&out)];
        succeed(&[&["reconstruct", "paper-disc"], &arguments[..]].concat());
        std::fs::read(out.join("images.npy")).unwrap()
    };
    let first = run("a");
    assert!(first == run("b"), "two runs differ");
    assert!(first == std::fs::read(demo.join("images.npy")).unwrap(), "the demo differs");
}

/// A transposed table with the key that the refusal names gives the same images.
#[test]
fn frames_in_columns_need_their_key_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let demo = folder.path().join("demo");
    succeed(&["demo", "--out", text(&demo)]);
    let frames: Array2<f64> = ndarray_npy::read_npy(demo.join("frames.npy")).unwrap();
    let turned = folder.path().join("turned.npy");
    ndarray_npy::write_npy(&turned, &frames.t().to_owned()).unwrap();
    let (out, reference) = (folder.path().join("out"), demo.join("reference.npy"));
    let scene = succeed(&["plan", "paper-disc", "--print-scene"]);
    let scene = format!("{scene}\n[recording]\nframes_are = \"columns\"\n");
    let (keyed, plain) = (write_scene(folder.path(), &scene), text(&turned));
    let refused = common::refuse(&[
        "reconstruct",
        "paper-disc",
        "--frames",
        plain,
        "--reference",
        "0",
        "--out",
        text(&out),
    ]);
    assert!(refused.contains("frames_are = \"columns\""), "{refused}");
    succeed(&[
        "reconstruct",
        text(&keyed),
        "--frames",
        plain,
        "--reference",
        text(&reference),
        "--out",
        text(&out),
    ]);
    let [one, other] = [&out, &demo].map(|f| std::fs::read(f.join("images.npy")).unwrap());
    assert!(one == other);
}

/// A second run leaves nothing of the first beside its own results.
#[test]
fn results_of_an_earlier_run_do_not_stay() {
    let folder = tempfile::tempdir().unwrap();
    let scene = write_scene(folder.path(), SMALL);
    let (one, out) = (folder.path().join("one.csv"), folder.path().join("out"));
    succeed(&["forward", text(&scene), "--out", text(&one)]);
    let line = std::fs::read_to_string(&one).unwrap();
    let two = folder.path().join("two.csv");
    std::fs::write(&two, line.repeat(2)).unwrap();
    let run = |frames| {
        let arguments = ["--frames", text(frames), "--reference", "0", "--out", text(&out)];
        succeed(&[&["reconstruct", text(&scene)], &arguments[..]].concat());
        out.join("movie.gif").exists()
    };
    assert!(run(&two), "a sequence has a movie");
    assert!(!run(&one), "a single frame has none");
    assert!(out.join("report.json").exists());
}
