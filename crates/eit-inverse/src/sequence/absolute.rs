//! Iterated Gauss-Newton on the non-linear forward model.

mod bounded;
mod settings;
mod solve;
mod step;

pub use settings::{AbsoluteFrameReport, AbsoluteSettings};

use crate::check::check_positive;
use crate::data::Channels;
use crate::one_step::{covariance_times, weighted_rows};
use crate::{InverseError, Prior};
use bounded::Bounded;
use eit_fem::{ForwardModel, Workspace};
use ndarray::{Array2, ArrayRef2};
use std::fmt;

/// Largest rounding difference between two computations of the same row of `J P`, relative to its
/// largest entry.
const SAME_ROW: f64 = 1e-6;

/// Absolute reconstruction of every frame by iterated Gauss-Newton, relinearised at each step.
///
/// The voltages of a frame are taken as `F(sigma_ref) + dv`: the measured difference is added to the
/// model's voltages at the reference conductivity, so that model errors common to both cancel to
/// first order. With `sigma(x)` defined element by element,
///
/// ```text
/// x = argmin  |F(sigma_ref) + dv - F(sigma(x))|_W^2 + lambda^2 s |x|_R^2
/// x_k+1 = x_k + t (P J' (J P J' + lambda^2 s W^-1)^-1 (residual + J x_k) - x_k)
/// image = sigma(x) - sigma_ref,      J = dF/dsigma dsigma/dx at x_k
/// ```
///
/// The unknowns are elements; the images are `[frame, element]`, siemens (per square). `lambda`, `s`,
/// `W` and `P = R^-1` are those of [`OneStepGaussNewton`](crate::OneStepGaussNewton). To first order
/// in `dv`, the first step from the reference equals its image.
///
/// **Bounds.** `sigma(x)` maps all real numbers into `lower..upper` by a logistic function in the
/// logarithm with slope 1 at the reference, so `lower <= sigma <= upper` holds exactly at every step.
/// A projection with an active set would need `R` to evaluate `|x|_R` after clipping, but a [`Prior`]
/// provides only `P`. With the map, `x` remains a combination of the columns of `P J'`, `R x` is the
/// same combination of the rows of `J`, and objective, slope and step are exact without `R`.
///
/// **Line search.** Steps are halved until the objective satisfies Armijo's condition. A frame starts
/// from the result of the last frame that had data, or from the reference if that has the lower
/// objective, so a failed frame does not affect the next one. Masked channels of a frame are removed
/// from `F` and `J`, at the same `lambda^2 s`; a frame without a good channel has the image zero.
///
/// **Cost.** One step costs a forward solution and its Jacobian, the prior's `J P`, `m^2 n` flops for
/// `J P J'`, `m^3 / 3` for its Cholesky factor; one halving costs a forward solution. The factor
/// needs `lambda^2 s` above the rounding error of `J P J'`: lambda above about 1e-6. The problem is
/// not convex, so there is no certificate; [`frame_reports`](Self::frame_reports) gives the status of
/// each frame.
///
/// Source: Vauhkonen, Vadasz, Karjalainen, Somersalo, Kaipio, *IEEE Trans. Med. Imaging* 17 (1998),
/// 285-293 (iterated Gauss-Newton with priors); the form in measurement space: Adler, Dai,
/// Lionheart, *Physiol. Meas.* 28 (2007), S1-S11.
#[derive(Clone)]
pub struct AbsoluteGaussNewton<'a> {
    model: &'a ForwardModel,
    prior: &'a dyn Prior,
    workspace: Workspace,
    channels: Channels,
    map: Vec<Bounded>,
    reference_s: Vec<f64>,
    /// `F(sigma_ref)`, volts, `[measurement]`.
    reference_v: Vec<f64>,
    /// Voltages of the latest forward solution, `[measurement]`.
    voltages_v: Vec<f64>,
    /// `dF/dsigma`, `[measurement, element]`.
    jacobian: Array2<f64>,
    /// `mu = lambda^2 s`.
    noise_variance: f64,
    settings: AbsoluteSettings,
    reports: Vec<AbsoluteFrameReport>,
}

impl fmt::Debug for AbsoluteGaussNewton<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("AbsoluteGaussNewton")
            .field("prior", &self.prior.name())
            .field("jacobian", &self.jacobian.dim())
            .finish_non_exhaustive()
    }
}

impl<'a> AbsoluteGaussNewton<'a> {
    /// Sets up the method at the reference conductivity `reference_s` `[element]`, siemens (per
    /// square), and computes its voltages and the scale `s`.
    ///
    /// The prior must not depend on the Jacobian ([`Noser`](crate::Noser) does).
    ///
    /// # Errors
    /// [`InverseError::Forward`]; [`InverseError::PriorNotFixed`]; an error if settings are out of
    /// range or have the wrong length, if the reference is on or outside the bounds, or if the prior
    /// belongs to another mesh.
    pub fn new(
        model: &'a ForwardModel,
        reference_s: &[f64],
        prior: &'a dyn Prior,
        settings: AbsoluteSettings,
    ) -> Result<Self, InverseError> {
        check_positive("hyperparameter", settings.one_step.hyperparameter)?;
        let channels = settings.one_step.channels(model.protocol().measurements())?;
        let mut workspace = model.workspace()?;
        let mut solution = model.solve(reference_s, &mut workspace)?;
        let (reference_v, jacobian) = (solution.measurements().to_vec(), solution.jacobian());
        let bounds_s = settings.bounds_s(reference_s)?;
        let map: Result<Vec<_>, _> = reference_s
            .iter()
            .enumerate()
            .map(|(element, &s)| Bounded::new(element, s, bounds_s))
            .collect();
        let scale = scale(&jacobian, prior, &channels)?;
        let noise_variance = settings.one_step.hyperparameter.powi(2) * scale;
        check_positive("square of the hyperparameter times s", noise_variance)?;
        Ok(Self {
            model,
            prior,
            workspace,
            channels,
            map: map?,
            reference_s: reference_s.to_vec(),
            voltages_v: reference_v.clone(),
            reference_v,
            jacobian,
            noise_variance,
            settings,
            reports: Vec::new(),
        })
    }

    /// Returns the report of each frame of the latest sequence, `[frame]`.
    pub fn frame_reports(&self) -> &[AbsoluteFrameReport] {
        &self.reports
    }
}

/// Computes `s = trace(W^1/2 J P J' W^1/2) / m` and rejects priors that depend on the Jacobian.
fn scale(
    jacobian: &ArrayRef2<f64>,
    prior: &dyn Prior,
    channels: &Channels,
) -> Result<f64, InverseError> {
    let elements = jacobian.ncols();
    let weighted = weighted_rows(jacobian, channels)?;
    let covariance = covariance_times(prior, &weighted, elements)?;
    // Apply the prior to the first row next to a different second row. A prior that depends on the
    // whole Jacobian gives a different result for the first row.
    let first = &weighted[..elements];
    let beside: Vec<f64> = first.iter().chain(first.iter().rev()).copied().collect();
    let again = covariance_times(prior, &beside, elements)?;
    let largest = again[..elements].iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let mut rows = covariance.iter().zip(&again[..elements]);
    if rows.any(|(a, b)| (a - b).abs() > SAME_ROW * largest) {
        return Err(InverseError::PriorNotFixed { prior: prior.name() });
    }
    let used = channels.used.len();
    let scale = dot(&weighted, &covariance) / used as f64;
    if !scale.is_finite() {
        return Err(InverseError::BadCovariance { prior: prior.name(), pivot: 0 });
    }
    if scale < f64::MIN_POSITIVE {
        return Err(InverseError::NoSensitivity { measurements: used });
    }
    Ok(scale)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
