//! Files with values that are not numbers, through the commands: missing values are accepted, and a frame
//! without any value does not interrupt detection.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

use crate::common::{SMALL, succeed, text, touched_frames, write_scene};
use ndarray::Array2;
use serde_json::Value;
use std::fmt::Write;
use std::path::Path;

/// Frames with the finger, which stays: it appears in frame 101 of 200.
const TOUCHED: std::ops::Range<usize> = 101..200;
/// Frames without a value.
const EMPTY: [usize; 3] = [60, 120, 150];
/// Interval between frames with missing values.
const HOLED: usize = 7;

/// Frames with holes, as NPY and as CSV.
fn holed(folder: &Path, scene: &Path) -> [std::path::PathBuf; 2] {
    let (_, mut frames) = touched_frames(folder, scene);
    for (frame, mut values) in frames.rows_mut().into_iter().enumerate() {
        if EMPTY.contains(&frame) {
            values.fill(f64::NAN);
        } else if frame > 30 && frame % HOLED == 0 {
            // spread so that no electrode loses most of its measurements
            [frame % 40, (3 * frame + 17) % 40].iter().for_each(|&i| values[i] = f64::NAN);
        }
    }
    let [npy, csv] = ["holed.npy", "holed.csv"].map(|name| folder.join(name));
    ndarray_npy::write_npy(&npy, &frames).unwrap();
    std::fs::write(&csv, table(&frames)).unwrap();
    [npy, csv]
}

fn table(frames: &Array2<f64>) -> String {
    let mut text = String::new();
    for row in frames.rows() {
        let words: Vec<String> = row.iter().map(|value| format!("{value:e}")).collect();
        writeln!(text, "{}", words.join(",")).unwrap();
    }
    text
}

/// Frames of a touch list with a valid touch, and the ids of all touches.
fn valid_frames(csv: &Path) -> (Vec<usize>, Vec<String>) {
    let text = std::fs::read_to_string(csv).unwrap();
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let column = |name: &str| header.iter().position(|word| *word == name).unwrap();
    let [frame, id, valid] = ["frame", "id", "valid"].map(column);
    let rows: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    let mut ids: Vec<String> = rows.iter().map(|row| row[id].to_owned()).collect();
    ids.sort_unstable();
    ids.dedup();
    let is_valid = |row: &&Vec<&str>| row[valid] == "true";
    (rows.iter().filter(is_valid).map(|row| row[frame].parse().unwrap()).collect(), ids)
}

/// The finger is detected from its second frame to the last in all but the empty frames, and in no frame
/// without it. Returns how many ids its touches get (this small skin splits the finger).
fn check(csv: &Path, first: usize) -> usize {
    let (frames, ids) = valid_frames(csv);
    let found: Vec<usize> = frames.iter().map(|frame| frame + first).collect();
    let wanted: Vec<usize> = TOUCHED.skip(1).filter(|frame| !EMPTY.contains(frame)).collect();
    let missed: Vec<_> = wanted.iter().filter(|frame| !found.contains(frame)).collect();
    assert!(missed.is_empty(), "{csv:?}: no touch in {missed:?}");
    assert!(found.iter().all(|frame| TOUCHED.contains(frame)), "{csv:?}: {found:?}");
    ids.len()
}

fn faults(report: &Value) -> usize {
    let touches = &report["touches"]["faulty_electrodes"];
    touches.as_array().unwrap_or_else(|| panic!("{report}")).len()
}

#[test]
fn values_that_are_no_numbers_are_missing() {
    let folder = tempfile::tempdir().unwrap();
    let scene =
        write_scene(folder.path(), &format!("{SMALL}\n[recording]\nframe_rate_hz = 20.0\n"));
    let whole = folder.path().join("touched.npy");
    let files = holed(folder.path(), &scene);
    let mut ids = Vec::new();
    for file in [&whole, &files[0], &files[1]] {
        let out = folder.path().join("out");
        let fixed = ["reconstruct", text(&scene), "--frames", text(file), "--out", text(&out)];
        succeed(&[&fixed[..], &["--reference", "0..30"]].concat());
        ids.push(check(&out.join("touches.csv"), 0));
        let report = std::fs::read_to_string(out.join("report.json")).unwrap();
        assert_eq!(faults(&serde_json::from_str(&report).unwrap()), 0);

        // as a recording
        let recording = file.with_extension("mcap");
        succeed(&["convert", text(file), "--out", text(&recording), "--scene", text(&scene)]);
        let out = folder.path().join("again");
        let fixed = ["replay", text(&scene), "--from", text(&recording), "--out", text(&out)];
        let answer = succeed(&[&fixed[..], &["--reference-frames", "30", "--json"]].concat());
        let answer: Value = serde_json::from_str(&answer).unwrap();
        assert_eq!(answer["frames"], 170, "{answer}");
        assert_eq!(answer["faulty_electrodes"].as_array().unwrap().len(), 0, "{answer}");
        ids.push(check(&out.join("touches.csv"), 30));
        std::fs::remove_file(&recording).unwrap();
    }
    // missing values do not change ids
    assert!(ids.iter().all(|count| *count == ids[0]), "{ids:?}");
}
