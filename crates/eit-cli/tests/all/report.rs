//! `eit report`, and how `eit plan` uses it.

use crate::common::*;

/// Page, tables and pictures; meaningful errors; choices that are the best of their table.
#[test]
fn the_report_of_a_scene_is_whole() {
    let (_folder, [out]) = Folder::with_paths(["report"]);
    let report = answer(format!("report --scenes single-frame --out {out}"));
    let scene = &report["scenes"][0];
    let solvers = scene["solvers"].as_array().unwrap();
    // two rasters: two rules of one-step images, two kinds of total variation at two gaps; and the
    // absolute method by two rules
    assert_eq!(solvers.len(), 2 * (2 + 2 * 2) + 2, "{}", scene["failures"]);
    for row in solvers {
        let number = |key: &str| number(row, key);
        assert!(number("relative_error") > 0.0, "{row}");
        let times = ["ms_a_frame_least", "ms_a_frame", "ms_a_frame_most"].map(number);
        assert!(0.0 < times[0] && times.is_sorted(), "{row}");
        assert!(number("floor_ms_a_frame") > 0.0, "{row}");
        assert!(number("cost_ms_a_frame") >= number("ms_a_frame"), "{row}");
        if row["status"] == "converged" && row["target_gap"].is_number() {
            assert!(number("proven_gap") <= number("target_gap"), "{row}");
        }
    }
    let choices = scene["choices"].as_array().unwrap();
    assert_eq!(choices.len(), 6, "three times, recorded and live");
    for choice in choices.iter().filter(|choice| !choice["choice"].is_null()) {
        let cost_ms = number(&choice["choice"], "cost_ms_a_frame");
        assert!(cost_ms <= 1e3 * number(choice, "budget_s"), "{choice}");
        assert!(choice["live"] == false || choice["choice"]["live"] == true, "{choice}");
    }
    check_forward(&report["forward"][0], "single-frame");
    let page = read_text(format!("{out}/report.html"));
    // the result in a sentence and a picture; the other pictures lie beside the page
    let result = "single-frame (one frame, nothing in time): relative error of the best images ";
    assert!(page.contains(result) && page.contains("an empty image has 100 %"), "{page}");
    assert!(!page.contains("<script"));
    assert_eq!(page.matches("data:image/png;base64").count(), 1);
    assert!(page.len() < 1_000_000, "{} bytes", page.len());
    assert!(page.contains("src=\"forward_single_frame.png\""));
    let size = |name: &str| read(format!("{out}/{name}")).len();
    assert!(["report.md", "inverse.csv", "forward.csv"].iter().all(|name| size(name) > 100));
    let images = ["images_single_frame_bell.png", "images_single_frame_pad.png"];
    for name in ["error_single_frame.png", "forward_single_frame.png"].into_iter().chain(images) {
        assert!(size(name) > 10_000, "{name}");
    }
    assert!(!exists(format!("{out}/incomplete.txt")));
}

/// Quadratic elements and finer meshes are better, the reference resolves each error, and chosen meshes meet theirs.
fn check_forward(skin: &Value, name: &str) {
    assert_eq!(skin["scene"], name);
    let meshes = skin["meshes"].as_array().unwrap();
    let median = |mesh: &Value, key: &str| number(&mesh[key], "median_s");
    for mesh in meshes {
        assert!(number(mesh, "error") >= 10.0 * number(skin, "reference_error"), "{mesh}");
        assert!(median(mesh, "voltages_time") < median(mesh, "time"), "{mesh}");
        assert!(number(mesh, "voltages_floor_s") <= number(mesh, "floor_s"), "{mesh}");
    }
    let of = |kind: &str, elements: &str| -> Vec<&Value> {
        meshes.iter().filter(|m| m["mesh"] == kind && m["elements"] == elements).collect()
    };
    for kind in ["even", "graded"] {
        let (linear, quadratic) = (of(kind, "linear"), of(kind, "quadratic"));
        assert_eq!(linear.len(), 2, "{name}, {kind}: {skin}");
        for better in quadratic {
            let on_it = linear.iter().find(|linear| linear["nodes"] == better["nodes"]).unwrap();
            // measured: 5 to 70 times
            assert!(number(better, "error") < 0.5 * number(on_it, "error"), "{better} {on_it}");
        }
    }
    let even = of("even", "linear");
    // round patches have twelve corners on both
    let most = if name == "patches" { 1.2 } else { 1.0 };
    let [coarse, fine] = [0, 1].map(|mesh| number(even[mesh], "error"));
    assert!(fine < most * coarse, "finer is better: {even:?}");
    for choice in skin["choices"].as_array().unwrap() {
        if let Some(error) = choice["choice"]["error"].as_f64() {
            assert!(error <= number(choice, "error"), "{choice}");
        }
    }
}

/// Skins without images: one compared with the series, one with a finer mesh, one with patches; then Ctrl-C.
#[cfg(unix)]
#[test]
fn an_interrupted_report_keeps_what_it_has() {
    let (_folder, [out]) = Folder::with_paths(["report"]);
    let names = ["hemisphere", "plate-with-hole", "patches"];
    let scenes = names.join(",");
    let child = emulated::spawn(format!("report --scenes {scenes},paper-disc-60 --out {out}"));
    // the last file of a set to be renamed into place
    let file = format!("{out}/report.json");
    wait_until(|| exists(&file) && read_text(&file).contains("\"scene\": \"patches\""));
    emulated::signal(&child, "-INT");
    says(&ended(&child.wait_with_output().unwrap(), 1), "3 of 4 scenes");
    says(&read_text(format!("{out}/report.html")), "Incomplete, without paper-disc-60");
    says(&read_text(format!("{out}/incomplete.txt")), "paper-disc-60");
    let report = parse(&read_text(file));
    has(&report, json!({ "missing": ["paper-disc-60"], "scenes": [] }));
    let skins = report["forward"].as_array().unwrap();
    assert_eq!(skins.len(), names.len());
    for (skin, name) in skins.iter().zip(names) {
        check_forward(skin, name);
        assert_eq!(skin["reference"] == "the mesh-free series", name == "hemisphere", "{skin}");
    }
    says(&read_text(format!("{out}/forward.csv")), names.join("…"));
    says(&read_text(format!("{out}/report.md")), "\n## Forward problem\n");
    let left = names_in(&out);
    let is_of_another = |name: &str| name == "inverse.csv" || name.starts_with(".eit-");
    assert!(!left.iter().any(|name| is_of_another(name)), "{left:?}");
}

#[test]
fn scenes_without_a_report_are_refused_before_any_work() {
    let out = Folder::new().path("report");
    let images = "--images: the report has no images of patches";
    refuse_each([
        (format!("report --scenes paper-disk --out {out}"), "paper-disk…stiff-contact"),
        (format!("report --images --scenes patches --out {out}"), images),
    ]);
}

/// A plan states the expected error, if it was measured, and what would be better in less time.
#[test]
fn a_plan_expects_what_was_measured_on_the_nearest_scene() {
    for scene in ["paper-disc", "stiff-contact", "high-contrast", "general-32", "single-frame"] {
        let plan = answer(format!("plan {scene}"));
        let expected = &plan["expected_images"];
        let like = if scene == "paper-disc" { "paper-disc-60" } else { scene };
        assert_eq!(expected["measured_on"], like);
        let error = number(expected, "relative_error");
        // a method worse than twice an empty image is not worth planning with
        assert!((0.01..2.0).contains(&error), "{scene}: {error}");
        let best = expected["best"].as_array().unwrap();
        assert_eq!(best.len(), 6, "three times, recorded and live");
        for stage in plan["stages"].as_array().unwrap() {
            assert!(number(stage, "expected_time_s") > 0.0, "{stage}");
        }
    }
}
