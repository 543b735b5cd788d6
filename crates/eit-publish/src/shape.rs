//! What a skin is drawn from.

use serde::Serialize;

/// Outline and electrodes of a skin, for sinks that draw it.
#[derive(Debug, Clone, Serialize)]
#[serde(tag = "type", rename = "skin")]
pub struct SkinShape {
    /// Name of the skin, from its scene.
    pub name: String,
    /// Closed curves, metres: the outer one, then holes.
    pub outlines_m: Vec<Vec<[f64; 2]>>,
    /// Points of each electrode, metres, in the order of their numbers.
    pub electrodes_m: Vec<Vec<[f64; 2]>>,
    /// Extent of the images, metres: smallest and largest x, then smallest and largest y.
    pub extent_m: [f64; 4],
}
