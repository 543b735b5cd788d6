//! What is measured of a solver: time with its spread, error, certificate, floor.

use super::super::scores::Scores;
use eit_inverse::MovieStatus;
use ndarray::Array2;
use serde::Serialize;

/// Times of several runs, seconds a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Spread {
    pub least_s: f64,
    pub median_s: f64,
    pub most_s: f64,
    /// Runs.
    pub runs: usize,
}

impl Spread {
    /// Of the times of runs over so many frames; not empty.
    pub fn of(mut seconds: Vec<f64>, frames: usize) -> Self {
        seconds.sort_by(f64::total_cmp);
        let at = |index: usize| seconds.get(index).copied().unwrap_or(f64::NAN) / frames as f64;
        let runs = seconds.len();
        let (least_s, median_s) = (at(0), at(runs / 2));
        Self { least_s, median_s, most_s: at(runs.saturating_sub(1)), runs }
    }
}

/// One setting of a solver, run to its end.
#[derive(Debug, Clone)]
pub(super) struct Point {
    /// Relative gap that was asked for; `None` for what has none.
    pub target_gap: Option<f64>,
    pub time: Spread,
    /// Time that the work of a frame takes at this machine's best rates.
    pub floor_s: f64,
    pub scores: Scores,
    /// Gap that was proven.
    pub gap: Option<f64>,
    pub iterations: usize,
    pub status: MovieStatus,
}

/// A solver on one recording, with every setting it was run at.
#[derive(Debug, Clone)]
pub(super) struct Course {
    pub solver: Solver,
    /// Set-up for the skin: factorisations.
    pub set_up_s: f64,
    /// Choice of weights or hyperparameter for the recording.
    pub choice_s: f64,
    /// That choice in words.
    pub choice: String,
    pub points: Vec<Point>,
    /// The last point's movie on the raster of the judge, [frame, masked pixel].
    pub movie: Array2<f64>,
}

/// What solves.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Solver {
    /// In tables and legends.
    pub name: String,
    /// Pixels along the skin; the elements of the mesh where there are none.
    pub pixels: Option<usize>,
    /// Gives a frame's image before the next frame comes.
    pub is_live: bool,
    /// Another program, to compare with.
    pub is_peer: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spread_is_ordered_and_a_frame_s_share() {
        let spread = Spread::of(vec![6.0, 2.0, 4.0], 2);
        assert_eq!((spread.least_s, spread.median_s, spread.most_s), (1.0, 2.0, 3.0));
        assert!(Spread::of(vec![], 2).median_s.is_nan());
    }
}
