//! Missing values are accepted in all files, and a frame without any value does not interrupt detection.

use crate::common::{Folder, answer, parse, read_text, rows, succeed, touched_frames};
use serde_json::Value;
use std::collections::BTreeSet;

/// Frames with the finger, which stays: it appears in frame 101 of 200.
const TOUCHED: std::ops::Range<usize> = 101..200;
/// Frames without a value.
const EMPTY: [usize; 3] = [60, 120, 150];
/// Interval between frames with missing values.
const HOLED: usize = 7;

/// Frames with holes, as NPY and as CSV.
fn holed(folder: &Folder) -> [String; 2] {
    let mut frames = touched_frames(folder).1.clone();
    for (frame, mut values) in frames.rows_mut().into_iter().enumerate() {
        if EMPTY.contains(&frame) {
            values.fill(f64::NAN);
        } else if frame > 30 && frame % HOLED == 0 {
            // spread so that no electrode loses most of its measurements
            [frame % 40, (3 * frame + 17) % 40].iter().for_each(|&i| values[i] = f64::NAN);
        }
    }
    let cells = |row: ndarray::ArrayView1<'_, f64>| {
        row.iter().map(|value| format!("{value:e}")).collect::<Vec<_>>().join(",") + "\n"
    };
    let table: String = frames.rows().into_iter().map(cells).collect();
    [folder.write_array("holed.npy", &frames), folder.write("holed.csv", table)]
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

fn faults(report: &Value) -> usize {
    let touches = &report["touches"]["faulty_electrodes"];
    touches.as_array().unwrap_or_else(|| panic!("{report}")).len()
}

#[test]
fn values_that_are_no_numbers_are_missing() {
    let folder = Folder::new();
    let scene = folder.scene("[recording]\nframe_rate_hz = 20.0\n");
    let whole = folder.path("touched.npy");
    let files = holed(&folder);
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
