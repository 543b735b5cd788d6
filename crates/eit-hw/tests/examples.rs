//! The examples run and find what they should.

#![allow(
    missing_docs,
    dead_code,
    clippy::unwrap_used,
    clippy::panic,
    reason = "a test file: a panic is a failed test"
)]

#[path = "../examples/read_recording.rs"]
mod read_recording;

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
