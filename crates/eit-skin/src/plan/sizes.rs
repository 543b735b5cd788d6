//! Sizes on which the stages of a plan depend.

use super::machine::Machine;
use super::measured::Measured;
use crate::skin::Skin;

/// Sizes on which all stages depend.
pub(super) struct Sizes<'a> {
    pub skin: &'a Skin,
    pub measurements: f64,
    pub elements: f64,
    /// Pixels along the raster's side, and pixels on the skin.
    pub pixels: usize,
    pub skin_pixels: f64,
    /// Maximum number of independent measurements.
    pub rank: f64,
    /// Number of those for which time is counted.
    pub directions: f64,
    /// Measurements of the method on the most similar built-in scene.
    pub measured: Option<&'a Measured>,
    pub machine: &'a Machine,
}
