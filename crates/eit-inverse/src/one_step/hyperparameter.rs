//! Rules that choose the hyperparameter lambda.
//!
//! All rules evaluate closed-form sums over the spectrum: `O(r)` per lambda, the noise figure
//! `O(r n)` (the cost of one frame). No factorisation is repeated.

mod chosen;
mod curve;
mod gcv;
mod l_curve;
mod noise_figure;
mod search;

pub use chosen::{ChosenHyperparameter, CurvePoint, HyperparameterStatus};
pub use noise_figure::NoiseTarget;

use super::spectrum::{Decomposition, Spectrum};
use crate::check::check_positive;
use crate::{InverseError, Reconstructor};
use ndarray::ArrayView2;

/// Rule that chooses lambda.
///
/// Frames are `[frame, measurement]`, volts, in protocol order. Several frames are pooled as
/// independent samples with one common lambda.
#[derive(Debug, Clone)]
pub enum HyperparameterChoice<'a> {
    /// Uses the given value.
    Fixed(f64),
    /// Chooses the lambda that gives the requested noise figure: 1 keeps the signal-to-noise ratio of
    /// the data, 0.5 doubles it. This rule needs no data, so lambda is fixed before measuring and
    /// does not change from frame to frame.
    ///
    /// ```text
    /// NF = (mean |dv_t| / sigma_v) / (mean |x_t| / sigma_x)
    /// sigma_v^2 = trace(noise covariance) / m,   mean |dv_t| = sum |dv_t,i| / m
    /// mean |x_t| = sum area |x_t| / sum area,    sigma_x^2 = sum area var(x) / sum area
    /// ```
    ///
    /// for the data `dv_t` of a small target and its image `x_t`. With elements of equal area this
    /// is the noise figure of EIDORS; the area weights make it independent of the mesh. Data is
    /// weighted by `W^1/2`, which has no effect if the noise is equal in all measurements. As lambda
    /// grows, the noise figure falls to a minimum (about 0.5 at lambda of order 1 for 16 electrodes)
    /// and then rises slightly. The falling branch is searched by bisection in log lambda until the
    /// noise figure is within 0.1 % of the requested value.
    ///
    /// Source: Adler, Guardo, *IEEE Trans. Med. Imaging* 15 (1996), 170-179; Graham, Adler,
    /// *Physiol. Meas.* 27 (2006), S65-S79.
    NoiseFigure {
        /// Requested noise figure, dimensionless.
        figure: f64,
        /// Small target that defines the signal.
        target: &'a NoiseTarget,
    },
    /// Chooses the corner of the L-curve, the point of largest curvature of log `|dsigma|_R` over
    /// log `|dv - J dsigma|_W`.
    ///
    /// The curvature is evaluated in closed form. The L-curve is known to over-regularise smooth
    /// images and is unreliable if the curve has no corner; inspect the returned curve.
    ///
    /// Source: Hansen, O'Leary, *SIAM J. Sci. Comput.* 14 (1993), 1487-1503; Hansen, *The L-curve
    /// and its use in the numerical treatment of inverse problems* (2001), section 5.
    LCurve {
        /// Frames, `[frame, measurement]`, volts.
        frames: ArrayView2<'a, f64>,
        /// Reference frame, `[measurement]`, volts.
        reference_frame: &'a [f64],
    },
    /// Minimises the generalised cross-validation function
    /// `|dv - J dsigma|_W^2 / (m - degrees of freedom)^2`, an estimate of how well left-out
    /// measurements are predicted. Requires noise that is independent between measurements.
    ///
    /// Source: Golub, Heath, Wahba, *Technometrics* 21 (1979), 215-223.
    Gcv {
        /// Frames, `[frame, measurement]`, volts.
        frames: ArrayView2<'a, f64>,
        /// Reference frame, `[measurement]`, volts.
        reference_frame: &'a [f64],
    },
}

impl HyperparameterChoice<'_> {
    pub(crate) fn evaluate(
        &self,
        reconstructor: &Reconstructor,
        spectrum: &Spectrum,
    ) -> Result<ChosenHyperparameter, InverseError> {
        match self {
            Self::Fixed(hyperparameter) => {
                check_positive("hyperparameter", *hyperparameter)?;
                Ok(ChosenHyperparameter {
                    hyperparameter: *hyperparameter,
                    status: HyperparameterStatus::Given,
                    criterion: f64::NAN,
                    curve: Vec::new(),
                })
            }
            Self::NoiseFigure { figure, target } => {
                noise_figure::choose(reconstructor, spectrum, *figure, target)
            }
            Self::LCurve { frames, reference_frame } => {
                let data = decompose(reconstructor, spectrum, *frames, reference_frame, "L-curve")?;
                Ok(l_curve::choose(spectrum, &data))
            }
            Self::Gcv { frames, reference_frame } => {
                let rule = "generalised cross-validation";
                let data = decompose(reconstructor, spectrum, *frames, reference_frame, rule)?;
                Ok(gcv::choose(spectrum, &data))
            }
        }
    }
}

/// Expands the weighted difference data of all frames in the eigenvectors.
fn decompose(
    reconstructor: &Reconstructor,
    spectrum: &Spectrum,
    frames: ArrayView2<'_, f64>,
    reference_frame: &[f64],
    rule: &'static str,
) -> Result<Decomposition, InverseError> {
    let mut data = reconstructor.differences(frames, reference_frame)?;
    for (i, w) in reconstructor.channels.root_weights.iter().enumerate() {
        data.row_mut(i).iter_mut().for_each(|b| *b *= w);
    }
    let parts = spectrum.decompose(data.as_ref());
    // data outside the range of the eigenvectors gives a zero image for every lambda
    if parts.squared.iter().sum::<f64>() > 0.0 {
        Ok(parts)
    } else {
        Err(InverseError::NoDifference { rule })
    }
}
