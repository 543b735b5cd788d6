//! The examples run and find what they should.

#![allow(
    missing_docs,
    dead_code,
    clippy::unwrap_used,
    clippy::panic,
    reason = "a test file: a panic is a failed test"
)]

#[path = "../examples/load.rs"]
mod load;
#[path = "../examples/read_recording.rs"]
mod read_recording;

use std::time::Duration;

use eit_hw::driver::Overflow;

/// The load run in small: a rate that a busy computer keeps, nothing about its speed.
#[test]
fn load_loses_nothing_and_every_value_is_right() {
    let folder = tempfile::tempdir().unwrap();
    let report = load::stream(folder.path(), 200.0, Duration::from_secs(2), false);
    let statistics = report.statistics;
    assert!(report.frames > 20, "{report:?}");
    assert_eq!((report.wrong, statistics.lost, statistics.dropped), (0, 0, 0), "{report:?}");
    assert_eq!(statistics.damaged_bytes, 0, "{report:?}");

    // a robot that was busy finds the latest frames, a recorder all of them
    let (statistics, _) = load::stall(folder.path(), 200.0, Overflow::KeepLatest, 1.0);
    assert!(statistics.dropped > 0 && statistics.lost == 0, "{statistics:?}");
    let (statistics, taken) = load::stall(folder.path(), 200.0, Overflow::Fail, 1.0);
    assert_eq!((statistics.dropped, statistics.lost), (0, 0), "{statistics:?}");
    assert!(taken >= 100, "{taken} {statistics:?}");
    // an hour of frames at 25 a second, as fast as they can be taken
    assert_eq!(load::day_through_driver(90_000).0, 90_000);
    assert_eq!(load::day_through_replay(90_000).0, 90_000);
}

#[test]
fn read_recording_names_the_right_order() {
    match read_recording::run().unwrap() {
        eit_hw::OrderVerdict::Other { better, ours } => {
            assert_eq!(better[0].setting, "[protocol] order = \"ascending\"");
            // the model is exact but for rounding of 17 digits written as text
            assert!(better[0].error < 1e-14 && ours > 0.75, "{better:?} {ours}");
        }
        other => panic!("{other:?}"),
    }
}
