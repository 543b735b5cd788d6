//! The examples run, and show what they promise.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "../examples/difference.rs"]
#[allow(dead_code, reason = "main of the example is not called here")]
mod difference;

/// Every prior and rule finds the finger: within a tenth of the radius (what 16 electrodes resolve
/// at half the radius), with a positive correlation of image and truth.
#[test]
fn difference_example() {
    let outcomes = difference::run().unwrap();
    assert_eq!(outcomes.len(), 16);
    for o in &outcomes {
        let case = format!("{}, {}, lambda {}", o.prior, o.rule, o.hyperparameter);
        assert!(o.position_error_m < 0.01, "{case}: {} m off", o.position_error_m);
        assert!(o.correlation > 0.4, "{case}: correlation {}", o.correlation);
    }
}
