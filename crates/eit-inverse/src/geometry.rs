//! Lengths that priors, touches and figures of merit share.

use eit_mesh::Surface;

/// Extent of the skin, metres: the longest side of its bounding box.
pub(crate) fn extent_m(surface: &Surface) -> f64 {
    let [low, high] = surface.bounds_m();
    (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max)
}

/// Straight distance of two points, metres.
pub(crate) fn distance_m<const D: usize>(a: [f64; D], b: [f64; D]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}
