//! The example runs, and shows what it promises.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "../examples/forward.rs"]
#[allow(dead_code, reason = "main of the example is not called here")]
mod forward;

/// A one per cent touch is linear up to its square: 1 % of the change, less in a disc, where an
/// inclusion of contrast `1 + e` acts as `e / (1 + e / 2)`: 0.5 %, and up to twice that near it.
#[test]
fn forward_example() {
    let (change_v, unexplained) = forward::run().unwrap();
    assert!(change_v > 1e-4, "{change_v} V");
    assert!(unexplained > 1e-3 && unexplained < 1e-2, "{unexplained}");
}

#[path = "../examples/elements.rs"]
#[allow(dead_code, reason = "main of the example is not called here")]
mod elements;

/// On meshes of 1 000 nodes and less quadratic elements are better by two decades.
#[test]
fn elements_example() {
    let [linear, quadratic] = elements::run(2, 1).unwrap();
    assert!(linear > 1e-3 && quadratic < 0.05 * linear, "{linear:e} {quadratic:e}");
}

#[cfg(feature = "fabric")]
#[path = "../examples/fabric.rs"]
#[allow(dead_code, reason = "main of the example is not called here")]
mod fabric;

/// A finger is far above noise and drift, whose amplitudes `docs/FABRIC.md` has.
#[cfg(feature = "fabric")]
#[test]
fn fabric_example() {
    let [untouched, touched] = fabric::run().unwrap();
    assert!(untouched > 0.0 && touched > 10.0 * untouched, "{untouched:e} {touched:e}");
}
