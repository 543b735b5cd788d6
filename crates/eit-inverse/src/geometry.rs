//! Lengths used by priors, touches and figures of merit.

use eit_mesh::Surface;

/// Returns the extent of the skin, metres: the longest side of its bounding box.
pub(crate) fn extent_m(surface: &Surface) -> f64 {
    let [low, high] = surface.bounds_m();
    (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max)
}

/// Returns the straight distance between two points, metres.
pub(crate) fn distance_m<const D: usize>(a: [f64; D], b: [f64; D]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}
