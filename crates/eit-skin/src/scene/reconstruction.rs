//! `[reconstruction]`: how images are reconstructed.

use eit_inverse::DifferenceKind;
use serde::{Deserialize, Serialize};

/// Default number of pixels along the longer side: a disc of 64 has 3 200 pixels, ten times more than 208
/// measurements can distinguish.
pub(crate) const DEFAULT_PIXELS: usize = 64;

/// `[reconstruction]`
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ReconstructionSettings {
    /// Name of the method; by default chosen from noise, keys and number of frames.
    pub method: Option<String>,
    /// Pixels along the longer side; 64 by default.
    pub pixels: Option<usize>,
    /// Time available per image, seconds; settings that are not stated are chosen for it.
    pub frame_time_s: Option<f64>,
    /// Whether the method was chosen for `frame_time_s`.
    #[serde(skip)]
    pub(crate) is_chosen_in_time: bool,
    /// Prior of the Gauss-Newton methods; Laplace by default.
    pub prior: Option<PriorKind>,
    /// Correlation length of the Laplace and Gaussian priors, metres.
    pub correlation_length_m: Option<f64>,
    /// Weight of the prior, or the rule that chooses it.
    pub hyperparameter: Option<Hyperparameter>,
    /// Noise figure for which the hyperparameter is chosen; 1 by default.
    pub noise_figure: Option<f64>,
    /// Plain or normalised difference; normalised for pair protocols by default.
    pub difference: Option<DifferenceKind>,
    /// Also use measurements on current-carrying electrodes, which contain contact impedances.
    #[serde(default)]
    pub use_driven_electrodes: bool,
    /// Standard deviation of electrode movement with the fabric, along the rim and across it, metres; treated
    /// as nuisance parameters.
    pub electrode_movement_m: Option<f64>,
    /// Weight of total variation in space.
    pub lambda_space: Option<f64>,
    /// Weight of the change from frame to frame.
    pub lambda_time: Option<f64>,
    /// Radius of the data constraint, which replaces the penalty.
    pub delta: Option<Delta>,
    /// Lower bound of the conductivity change, siemens.
    pub lower_s: Option<f64>,
    /// Upper bound of the conductivity change, siemens.
    pub upper_s: Option<f64>,
    /// Relative gap at which an iteration stops.
    pub target_gap: Option<f64>,
    /// Time after which an iteration stops, seconds.
    pub deadline_s: Option<f64>,
}

impl ReconstructionSettings {
    /// Returns the keys present that only the total variation methods read.
    pub(crate) fn keys_of_tv(&self) -> impl Iterator<Item = &'static str> {
        let keys = [
            ("reconstruction.lambda_space", self.lambda_space.is_some()),
            ("reconstruction.lambda_time", self.lambda_time.is_some()),
            ("reconstruction.delta", self.delta.is_some()),
            ("reconstruction.target_gap", self.target_gap.is_some()),
            ("reconstruction.deadline_s", self.deadline_s.is_some()),
        ];
        keys.into_iter().filter(|key| key.1).map(|key| key.0)
    }

    /// Returns the bounds present, which total variation and the absolute method read.
    pub(crate) fn bounds(&self) -> impl Iterator<Item = &'static str> {
        let keys = [
            ("reconstruction.lower_s", self.lower_s.is_some()),
            ("reconstruction.upper_s", self.upper_s.is_some()),
        ];
        keys.into_iter().filter(|key| key.1).map(|key| key.0)
    }

    /// Returns the keys present that only the Gauss-Newton methods (and those with a prior in time) read.
    pub(crate) fn keys_of_gauss_newton(&self) -> impl Iterator<Item = &'static str> {
        let keys = [
            ("reconstruction.prior", self.prior.is_some()),
            ("reconstruction.correlation_length_m", self.correlation_length_m.is_some()),
            ("reconstruction.hyperparameter", self.hyperparameter.is_some()),
            ("reconstruction.noise_figure", self.noise_figure.is_some()),
        ];
        keys.into_iter().filter(|key| key.1).map(|key| key.0)
    }
}

/// `reconstruction.delta`: a number, or derived from the noise.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
#[serde(untagged, expecting = "a number, \"noise\" or \"paper\"")]
pub enum Delta {
    /// Stated as a number.
    Value(f64),
    /// Derived from the noise.
    Rule(DeltaRule),
}

/// Rules for the radius of the data constraint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum DeltaRule {
    /// The square root of the number of measurements.
    Noise,
    /// The same, and equation (7) of the paper: a pixel's change from frame to frame weighs as much as its differences in space.
    Paper,
}

/// Kind of prior (`reconstruction.prior`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum PriorKind {
    /// Identity: small changes.
    Tikhonov,
    /// Diagonal, from the sensitivity of each element.
    Noser,
    /// Smooth changes.
    Laplace,
    /// Changes correlated over a length.
    Gaussian,
}

/// `reconstruction.hyperparameter`: a number or a rule.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(untagged, expecting = "a number, or one of \"noise-figure\", \"l-curve\", \"gcv\"")]
pub enum Hyperparameter {
    /// Stated as a number.
    Value(f64),
    /// Chosen by a rule.
    Rule(Rule),
}

/// Rules that choose the hyperparameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Rule {
    /// By the noise figure.
    NoiseFigure,
    /// By the corner of the L-curve.
    LCurve,
    /// By generalised cross-validation.
    Gcv,
}
