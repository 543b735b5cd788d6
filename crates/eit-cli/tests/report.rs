//! `eit report` and what `eit plan` makes of it.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "tests")]

mod common;

use common::{refuse, succeed, text};
use serde_json::Value;

fn json(answer: &str) -> Value {
    serde_json::from_str(answer).unwrap()
}

/// The quick report of a scene: page, tables and pictures; errors that mean something; choices that
/// are the best of their table.
#[test]
fn the_report_of_a_scene_is_whole() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report");
    let arguments =
        ["report", "--quick", "--scenes", "single-frame", "--out", text(&out), "--json"];
    let report = json(&succeed(&arguments));
    let scene = &report["scenes"][0];
    let solvers = scene["solvers"].as_array().unwrap();
    // two rasters: two rules of one-step images, two kinds of total variation at two gaps; and the
    // absolute method by two rules
    assert_eq!(solvers.len(), 2 * (2 + 2 * 2) + 2, "{}", scene["failures"]);
    for row in solvers {
        let number = |key: &str| row[key].as_f64().unwrap();
        assert!(number("relative_error") > 0.0, "{row}");
        let [least, median, most] =
            ["ms_a_frame_least", "ms_a_frame", "ms_a_frame_most"].map(number);
        assert!(0.0 < least && least <= median && median <= most, "{row}");
        assert!(number("floor_ms_a_frame") > 0.0, "{row}");
        assert!(number("cost_ms_a_frame") >= median, "{row}");
        if row["status"] == "converged" && row["target_gap"].is_number() {
            assert!(number("proven_gap") <= number("target_gap"), "{row}");
        }
    }
    let choices = scene["choices"].as_array().unwrap();
    assert_eq!(choices.len(), 6, "three times, recorded and live");
    for choice in choices.iter().filter(|choice| !choice["choice"].is_null()) {
        let cost_ms = choice["choice"]["cost_ms_a_frame"].as_f64().unwrap();
        assert!(cost_ms <= 1e3 * choice["budget_s"].as_f64().unwrap(), "{choice}");
        assert!(choice["live"] == false || choice["choice"]["live"] == true, "{choice}");
    }
    let meshes = scene["forward"]["meshes"].as_array().unwrap();
    let errors: Vec<f64> = meshes.iter().map(|m| m["error"].as_f64().unwrap()).collect();
    assert!(errors.windows(2).all(|pair| pair[1] < pair[0]), "finer is better: {errors:?}");
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("data:image/png;base64") && !page.contains("<script"));
    for name in ["report.md", "inverse.csv", "forward.csv", "plan.csv", "error_single_frame.png"] {
        assert!(std::fs::metadata(out.join(name)).unwrap().len() > 100, "{name}");
    }
}

#[test]
fn unknown_scenes_and_interpreters_are_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report");
    let error = refuse(&["report", "--scenes", "paper-disk", "--out", text(&out)]);
    assert!(error.contains("paper-disk") && error.contains("stiff-contact"), "{error}");
    let error = refuse(&["report", "--peers", "./no-python", "--out", text(&out)]);
    assert!(error.contains("no-python"), "{error}");
}

/// A plan tells the error to expect, where it was measured, and what would be better in less time.
#[test]
fn a_plan_expects_what_was_measured_on_the_nearest_scene() {
    for (scene, like) in [
        ("paper-disc", "paper-disc-60"),
        ("stiff-contact", "stiff-contact"),
        ("high-contrast", "high-contrast"),
        ("general-32", "general-32"),
        ("single-frame", "single-frame"),
    ] {
        let plan = json(&succeed(&["plan", scene, "--json"]));
        let expected = &plan["expected_images"];
        assert_eq!(expected["measured_on"], like);
        let error = expected["relative_error"].as_f64().unwrap();
        // worse than twice an empty image is no method to plan with
        assert!((0.01..2.0).contains(&error), "{scene}: {error}");
        let best = expected["best"].as_array().unwrap();
        assert_eq!(best.len(), 6, "three times, recorded and live");
        for stage in plan["stages"].as_array().unwrap() {
            assert!(stage["expected_time_s"].as_f64().unwrap() > 0.0, "{stage}");
        }
    }
}

/// Every built-in scene is a scene file to start from.
#[test]
fn built_in_scenes_print_and_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let scenes = ["paper-disc", "stiff-contact", "high-contrast", "general-32", "single-frame"];
    for scene in scenes {
        let file = folder.path().join(format!("{scene}.toml"));
        std::fs::write(&file, succeed(&["plan", scene, "--print-scene"])).unwrap();
        let voltages = |scene: &str, name: &str| {
            let out = folder.path().join(name);
            succeed(&["forward", scene, "--out", text(&out)]);
            std::fs::read_to_string(out).unwrap()
        };
        assert_eq!(voltages(scene, "a.csv"), voltages(text(&file), "b.csv"), "{scene}");
    }
}

/// Currents on all electrodes at once leave no electrode undriven: the scene must know.
#[test]
fn trigonometric_currents_keep_driven_electrodes() {
    let folder = tempfile::tempdir().unwrap();
    let text_of = succeed(&["plan", "general-32", "--print-scene"]);
    let file = folder.path().join("scene.toml");
    let without = text_of.replace("driven_electrodes = \"keep\"", "driven_electrodes = \"drop\"");
    std::fs::write(&file, without).unwrap();
    let error = refuse(&["plan", text(&file)]);
    assert!(error.contains("trigonometric") && error.contains("keep"), "{error}");
}
