//! The examples run and give the expected results.

#![allow(dead_code, reason = "the examples' own `main` is not called")]

#[path = "../../examples/instrument.rs"]
mod instrument;
#[path = "../../examples/load.rs"]
mod load;
#[path = "../../examples/read_recording.rs"]
mod read_recording;
#[path = "../../examples/soak.rs"]
mod soak;

use std::time::Duration;

use eit_hw::driver::Overflow;

/// The load test at small scale: a rate that a busy computer can sustain; nothing about its speed.
#[test]
fn load_loses_nothing_and_every_value_is_right() {
    let folder = tempfile::tempdir().unwrap();
    let report = load::stream(folder.path(), 200.0, Duration::from_secs(1), false);
    let statistics = report.statistics;
    assert!(report.frames > 20, "{report:?}");
    assert_eq!((report.wrong, statistics.lost, statistics.dropped), (0, 0, 0), "{report:?}");
    assert_eq!(statistics.damaged_bytes, 0, "{report:?}");

    // a robot that was busy finds the latest frames, a recorder all of them
    let (statistics, _) = load::stall(folder.path(), 200.0, Overflow::KeepLatest, 0.6);
    assert!(statistics.dropped > 0 && statistics.lost == 0, "{statistics:?}");
    let (statistics, taken) = load::stall(folder.path(), 200.0, Overflow::Fail, 1.0);
    assert_eq!((statistics.dropped, statistics.lost), (0, 0), "{statistics:?}");
    assert!(taken >= 100, "{taken} {statistics:?}");
    // a quarter of an hour at 25 per second, as fast as frames can be taken
    assert_eq!(load::day_through_driver(22_500).0, 22_500);
    assert_eq!(load::day_through_replay(22_500).0, 22_500);
}

/// The soak test at small scale: bytes dropped, flipped and inserted, pauses, three unplugs.
#[test]
fn soak_records_what_comes_and_no_wrong_value() {
    let report = soak::run(6.0, 200.0);
    let statistics = report.statistics;
    assert!(report.recorded > 200 && report.faults > 3, "{report:?}");
    assert_eq!((report.recorded, report.wrong), (statistics.frames, 0), "{report:?}");
    assert!(statistics.reconnections >= 1 && report.epochs >= 2, "{report:?}");
}

#[test]
fn read_recording_names_the_right_order() {
    let verdict = read_recording::run().unwrap();
    let eit_hw::OrderVerdict::Other { better, ours } = verdict else { panic!("{verdict:?}") };
    assert_eq!(better[0].setting, "[protocol] order = \"ascending\"");
    // the model is exact but for rounding to 17 digits of text
    assert!(better[0].error < 1e-14 && ours > 0.75, "{better:?} {ours}");
}

/// Each electrode measures in 26 of the 208 measurements. At least the last 20 of the 60 frames have one off: the
/// instrument counts from its own start.
#[test]
fn stream_flags_what_the_instrument_could_not_measure_and_records_all() {
    let folder = tempfile::tempdir().unwrap();
    let outcome = instrument::run(&folder.path().join("skin.mcap"), 60).unwrap();
    assert_eq!((outcome.frames, outcome.recorded, outcome.same), (60, 60, true));
    let saturated = outcome.flagged.get("saturated").copied().unwrap_or_default();
    assert_eq!(outcome.flagged.len(), 1, "{:?}", outcome.flagged);
    assert!(saturated >= 20 * 26 && saturated % 26 == 0, "{saturated}");
}
