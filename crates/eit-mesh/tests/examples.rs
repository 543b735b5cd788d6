//! The examples run, and show what they promise.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "../examples/disc.rs"]
#[allow(dead_code, reason = "main of the example is not called here")]
mod disc;

/// Finer edges give more nodes, and every size a mesh with angles above 30 degrees (the
/// refinement alone promises 28, smoothing adds some) and a mean quality above 0.96.
#[test]
fn disc_example() {
    let figures = disc::run().unwrap();
    assert!(figures.windows(2).all(|pair| pair[1].nodes > 2 * pair[0].nodes));
    for quality in &figures {
        assert!(quality.smallest_angle_deg > 30.0, "{quality}");
        assert!(quality.mean_quality > 0.96, "{quality}");
    }
}
