//! Result of a hyperparameter rule.

/// Outcome of a hyperparameter choice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum HyperparameterStatus {
    /// The value was given.
    Given,
    /// The requested noise figure was reached.
    NoiseFigureReached,
    /// The requested noise figure cannot be reached; the nearest one is used.
    NoiseFigureUnreachable,
    /// The optimum lies inside the range of lambda.
    Interior,
    /// The optimum is the smallest lambda of the range: no noise was found in the data.
    AtLowerEdge,
    /// The optimum is the largest lambda of the range: no signal was found in the data.
    AtUpperEdge,
}

/// One point of a rule's curve, for plots.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct CurvePoint {
    /// Lambda.
    pub hyperparameter: f64,
    /// `|dv - J dsigma|_W`, as the root of the sum of squares over frames, in the unit of `dv`
    /// because the weights are relative to the largest `noise_std`. Divided by
    /// [`OneStepReport::noise_scale`](crate::OneStepReport::noise_scale) it is in standard
    /// deviations: with a correct `noise_std`, the expected square for pure noise is
    /// `frames * measurements_used`.
    pub residual_norm: f64,
    /// `|dsigma|_R`, as the root of the sum of squares over frames, in siemens times the unit of the
    /// root of `R`.
    pub solution_norm: f64,
    /// Noise figure, curvature of the L-curve, or generalised cross-validation function.
    pub criterion: f64,
}

/// Hyperparameter chosen by a rule.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ChosenHyperparameter {
    /// Lambda.
    pub hyperparameter: f64,
    /// Outcome of the choice.
    pub status: HyperparameterStatus,
    /// Criterion at this lambda (noise figure, curvature or cross-validation function); NaN for a
    /// fixed value.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::absent::nan"))]
    pub criterion: f64,
    /// Curve over the whole range in order of ascending lambda, eight points per decade; empty for a
    /// fixed value.
    pub curve: Vec<CurvePoint>,
}
