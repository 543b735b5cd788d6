//! Files with values that are not numbers, through the commands: missing values are accepted, and a frame
//! without any value does not interrupt detection.

use crate::common::{Folder, SMALL, answer, parse, read_text, succeed, touched_frames};
use ndarray::Array2;
use serde_json::Value;
use std::fmt::Write;

/// Frames with the finger, which stays: it appears in frame 101 of 200.
const TOUCHED: std::ops::Range<usize> = 101..200;
/// Frames without a value.
const EMPTY: [usize; 3] = [60, 120, 150];
/// Interval between frames with missing values.
const HOLED: usize = 7;

/// Frames with holes, as NPY and as CSV.
fn holed(folder: &Folder, scene: &str) -> [String; 2] {
    let (_, mut frames) = touched_frames(folder, scene);
    for (frame, mut values) in frames.rows_mut().into_iter().enumerate() {
        if EMPTY.contains(&frame) {
            values.fill(f64::NAN);
        } else if frame > 30 && frame % HOLED == 0 {
            // spread so that no electrode loses most of its measurements
            [frame % 40, (3 * frame + 17) % 40].iter().for_each(|&i| values[i] = f64::NAN);
        }
    }
    [folder.write_array("holed.npy", &frames), folder.write("holed.csv", table(&frames))]
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
fn valid_frames(csv: &str) -> (Vec<usize>, Vec<String>) {
    let text = read_text(csv);
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let column = |name: &str| header.iter().position(|word| *word == name).unwrap();
    let [frame, id, valid] = ["frame", "id", "valid"].map(column);
    let rows: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    // without those that only tell the state of the skin
    let rows: Vec<Vec<&str>> = rows.into_iter().filter(|row| !row[id].is_empty()).collect();
    let mut ids: Vec<String> = rows.iter().map(|row| row[id].to_owned()).collect();
    ids.sort_unstable();
    ids.dedup();
    let is_valid = |row: &&Vec<&str>| row[valid] == "true";
    (rows.iter().filter(is_valid).map(|row| row[frame].parse().unwrap()).collect(), ids)
}

/// The finger is detected from its second frame to the last in all but the empty frames, and in no frame
/// without it. Returns how many ids its touches get (this small skin splits the finger).
fn check(csv: &str, first: usize) -> usize {
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
    let folder = Folder::new();
    let scene = folder.write("scene.toml", format!("{SMALL}\n[recording]\nframe_rate_hz = 20.0\n"));
    let whole = folder.path("touched.npy");
    let files = holed(&folder, &scene);
    let mut ids = Vec::new();
    for file in [&whole, &files[0], &files[1]] {
        let out = folder.path("out");
        succeed(format!("reconstruct {scene} --frames {file} --out {out} --reference 0..30"));
        ids.push(check(&format!("{out}/touches.csv"), 0));
        assert_eq!(faults(&parse(&read_text(format!("{out}/report.json")))), 0);

        // as a recording
        let (recording, out) = (folder.path("recording.mcap"), folder.path("again"));
        succeed(format!("convert {file} --out {recording} --scene {scene}"));
        let replay = format!("replay {scene} --from {recording} --out {out}");
        let answer = answer(format!("{replay} --reference-frames 30"));
        assert_eq!(answer["frames"], 170, "{answer}");
        assert_eq!(answer["faulty_electrodes"].as_array().unwrap().len(), 0, "{answer}");
        ids.push(check(&format!("{out}/touches.csv"), 30));
        std::fs::remove_file(&recording).unwrap();
    }
    // missing values do not change ids
    assert!(ids.iter().all(|count| *count == ids[0]), "{ids:?}");
}
