//! The examples run and give the documented results.

#[path = "../../examples/disc.rs"]
#[allow(dead_code, reason = "main of the example is not called here")]
mod disc;

/// Refinement alone guarantees 28 degrees; smoothing improves it.
#[test]
fn disc_example() {
    let figures = disc::run().unwrap();
    assert!(figures.windows(2).all(|pair| pair[1].nodes > 2 * pair[0].nodes));
    for quality in &figures {
        assert!(quality.smallest_angle_deg > 30.0, "{quality}");
        assert!(quality.mean_quality > 0.96, "{quality}");
    }
}
