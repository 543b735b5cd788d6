//! `eit demo` as a user runs it, and obstacles it may meet.
#![cfg(unix)]

use crate::common::emulated::{signal, spawn};
use crate::common::*;

/// Every file that an answer names exists; returns how many.
fn files_exist(out: &str, answer: &Value) -> usize {
    let files = answer["files"].as_array().unwrap();
    for file in files {
        assert!(exists(format!("{out}/{}", file.as_str().unwrap())), "{file}");
    }
    files.len()
}

/// Files that a page shows.
fn shown(page: &str) -> Vec<&str> {
    page.split("<img src=\"").skip(1).map(|p| p.split('"').next().unwrap()).collect()
}

/// Every result exists, and the page needs no other files.
#[test]
fn the_demo_finds_the_fingers_and_replays_to_the_bit() {
    let (folder, [out]) = Folder::with_paths(["demo"]);
    let answer = answer(format!("demo --quick --out {out}"));
    for experiment in answer["experiments"].as_array().unwrap() {
        let judged = &experiment["judged"];
        assert_eq!(experiment["line"], "a pseudo-terminal", "{experiment}");
        // fingers wait until the reference has been taken; how many frames come in between depends on the machine's load
        assert!(number(experiment, "frames") >= 30.0, "{experiment}");
        // measured 28 of 29 and 56 of 58, 3.7 and 2.1 mm, none invented, 0.48 and 0.31 of the error with a
        // U-net trained on other pixels; the first frame of a contact is not reported
        let [fingers, found] = ["fingers", "found"].map(|key| number(judged, key));
        assert!(fingers >= 29.0 && found >= 0.9 * fingers, "{judged}");
        assert!(10.0 * number(judged, "invented") <= fingers, "{judged}");
        assert!(number(judged, "position_error_m") < 6e-3, "{judged}");
        assert!(number(judged, "error_over_raw") < 0.8, "{judged}");
        // proven as the scene requires, but for a few images whose time was over before, so that no frame waits
        assert!(number(&experiment["images"], "worst_gap") <= 0.1, "{experiment}");
        assert!(number(&experiment["images"], "unfinished") <= 3.0, "{experiment}");
    }
    files_exist(&out, &answer);
    let page = read_text(format!("{out}/report.html"));
    // overview and tracks are in the page, the others and the movies beside it
    assert_eq!(page.matches("data:image/png;base64,").count(), 3);
    assert!(page.len() < 1_000_000 && !page.contains("data:image/gif"), "{} bytes", page.len());
    let named = shown(&page);
    let mut files = named.iter().filter(|name| !name.starts_with("data:"));
    assert_eq!(files.clone().count(), 9, "{named:?}");
    assert!(files.all(|name| exists(format!("{out}/{name}"))), "{named:?}");
    for never in ["http:", "https:", "<script", "src=\"/", "href=\"/"] {
        assert!(!page.contains(never), "{never}");
    }
    for experiment in ["one-finger", "two-fingers"] {
        let again = folder.path(experiment);
        succeed(format!("replay {out}/scene.toml --from {out}/{experiment}.mcap --out {again}"));
        assert_eq!(read_array::<Ix3>(format!("{again}/images.npy")).dim().1, 32);
        for file in ["images.npy", "raw.npy", "touches.csv"] {
            let made = read(format!("{out}/{experiment}/{file}"));
            assert!(made == read(format!("{again}/{file}")), "{experiment}: {file} differs");
        }
    }
}

/// The first frames of the paper's experiments: pictures with their seeds, errors halved, fingers and pressures found.
#[test]
fn the_paper_as_it_is_printed() {
    let (folder, [out]) = Folder::with_paths(["paper"]);
    let answer = answer(format!("demo --paper --quick --out {out}"));
    for (k, experiment) in answer["experiments"].as_array().unwrap().iter().enumerate() {
        assert_eq!(["frame_rate_hz", "frames"].map(|key| number(experiment, key)), [1.0, 45.0]);
        let errors = &experiment["relative_error"];
        let [paper, ours] = ["equation_7", "defaults"].map(|form| number(errors, form));
        assert!(ours < 0.5 && ours < paper && paper < 1.2, "{experiment}");
        for (training, made) in experiment["trainings"].as_array().unwrap().iter().enumerate() {
            // "reduced by more than half", also on what a net was not trained on
            assert!(number(made, "to_wanted") < 0.5, "{experiment}");
            assert!(training != k || number(made, "fingers_shown") > 0.9, "{experiment}");
        }
        // force over the area in the image, against force over the contact
        assert!(number(&experiment["pressure"], "error") < 0.3, "{experiment}");
    }
    let page = read_text(format!("{out}/report.html"));
    let named = shown(&page);
    assert_eq!(named.len(), 20, "{named:?}");
    assert!(named.iter().all(|name| exists(format!("{out}/{name}"))), "{named:?}");
    says(&page, "seed 1…439 pairs…273 pairs…reduced by more than half…--pairs 439");
    // again in the same folder, but not over files of others
    folder.write("paper/notes.txt", "mine");
    says(&refuse(format!("demo --paper --quick --out {out}")), "notes.txt");
}

/// Files of others, even a scene, are named and kept, also with --force and through Ctrl-C, after which the demo's own are
/// complete, listed, and accepted by the next one.
#[test]
fn a_folder_is_kept_through_ctrl_c_and_tcp_stands_in() {
    let (folder, [out]) = Folder::with_paths(["thesis"]);
    let names = ["a.txt", "b.txt", "c.txt", "d.txt", "scene.toml"];
    std::fs::create_dir(&out).unwrap();
    names.iter().for_each(|name| _ = folder.write(&format!("thesis/{name}"), "mine"));
    let said = refuse(format!("demo --quick --out {out}"));
    says(&said, "contains a.txt, b.txt, c.txt and 2 more…--force");
    let is_kept = |name: &&str| read_text(format!("{out}/{name}")) == "mine";
    assert!(names.iter().all(is_kept), "{names:?}");
    std::fs::remove_file(format!("{out}/scene.toml")).unwrap();

    // the whole demo takes more than half a minute: the signal arrives in the middle on any computer
    let child = spawn(format!("demo --force --out {out} --json"));
    let recording = format!("{out}/one-finger.mcap");
    wait_until(|| exists(&recording));
    signal(&child, "-INT");
    let output = child.wait_with_output().unwrap();
    ended(&output, 0);
    let answer = parse(&stdout(&output));
    assert_eq!(answer["interrupted"], true, "{answer}");
    let named = files_exist(&out, &answer);
    assert_eq!(names_in(&out).len(), named + 4, "nothing that is not named");
    let capture = eit_hw::capture::read(&recording).unwrap();
    assert!(!capture.damage.unfinished, "its end is written");
    let recorded = capture.frames().count();
    let seen = answer["experiments"][0]["frames"].as_u64().unwrap() as usize;
    assert!(seen < 377, "{answer}");
    // the first 40 are the reference
    assert!((seen..=seen + 40).contains(&recorded), "{recorded} recorded, {seen} seen");
    if seen > 0 {
        let images: Array3<f64> = read_array(format!("{out}/one-finger/images.npy"));
        assert_eq!(images.dim(), (seen, 64, 64));
    }
    let page = format!("{out}/report.html");
    assert!(!exists(&page));

    // the demo's own files are accepted, the others still are not
    says(&refuse(format!("demo --quick --out {out}")), "contains a.txt, b.txt, c.txt and 1 more");
    assert!(names[..4].iter().all(is_kept), "{names:?}");
    names[..4].iter().for_each(|name| std::fs::remove_file(format!("{out}/{name}")).unwrap());
    let mut demo = command(format!("demo --quick --out {out}"));
    let output = demo.env("TMPDIR", folder.path("nowhere")).output().unwrap();
    ended(&output, 0);
    says(&stdout(&output), "TCP on this computer, because no pseudo-terminal was available");
    assert!(exists(&page));
}
