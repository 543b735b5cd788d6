//! Settings of spatio-temporal total variation.

use crate::InverseError;
use crate::check::{check_length, check_positive, check_range};
use std::time::Duration;

/// How the images are fitted to the data.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Fidelity {
    /// `sum_t |W^1/2 (J x_t - dv_t)|^2 / 2` is part of the objective.
    Penalised,
    /// `|W^1/2 (J x_t - dv_t)| <= delta` for each frame (eq. 7 of the source paper). With `W` the
    /// inverse noise covariance, the discrepancy principle gives `delta = sqrt(m)` for `m` used
    /// measurements; with `W = 1`, `delta` is the norm of the noise in the unit of `dv`. For a frame
    /// with masked channels, `delta` is multiplied by the root of the fraction of good channels.
    Constrained {
        /// Radius, in units of the noise (or of `dv` if no noise is given), 0 or above.
        delta: f64,
    },
}

/// Settings of [`StTv`](crate::StTv).
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct StTvSettings {
    /// Weight of `sum_t |grad x_t|_{2,1}`, above zero. Unit: that of the data term over S m; with
    /// [`Fidelity::Constrained`] only the ratio of the two weights matters.
    pub lambda_space: f64,
    /// Weight of `sum_t integral |x_{t+1} - x_t| dA`, 0 or above. With 0 the frames are independent
    /// (spatial total variation only), and the time term costs nothing. Unit: that of the data term
    /// over S m^2.
    ///
    /// Total variation in time does not depend on the times of the frames: dropped frames or a
    /// different frame rate need no other weight.
    pub lambda_time: f64,
    /// Data term, in the objective or as constraints.
    pub fidelity: Fidelity,
    /// Lower bound of the conductivity change, siemens (`-inf`: no bound). Use 0 for a piezoresistive
    /// fabric, whose conductivity only increases under pressure.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::absent::minus_infinite"))]
    pub lower_s: f64,
    /// Upper bound of the conductivity change, siemens (`inf`: no bound).
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::absent::infinite"))]
    pub upper_s: f64,
    /// Standard deviation of the noise of each difference, `[measurement]`, in the unit of `dv`;
    /// `None`: `W = 1`.
    pub noise_std: Option<Vec<f64>>,
    /// Which measurements to use, `[measurement]`; `None`: all.
    pub used: Option<Vec<bool>>,
}

impl Default for StTvSettings {
    fn default() -> Self {
        Self {
            lambda_space: 1.0,
            lambda_time: 1.0,
            fidelity: Fidelity::Penalised,
            lower_s: f64::NEG_INFINITY,
            upper_s: f64::INFINITY,
            noise_std: None,
            used: None,
        }
    }
}

/// Weights of the data term and the variations.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Weights {
    pub(crate) lambda_space: f64,
    pub(crate) lambda_time: f64,
    pub(crate) fidelity: Fidelity,
}

impl StTvSettings {
    /// Rejects settings out of range.
    pub(crate) fn check(&self, measurements: usize) -> Result<(), InverseError> {
        check_positive("lambda_space", self.lambda_space)?;
        let at_least_zero = |x: f64| x >= 0.0 && x.is_finite();
        let must = "finite and 0 or above";
        check_range("lambda_time", self.lambda_time, at_least_zero(self.lambda_time), must)?;
        if let Fidelity::Constrained { delta } = self.fidelity {
            check_range("delta", delta, at_least_zero(delta), must)?;
        }
        let Self { lower_s, upper_s, .. } = *self;
        check_range("lower_s", lower_s, lower_s < f64::INFINITY, "a number below infinity")?;
        check_range("upper_s", upper_s, upper_s > lower_s, "above lower_s")?;
        if let Some(used) = &self.used {
            check_length("used", used.len(), measurements)?;
        }
        Ok(())
    }

    pub(crate) fn bounds_s(&self) -> [f64; 2] {
        [self.lower_s, self.upper_s]
    }

    /// Returns the conductivity change within the bounds that is nearest to zero.
    pub(crate) fn nearest_zero_s(&self) -> f64 {
        0.0_f64.clamp(self.lower_s, self.upper_s)
    }
}

/// Stopping rule; the first condition reached stops the iteration.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Stop {
    /// Target relative duality gap, above zero. Below `1e-4`, and with data constraints, the
    /// iteration runs in `f64` instead of `f32`.
    pub target_gap: f64,
    /// Time limit of the call, including the computation of the certificate.
    pub deadline: Option<Duration>,
    /// Maximum number of iterations, including those for the certificate.
    pub max_iterations: usize,
}

impl Default for Stop {
    fn default() -> Self {
        Self { target_gap: 1e-3, deadline: None, max_iterations: 20_000 }
    }
}
