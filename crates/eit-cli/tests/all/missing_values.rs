//! Missing values are accepted in all files, and a frame without any value does not interrupt detection.

use crate::common::*;
use std::collections::BTreeSet;

/// Frames with the finger, which stays: it appears in frame 101 of 200.
const TOUCHED: std::ops::Range<usize> = 101..200;
/// Frames without a value.
const EMPTY: [usize; 3] = [60, 120, 150];

/// Frames with holes, as NPY and as CSV.
fn holed(folder: &Folder) -> [String; 2] {
    let mut frames = touched_frames(folder).1.clone();
    for (frame, mut values) in frames.rows_mut().into_iter().enumerate() {
        if EMPTY.contains(&frame) {
            values.fill(f64::NAN);
        } else if frame > 30 && frame % 7 == 0 {
            // spread so that no electrode loses most of its measurements
            [frame % 40, (3 * frame + 17) % 40].iter().for_each(|&i| values[i] = f64::NAN);
        }
    }
    [folder.write_array("holed.npy", &frames), folder.write("holed.csv", table(&frames))]
}

/// The finger is detected from its second frame to the last in all but the empty frames, and in no frame
/// without it. Returns how many ids its touches get (this small skin splits the finger).
fn check(csv: &str, first: usize) -> usize {
    let rows = rows(csv);
    // without those that only tell the state of the skin
    let touches = || rows.iter().filter(|row| !row["id"].is_empty());
    let found: BTreeSet<usize> = touches()
        .filter(|row| row["valid"] == "true")
        .map(|row| first + row["frame"].parse::<usize>().unwrap())
        .collect();
    let mut wanted = TOUCHED.skip(1).filter(|frame| !EMPTY.contains(frame));
    assert!(wanted.all(|frame| found.contains(&frame)), "{csv:?}: {found:?}");
    assert!(found.iter().all(|frame| TOUCHED.contains(frame)), "{csv:?}: {found:?}");
    touches().map(|row| &row["id"]).collect::<BTreeSet<_>>().len()
}

#[test]
fn values_that_are_no_numbers_are_missing() {
    let (folder, scene) = Folder::with_scene("[recording]\nframe_rate_hz = 20.0\n");
    let files = holed(&folder);
    let mut ids = Vec::new();
    for file in [&folder.path("touched.npy"), &files[0], &files[1]] {
        let out = folder.path("out");
        succeed(format!("reconstruct {scene} --frames {file} --out {out} --reference 0..30"));
        ids.push(check(&format!("{out}/touches.csv"), 0));
        let report = parse(&read_text(format!("{out}/report.json")));
        has(&report["touches"], json!({ "faulty_electrodes": [] }));
        // as a recording
        let (recording, out) = (folder.path("recording.mcap"), folder.path("again"));
        succeed(format!("convert {file} --out {recording} --scene {scene}"));
        let replay = format!("replay {scene} --from {recording} --out {out}");
        let answer = answer(format!("{replay} --reference-frames 30"));
        has(&answer, json!({ "frames": 170, "faulty_electrodes": [] }));
        ids.push(check(&format!("{out}/touches.csv"), 30));
        std::fs::remove_file(&recording).unwrap();
    }
    // missing values do not change ids
    assert!(ids.iter().all(|count| *count == ids[0]), "{ids:?}");
}
