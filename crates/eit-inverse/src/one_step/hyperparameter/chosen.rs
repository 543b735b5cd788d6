//! What a rule chose, and how that went.

/// How a choice ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum HyperparameterStatus {
    /// A given value.
    Given,
    /// The wanted noise figure is reached.
    NoiseFigureReached,
    /// The wanted noise figure lies outside what the scene allows; the nearest is used.
    NoiseFigureUnreachable,
    /// An extremum inside the range.
    Interior,
    /// The smallest lambda of the range: no noise was found in the data.
    AtLowerEdge,
    /// The largest lambda of the range: no signal was found in the data.
    AtUpperEdge,
}

/// One point of the curve of a rule, for plots.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct CurvePoint {
    /// Lambda.
    pub hyperparameter: f64,
    /// `|dv - J dsigma|_W`, root of the sum over frames, in the unit of `dv`: the weights are
    /// relative to the largest `noise_std`. Divided by
    /// [`OneStepReport::noise_scale`](crate::OneStepReport::noise_scale) it counts standard
    /// deviations: where `noise_std` is right, noise alone gives the square the mean `frames *
    /// measurements_used`.
    pub residual_norm: f64,
    /// `|dsigma|_R`, root of the sum over frames, siemens times the unit of the root of `R`.
    pub solution_norm: f64,
    /// Noise figure, curvature of the L-curve, or generalised cross-validation function.
    pub criterion: f64,
}

/// A chosen hyperparameter.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ChosenHyperparameter {
    /// Lambda.
    pub hyperparameter: f64,
    /// How the choice ended.
    pub status: HyperparameterStatus,
    /// The rule's criterion there (noise figure, curvature, cross-validation function); NaN for a
    /// fixed value.
    pub criterion: f64,
    /// The curve over the whole range, ascending lambda, eight points per decade; empty for a fixed
    /// value.
    pub curve: Vec<CurvePoint>,
}
