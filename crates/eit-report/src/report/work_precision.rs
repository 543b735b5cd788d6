//! Work-precision curves: error of a solver against its time, with certificates and minimum times.

use crate::comparison::Scores;
use crate::comparison::SetUpCost;
use eit_inverse::SequenceStatus;
use eit_skin::scene::Rule;
use ndarray::Array2;
use serde::Serialize;

/// Times per frame, seconds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Spread {
    pub least_s: f64,
    pub median_s: f64,
    /// Time not exceeded by 95 % of the samples.
    pub most_of_s: f64,
    pub most_s: f64,
    /// Number of samples: runs of a recording, or frames of all runs.
    pub count: usize,
}

impl Spread {
    /// Computes times per frame from non-empty `seconds`: of runs over `frames` frames each, or of
    /// single frames.
    pub(crate) fn of(mut seconds: Vec<f64>, frames: usize) -> Self {
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

/// The result of a solver with one setting.
#[derive(Debug, Clone)]
pub(super) struct WorkPrecisionPoint {
    /// Target gap; `None` for methods without a gap.
    pub target_gap: Option<f64>,
    pub time: Spread,
    /// Time per frame of the same work at this machine's best rates.
    pub floor_s: f64,
    pub scores: Scores,
    pub convergence: Convergence,
}

/// Final state of an iteration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Convergence {
    pub iterations: usize,
    pub status: SequenceStatus,
    /// Proven gap.
    pub gap: Option<f64>,
}

impl Convergence {
    /// Value for direct methods, which do not iterate.
    pub(crate) const DIRECT: Self =
        Self { iterations: 0, status: SequenceStatus::Direct, gap: None };

    /// Both: iterations of the two together, and the worse status and gap.
    pub(crate) fn and(self, other: Self) -> Self {
        let is_done = matches!(other.status, SequenceStatus::Direct | SequenceStatus::Converged);
        Self {
            iterations: self.iterations + other.iterations,
            status: if is_done { self.status } else { other.status },
            gap: self.gap.into_iter().chain(other.gap).reduce(f64::max),
        }
    }
}

/// A solver on one recording, with all of its settings.
#[derive(Debug, Clone)]
pub(super) struct WorkPrecisionCurve {
    pub solver: SolverDescription,
    /// Set-up cost; for a live solver, everything before the first frame.
    pub cost: SetUpCost,
    pub points: Vec<WorkPrecisionPoint>,
    /// Images of the last point on the finest raster, [frame, masked pixel].
    pub images: Array2<f64>,
}

/// Describes a solver.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct SolverDescription {
    /// Method, including prior knowledge.
    pub name: String,
    /// Rule of the hyperparameter, as in a scene file; empty if there is none.
    pub rule: &'static str,
    /// Number of pixels across the skin; `None` for methods on mesh elements.
    pub pixels: Option<usize>,
    /// Whether it returns a frame's image before the next frame arrives, without having seen the
    /// recording.
    pub is_live: bool,
}

impl SolverDescription {
    /// Describes one of our solvers.
    pub(crate) fn own(name: impl Into<String>, pixels: Option<usize>, is_live: bool) -> Self {
        Self { name: name.into(), rule: "", pixels, is_live }
    }

    /// Adds a hyperparameter rule.
    pub(crate) fn with_rule(self, rule: Rule) -> Self {
        let rule = match rule {
            Rule::NoiseFigure => "noise-figure",
            Rule::LCurve => "l-curve",
            Rule::Gcv => "gcv",
        };
        Self { rule, ..self }
    }

    /// Name in tables and legends.
    pub(crate) fn label(&self) -> String {
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
