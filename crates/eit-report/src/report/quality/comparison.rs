//! Parameters of the comparison, and a row of results.

use super::super::scores::Scores;
use super::super::solver::METHODS;
use crate::simulate::FingerShape;

/// Number of methods compared: all except the absolute one, which takes a hundred times longer than
/// the others together and appears only in the benchmark.
pub(super) const COMPARED: usize = METHODS.len() - 1;

/// The parameters that are varied.
pub(super) struct Grid {
    pub noise_db: &'static [f64],
    pub touches: &'static [usize],
    pub frames: usize,
    pub pixels: usize,
}

/// A full run.
pub(super) const FULL: Grid = Grid {
    noise_db: &[30.0, 40.0, 50.0, 60.0, 70.0],
    touches: &[1, 2, 3, 4],
    frames: 12,
    pixels: 64,
};

/// A run with `--quick`.
pub(super) const QUICK: Grid = Grid { noise_db: &[60.0], touches: &[1, 2], frames: 6, pixels: 32 };

/// Speed of the fingers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Speed {
    pub name: &'static str,
    /// Distance per frame, metres.
    pub step_m: f64,
}

/// Result of one method on one sequence.
pub(super) struct Row {
    pub shape: FingerShape,
    pub noise_db: f64,
    pub speed: &'static str,
    pub touches: usize,
    /// Index in [`METHODS`].
    pub method: usize,
    pub scores: Scores,
    pub seconds: f64,
    /// How weights or hyperparameter were chosen.
    pub choice: String,
}
