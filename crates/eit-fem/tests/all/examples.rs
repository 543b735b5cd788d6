//! The examples run and give the expected results.
#![allow(dead_code, reason = "the examples' own `main` is not called")]

#[path = "../../examples/forward.rs"]
mod forward;

/// For a touch of one per cent, the non-linear part is 0.5 % of the change in a disc, where an
/// inclusion of contrast `1 + e` acts as `e / (1 + e / 2)`, and up to twice that near it.
#[test]
fn forward_example() {
    let (change_v, unexplained) = forward::run().unwrap();
    assert!(change_v > 1e-4, "{change_v} V");
    assert!(unexplained > 1e-3 && unexplained < 1e-2, "{unexplained}");
}

#[path = "../../examples/elements.rs"]
mod elements;

/// On meshes of at most 1 000 nodes, quadratic elements are more accurate by two decades.
#[test]
fn elements_example() {
    let [linear, quadratic] = elements::run(2, 1).unwrap();
    assert!(linear > 1e-3 && quadratic < 0.05 * linear, "{linear:e} {quadratic:e}");
}

#[cfg(feature = "fabric")]
#[path = "../../examples/fabric.rs"]
mod fabric;

/// A finger changes the voltages far more than noise and drift (amplitudes in `docs/FABRIC.md`).
#[cfg(feature = "fabric")]
#[test]
fn fabric_example() {
    let [untouched, touched] = fabric::run().unwrap();
    assert!(untouched > 0.0 && touched > 10.0 * untouched, "{untouched:e} {touched:e}");
}
