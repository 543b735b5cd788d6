//! Numbers that the stages of a plan come from.

use super::machine::Machine;
use super::measured::Measured;
use crate::skin::Skin;

/// Numbers that all stages come from.
pub(super) struct Sizes<'a> {
    pub skin: &'a Skin,
    pub measurements: f64,
    pub elements: f64,
    /// Pixels of the raster's side, and those on the skin.
    pub pixels: usize,
    pub skin_pixels: f64,
    /// Independent measurements at most.
    pub rank: f64,
    /// Those of them that time is counted for.
    pub directions: f64,
    /// The method on the built-in scene most like this one.
    pub measured: Option<&'a Measured>,
    pub machine: &'a Machine,
}
