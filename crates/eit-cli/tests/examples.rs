//! The example of a whole robot runs, and feels what it should.
#![allow(clippy::unwrap_used, missing_docs, reason = "tests")]

#[path = "../examples/robot_loop/main.rs"]
#[allow(dead_code, reason = "main of the example is not called here")]
mod robot_loop;

/// 120 frames: 30 quiet ones, then presses of 25 frames every 50. A tracker may take a frame or two
/// to begin and end, and frames that came before the session was ready are not ours to count.
#[test]
fn the_robot_feels_the_emulated_finger() {
    let (seen, _) = robot_loop::run(None, 120).unwrap();
    assert!((25..=60).contains(&seen), "{seen}");
}
