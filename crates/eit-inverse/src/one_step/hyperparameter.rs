//! Rules that choose the hyperparameter lambda.
//!
//! All of them evaluate closed sums over the spectrum: `O(r)` per lambda, the noise figure `O(r n)`
//! (one frame's work). Nothing is factorised again.

mod gcv;
mod l_curve;
mod noise_figure;
mod search;

pub use noise_figure::NoiseTarget;

use super::spectrum::{Decomposition, Spectrum};
use crate::check::check_positive;
use crate::{InverseError, Reconstructor};
use ndarray::ArrayView2;
use search::logarithmic_grid;

/// How lambda is chosen.
///
/// Frames are `[frame, measurement]`, volts, in protocol order; several are pooled as independent
/// draws with one common lambda.
#[derive(Debug, Clone)]
pub enum HyperparameterChoice<'a> {
    /// This value.
    Fixed(f64),
    /// The lambda at which the image is as noisy as asked: noise figure 1 keeps the signal to noise
    /// ratio of the data, 0.5 doubles it. It needs no data, so the choice is made before measuring
    /// and does not change from frame to frame.
    ///
    /// ```text
    /// NF = (mean |dv_t| / sigma_v) / (mean |x_t| / sigma_x)
    /// sigma_v^2 = trace(noise covariance) / m,   mean |dv_t| = sum |dv_t,i| / m
    /// mean |x_t| = sum area |x_t| / sum area,    sigma_x^2 = sum area var(x) / sum area
    /// ```
    ///
    /// for the data `dv_t` of a small target and its image `x_t`. With elements of equal area this
    /// is the figure as EIDORS computes it; the area weights make it independent of the mesh. Data
    /// is weighted by `W^1/2`, which changes nothing where the noise is equal. The figure falls as
    /// lambda grows, down to a least value (about 0.5 at lambda of order 1 for 16 electrodes), and
    /// rises a little beyond: the falling branch is searched. Bisection in log lambda until the
    /// figure is within 0.1 % of the wanted.
    ///
    /// Source: Adler, Guardo, *IEEE Trans. Med. Imaging* 15 (1996), 170-179; Graham, Adler,
    /// *Physiol. Meas.* 27 (2006), S65-S79.
    NoiseFigure {
        /// Wanted noise figure, dimensionless.
        figure: f64,
        /// The small target.
        target: &'a NoiseTarget,
    },
    /// The corner of the curve of log `|dsigma|_R` over log `|dv - J dsigma|_W`: its largest
    /// curvature.
    ///
    /// The curvature is evaluated in closed form. The corner is known to over-regularise smooth
    /// images and to miss where the curve has none; look at the returned curve.
    ///
    /// Source: Hansen, O'Leary, *SIAM J. Sci. Comput.* 14 (1993), 1487-1503; Hansen, *The L-curve
    /// and its use in the numerical treatment of inverse problems* (2001), section 5.
    LCurve {
        /// Frames, `[frame, measurement]`, volts.
        frames: ArrayView2<'a, f64>,
        /// Reference frame, `[measurement]`, volts.
        reference_frame: &'a [f64],
    },
    /// The smallest generalised cross-validation function,
    /// `|dv - J dsigma|_W^2 / (m - degrees of freedom)^2`: the lambda that predicts left-out
    /// measurements best. Needs noise that is independent between measurements.
    ///
    /// Source: Golub, Heath, Wahba, *Technometrics* 21 (1979), 215-223.
    Gcv {
        /// Frames, `[frame, measurement]`, volts.
        frames: ArrayView2<'a, f64>,
        /// Reference frame, `[measurement]`, volts.
        reference_frame: &'a [f64],
    },
}

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
    /// [`Report::noise_scale`](crate::Report::noise_scale) it counts standard deviations: where
    /// `noise_std` is right, noise alone gives the square the mean `frames * measurements_used`.
    pub residual_norm: f64,
    /// `|dsigma|_R`, root of the sum over frames, siemens times the unit of the root of `R`.
    pub solution_norm: f64,
    /// Noise figure, curvature of the L-curve, or generalised cross-validation function.
    pub criterion: f64,
}

/// A chosen hyperparameter.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Chosen {
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

impl HyperparameterChoice<'_> {
    pub(crate) fn evaluate(
        &self,
        reconstructor: &Reconstructor,
        spectrum: &Spectrum,
    ) -> Result<Chosen, InverseError> {
        match self {
            Self::Fixed(hyperparameter) => {
                check_positive("hyperparameter", *hyperparameter)?;
                Ok(Chosen {
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

/// Weighted difference data of all frames in the eigenvectors.
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
    // data outside the range gives a zero image for every lambda: nothing to choose by
    if parts.squared.iter().sum::<f64>() > 0.0 {
        Ok(parts)
    } else {
        Err(InverseError::NoDifference { rule })
    }
}

/// The curve of a rule over the whole range.
fn curve(
    spectrum: &Spectrum,
    data: &Decomposition,
    mut criterion: impl FnMut(f64) -> f64,
) -> Vec<CurvePoint> {
    logarithmic_grid(spectrum.hyperparameter_range())
        .into_iter()
        .map(|hyperparameter| CurvePoint {
            hyperparameter,
            residual_norm: data.squared_residual(spectrum, hyperparameter).sqrt(),
            solution_norm: data.squared_seminorm(spectrum, hyperparameter).sqrt(),
            criterion: criterion(hyperparameter),
        })
        .collect()
}
