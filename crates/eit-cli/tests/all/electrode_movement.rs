//! `reconstruction.electrode_movement_m`: displacements of electrodes as nuisance parameters, on the
//! simulated fabric with its compliant rim.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

use crate::common::{SMALL, refuse, succeed, text, write_scene};
use eit_hw::Quality;
use eit_hw::capture::{CaptureSettings, CaptureWriter};
use ndarray::{Array1, Array2, Array3, Axis};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// The value in the scenes: twice the mean movement in these recordings.
const KEY: &str = "electrode_movement_m = 0.2e-3";

/// A scene with keys under `[reconstruction]`.
fn with(scene: &str, keys: &str) -> String {
    assert!(!scene.contains("[reconstruction]"));
    format!("{scene}\n[reconstruction]\npixels = 32\n{keys}\n")
}

/// A recording of the simulated fabric, and its scene.
fn simulated(folder: &Path) -> (PathBuf, String) {
    let plain = succeed(&["plan", "paper-disc", "--print-scene"]);
    let (scene, out) = (write_scene(folder, &plain), folder.join("sim"));
    let arguments = ["simulate", text(&scene), "--script", "stroking", "--out", text(&out)];
    succeed(&[&arguments[..], &["--nodes", "2500", "--frames", "45", "--seed", "7"]].concat());
    let scene = std::fs::read_to_string(out.join("scene.toml")).unwrap();
    (out, scene)
}

/// The same frames as a recording whose frame 40 has a value that its instrument flags.
fn with_a_bad_value(sim: &Path) -> PathBuf {
    let (good, bad) = (sim.join("good.mcap"), sim.join("bad.mcap"));
    succeed(&["convert", text(&sim.join("frames.npy")), "--out", text(&good)]);
    let capture = eit_hw::capture::read(&good).unwrap();
    let session = capture.sessions().next().unwrap();
    let settings = CaptureSettings::default();
    let mut writer = CaptureWriter::create(&bad, session, settings).unwrap();
    for (number, frame) in capture.frames().enumerate() {
        let mut frame = frame.clone();
        if number == 40 {
            frame.quality[17] = Quality::SATURATED;
        }
        writer.frame(&frame).unwrap();
    }
    writer.finish().unwrap();
    bad
}

/// Reconstructs a scene in the folder of its frames; `report.json` and images.
fn reconstruct(folder: &Path, scene: &str, method: &str) -> (Value, Array3<f64>) {
    let file = folder.join("tried.toml");
    std::fs::write(&file, scene).unwrap();
    let out = folder.join("out");
    succeed(&["reconstruct", text(&file), "--method", method, "--out", text(&out)]);
    let report = std::fs::read_to_string(out.join("report.json")).unwrap();
    let images = ndarray_npy::read_npy(out.join("images.npy")).unwrap();
    (serde_json::from_str(&report).unwrap(), images)
}

/// Time of the stages of this name, seconds.
fn time_s(report: &Value, name: &str) -> f64 {
    let stages = report["stages"].as_array().unwrap();
    let of_name = stages.iter().filter(|stage| stage["stage"] == name);
    of_name.map(|stage| stage["time_s"].as_f64().unwrap()).sum()
}

/// Fraction of the images' energy farther than 40 mm from the finger, over the frames with one.
fn energy_away(sim: &Path, images: &Array3<f64>) -> f64 {
    let truth = std::fs::read_to_string(sim.join("touches.csv")).unwrap();
    let pixel_m = 0.2 / images.dim().1 as f64;
    let (mut away, mut all) = (0.0, 0.0);
    for line in truth.lines().skip(1) {
        let number = |column: usize| line.split(',').nth(column).unwrap().parse::<f64>().unwrap();
        let [frame, x_m, y_m] = [0, 3, 4].map(number);
        for ((row, column), value) in images.index_axis(Axis(0), frame as usize).indexed_iter() {
            let x = (column as f64 + 0.5) * pixel_m - 0.1 - x_m;
            let y = 0.1 - (row as f64 + 0.5) * pixel_m - y_m;
            let energy = if value.is_finite() { value * value } else { 0.0 };
            all += energy;
            away += if x.hypot(y) > 0.04 { energy } else { 0.0 };
        }
    }
    away / all
}

/// Images and touches of one recording, with bad values too, live as recorded.
#[test]
fn images_and_touches_are_made_of_what_is_left() {
    let folder = tempfile::tempdir().unwrap();
    let (sim, scene) = simulated(folder.path());
    let (plain, came) = reconstruct(&sim, &with(&scene, ""), "gauss-newton");
    let (report, images) = reconstruct(&sim, &with(&scene, KEY), "gauss-newton");
    assert_eq!(plain["electrode_movement_m"], Value::Null);
    assert_eq!(report["electrode_movement_m"], 0.2e-3);
    assert_eq!(report["hyperparameter_rule"], "noise figure 1 of the data with movement");
    assert!(
        time_s(&report, "electrode movement") > 0.0 && time_s(&plain, "electrode movement") == 0.0
    );
    // one finger; touches allow for movement whether images do or not
    for report in [&report, &plain] {
        assert_eq!(
            (&report["touches"]["count"], &report["touches"]["most_at_once"]),
            (&1.into(), &1.into())
        );
    }
    let norm = |images: &Array3<f64>| {
        images.iter().filter(|v| v.is_finite()).map(|v| v * v).sum::<f64>().sqrt()
    };
    let taken = norm(&(&came - &images)) / norm(&came);
    // mostly spots at electrodes; measured 0.19 and 0.05: the ringing of one-step images remains
    let [before, after] = [&came, &images].map(|images| energy_away(&sim, images));
    assert!(before > 0.12 && after < 0.5 * before, "{before} {after}");
    // the spots are part of the image, and most of it remains
    assert!((0.05..0.9).contains(&taken), "{taken}");

    // less movement than any changes nothing: the image of equal weights and the same prior
    let (_, same) =
        reconstruct(&sim, &with(&scene, "electrode_movement_m = 1e-12"), "gauss-newton");
    let off = norm(&(&came - &same)) / norm(&came);
    assert!(off < 1e-6, "{off}");

    // measurements are mixed: a frame that lacks one of them has no image, the others keep theirs
    with_a_bad_value(&sim);
    let scene = scene.replace("frames.npy", "bad.mcap");
    let (report, holed) = reconstruct(&sim, &with(&scene, KEY), "gauss-newton");
    assert!(report["notes"].to_string().contains("1 of 45 frames have bad values"), "{report}");
    let zero =
        |frame: usize| holed.index_axis(Axis(0), frame).iter().all(|v| *v == 0.0 || v.is_nan());
    assert!(zero(40) && !zero(39));
    let row = |images: &Array3<f64>| images.index_axis(Axis(0), 39).row(16).to_owned();
    assert_eq!(row(&holed), row(&images));
}

/// A patch that was moved, on a new mesh and with no other change, leaves hardly any image: 0.05 of it for
/// one-step, 0.08 for total variation. The rest is due to the other mesh.
#[test]
fn a_moved_patch_is_no_touch() {
    let folder = tempfile::tempdir().unwrap();
    let plain = succeed(&["plan", "patches", "--print-scene"]);
    let place = "[0.025, -0.025]";
    assert_eq!(plain.matches(place).count(), 1);
    let voltages = |scene: &str| -> Array1<f64> {
        let (scene, out) = (write_scene(folder.path(), scene), folder.path().join("v.npy"));
        succeed(&["forward", text(&scene), "--out", text(&out)]);
        ndarray_npy::read_npy(&out).unwrap()
    };
    // 1.7 mm of 50 between neighbours
    let (still, moved) = (voltages(&plain), voltages(&plain.replace(place, "[0.0265, -0.0243]")));
    let frames = ndarray::stack![Axis(0), still, moved, moved];
    ndarray_npy::write_npy(folder.path().join("frames.npy"), &frames).unwrap();
    let recording =
        "[recording]\nfile = \"frames.npy\"\nreference = 0\n[noise]\nadditive_v = 1e-5\n";
    let scene = format!("{plain}\n{recording}");
    for method in ["gauss-newton", "tv"] {
        let [came, left] = ["", "electrode_movement_m = 1e-3"].map(|keys| {
            let (_, images) = reconstruct(folder.path(), &with(&scene, keys), method);
            let last = images.index_axis(Axis(0), 2).to_owned();
            last.iter().filter(|v| v.is_finite()).map(|v| v * v).sum::<f64>().sqrt()
        });
        assert!(came > 0.0 && left < 0.2 * came, "{method}: {came:e} {left:e}");
    }
}

/// The same live, frame by frame; a bad frame is counted and skipped.
#[test]
fn a_stream_of_frames_loses_what_electrodes_leave() {
    let folder = tempfile::tempdir().unwrap();
    let (sim, _) = simulated(folder.path());
    let recording = with_a_bad_value(&sim);
    let scene = succeed(&["plan", "paper-disc", "--print-scene"]);
    let replay = |keys: &str| {
        let (file, out) = (folder.path().join("live.toml"), folder.path().join("out"));
        let rate = "[recording]\nframe_rate_hz = 20.0\n";
        std::fs::write(&file, format!("{}\n{rate}", with(&scene, keys))).unwrap();
        let arguments = ["replay", text(&file), "--from", text(&recording), "--out", text(&out)];
        let answer = succeed(&[&arguments[..], &["--reference-frames", "20", "--json"]].concat());
        let images: Array3<f64> = ndarray_npy::read_npy(out.join("images.npy")).unwrap();
        (serde_json::from_str::<Value>(&answer).unwrap(), images)
    };
    for method in ["gauss-newton", "tv"] {
        let (plain, came) = replay(&format!("method = \"{method}\""));
        let (answer, left) = replay(&format!("method = \"{method}\"\n{KEY}"));
        let of = &answer["images"];
        assert!(of["how"].to_string().contains("electrodes may move by 0.20 mm"), "{answer}");
        assert_eq!((&of["lost"], &plain["images"]["lost"]), (&1.into(), &0.into()), "{answer}");
        assert_eq!((left.dim(), came.dim()), ((25, 32, 32), (25, 32, 32)));
        assert!(left.index_axis(Axis(0), 24) != came.index_axis(Axis(0), 24));
        let touches = |answer: &Value| answer["touches"].as_u64().unwrap();
        assert!(touches(&answer) > 0 && touches(&answer) <= touches(&plain), "{answer} {plain}");
    }
}

/// Rejected before any work, with the reason.
#[test]
fn what_cannot_be_together_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let out = text(&out);
    let key = |keys: &str| write_scene(folder.path(), &with(SMALL, keys));
    let says = refuse(&["plan", text(&key("electrode_movement_m = -1.0"))]);
    assert!(says.contains("electrode_movement_m is -1: it must be finite and above"), "{says}");
    let absolute = format!("method = \"gauss-newton-absolute\"\n{KEY}");
    let says = refuse(&["plan", text(&key(&absolute))]);
    assert!(says.contains("movement is removed from differences"), "{says}");
    let quadratic = SMALL.replace("[mesh]", "[mesh]\nelements = \"quadratic\"");
    let scene = write_scene(folder.path(), &with(&quadratic, KEY));
    let says = refuse(&["plan", text(&scene)]);
    assert!(says.contains("those of linear elements"), "{says}");

    let scene = key(KEY);
    let says = refuse(&["train", text(&scene), "--out", &format!("{out}.safetensors")]);
    let why = match cfg!(feature = "train") {
        true => "`eit train` does not support",
        false => "built without training",
    };
    assert!(says.contains(why), "{says}");
    let images = folder.path().join("images.npy");
    ndarray_npy::write_npy(&images, &Array3::<f64>::zeros((1, 32, 32))).unwrap();
    let says = refuse(&["denoise", text(&scene), "--images", text(&images), "--out", out]);
    assert!(says.contains("`eit denoise` does not support"), "{says}");

    let voltages = folder.path().join("v.npy");
    succeed(&["forward", text(&scene), "--out", text(&voltages)]);
    let still: ndarray::Array1<f64> = ndarray_npy::read_npy(&voltages).unwrap();
    let frames = Array2::from_shape_fn((4, still.len()), |(f, i)| {
        still[i] * (1.0 + 1e-3 * f as f64 * (i as f64).sin())
    });
    ndarray_npy::write_npy(&voltages, &frames).unwrap();
    let made = |scene: &Path, method: &str| {
        let from = ["--frames", text(&voltages), "--reference", "0", "--method", method];
        refuse(&[&["reconstruct", text(scene), "--out", out][..], &from].concat())
    };
    let says = made(&scene, "gauss-newton");
    assert!(says.contains("needs the noise: state [noise]"), "{says}");
    let scene = key(&format!("{KEY}\n[noise]\nadditive_v = 1e-6"));
    let says = made(&scene, "gauss-newton-absolute");
    assert!(says.contains("before a linear method"), "{says}");
}

/// The plan has the stage, or says why it is omitted; its predicted time is within a wide factor of the real
/// one (the machine is loaded: see the report for accurate values).
#[test]
fn the_plan_shows_the_stage_or_why_it_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let plan = |keys: &str| -> Value {
        let scene = write_scene(folder.path(), &with(SMALL, keys));
        serde_json::from_str(&succeed(&["plan", text(&scene), "--json"])).unwrap()
    };
    let (plain, moves) = (plan(""), plan(KEY));
    let stage = |plan: &Value| {
        let stages = plan["stages"].as_array().unwrap();
        stages.iter().find(|stage| stage["stage"] == "electrode movement").cloned()
    };
    let left_out = |plan: &Value| plan["left_out"].to_string().contains("electrode movement");
    assert!(stage(&plain).is_none() && left_out(&plain));
    let stage = stage(&moves).unwrap();
    assert!(!left_out(&moves));
    assert!(stage["size"].as_str().unwrap().starts_with("[40, 16], taken out of [40, "), "{stage}");
    assert!(stage["why"].as_str().unwrap().contains("0.20 mm"), "{stage}");
    assert!(stage["expected_time_s"].as_f64().unwrap() > 0.0);

    // a mesh chosen for accuracy has elements with known derivatives along displacements
    let accurate = SMALL.replace("edge_m = 0.012", "required_accuracy = 3e-3");
    let scene = write_scene(folder.path(), &with(&accurate, KEY));
    let out = folder.path().join("m.msh");
    let mesh = succeed(&["mesh", text(&scene), "--out", text(&out), "--json"]);
    let mesh: Value = serde_json::from_str(&mesh).unwrap();
    assert_eq!(mesh["elements"], "linear", "{mesh}");
}
