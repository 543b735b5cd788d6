//! Work-precision curves: error of a solver over its time, with certificate and least time.

use super::super::scores::Scores;
use super::super::solver::SetUpCost;
use eit_inverse::SequenceStatus;
use eit_skin::scene::Rule;
use ndarray::Array2;
use serde::Serialize;

/// Times of a frame, seconds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Spread {
    pub least_s: f64,
    pub median_s: f64,
    /// 95 of 100 take no longer.
    pub most_of_s: f64,
    pub most_s: f64,
    /// Times that it is of: runs of a recording, or frames of all runs.
    pub count: usize,
}

impl Spread {
    /// Of runs over so many frames each, or of frames one by one; `seconds` is not empty.
    pub fn of(mut seconds: Vec<f64>, frames: usize) -> Self {
        seconds.sort_by(f64::total_cmp);
        let count = seconds.len();
        let at = |index: usize| seconds.get(index).copied().unwrap_or(f64::NAN) / frames as f64;
        let last = count.saturating_sub(1);
        Self {
            least_s: at(0),
            median_s: 0.5 * (at(last / 2) + at(count / 2)),
            most_of_s: at(((0.95 * count as f64).ceil() as usize).saturating_sub(1)),
            most_s: at(last),
            count,
        }
    }
}

/// One setting of a solver, run to its end.
#[derive(Debug, Clone)]
pub(super) struct WorkPrecisionPoint {
    /// Relative gap that was asked for; `None` for what has none.
    pub target_gap: Option<f64>,
    pub time: Spread,
    /// Time that the work of a frame takes at this machine's best rates.
    pub floor_s: f64,
    pub scores: Scores,
    pub convergence: Convergence,
}

/// How an iteration ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Convergence {
    pub iterations: usize,
    pub status: SequenceStatus,
    /// Gap that was proven.
    pub gap: Option<f64>,
}

impl Convergence {
    /// Of a direct method, which has no iteration.
    pub const DIRECT: Self = Self { iterations: 0, status: SequenceStatus::Direct, gap: None };
}

/// A solver on one recording, with every setting it was run at.
#[derive(Debug, Clone)]
pub(super) struct WorkPrecisionCurve {
    pub solver: SolverDescription,
    /// Of a live solver, all before its first frame is set-up.
    pub cost: SetUpCost,
    pub points: Vec<WorkPrecisionPoint>,
    /// The last point's images on the finest raster, [frame, masked pixel].
    pub images: Array2<f64>,
}

/// What solves.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct SolverDescription {
    /// Method, with what it knows.
    pub name: String,
    /// Rule of the hyperparameter, as in a scene file; empty where there is none.
    pub rule: &'static str,
    /// Pixels along the skin; the elements of the mesh where there are none.
    pub pixels: Option<usize>,
    /// Gives a frame's image before the next frame comes, and has not seen the recording before.
    pub is_live: bool,
    /// Another program, to compare with.
    pub is_peer: bool,
}

impl SolverDescription {
    /// One of ours.
    pub fn own(name: impl Into<String>, pixels: Option<usize>, is_live: bool) -> Self {
        Self { name: name.into(), rule: "", pixels, is_live, is_peer: false }
    }

    /// The same with a rule for the hyperparameter.
    pub fn with_rule(self, rule: Rule) -> Self {
        let rule = match rule {
            Rule::NoiseFigure => "noise-figure",
            Rule::LCurve => "l-curve",
            Rule::Gcv => "gcv",
        };
        Self { rule, ..self }
    }

    /// In tables and legends.
    pub fn label(&self) -> String {
        if self.rule == "gcv" { format!("{}, gcv", self.name) } else { self.name.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spread_is_ordered_and_a_frame_s_share() {
        let spread = Spread::of(vec![6.0, 2.0, 4.0], 2);
        assert_eq!((spread.least_s, spread.median_s, spread.most_s), (1.0, 2.0, 3.0));
        assert_eq!(Spread::of(vec![1.0, 3.0], 1).median_s, 2.0);
        let hundred = Spread::of((1..=100).map(f64::from).collect(), 1);
        assert_eq!((hundred.median_s, hundred.most_of_s), (50.5, 95.0));
        assert!(Spread::of(vec![], 2).median_s.is_nan());
    }
}
