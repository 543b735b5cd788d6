//! Position directly from a frame: kernel ridge regression, the mean of a Gaussian process.
//!
//! ```text
//! z = (x / |x| - mean) / std            or without the last step: chosen by leave-one-out
//! place(z) = mu + k(z)' (K + lambda I)^-1 (P - mu),   k: Matern 5/2 of width w
//! ```
//!
//! Leave-one-out errors have a closed form, so each pair of parameters costs one inverse. The method needs
//! no model of the skin. It handles only one touch at a time and complete frames, since distances between
//! frames are taken over all channels.
//!
//! Source: Rasmussen, Williams, *Gaussian Processes for Machine Learning* (2006), sections 2.7 and 5.4.2.

use super::choose::{FoldErrors, LEAST_PRESSES, quantile};
use super::presses::Presses;
use super::response_map::{inverse, unit_rows};
use crate::InverseError;
use crate::check::check_length;
use faer::Mat;
use ndarray::{Array1, Array2, ArrayView1, Axis};

/// Squared kernel widths relative to the median squared distance of frames, and ridges, to try.
const WIDTHS: [f64; 7] = [0.3, 0.7, 1.5, 3.0, 6.0, 12.0, 30.0];
const RIDGES: [f64; 6] = [1e-6, 1e-4, 1e-3, 1e-2, 0.1, 0.5];

/// Parameters of a [`PlaceRegression`]; [`PlaceRegression::learn`] chooses them.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PlaceRegressionSettings {
    /// Whether channels are standardised.
    pub is_standardised: bool,
    /// Squared width of the kernel relative to the median squared distance of the learnt frames.
    pub width2: f64,
    /// Ridge added to the diagonal of the kernel matrix.
    pub ridge: f64,
}

/// A learnt map from frame to position.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct PlaceRegression {
    /// Parameters.
    pub settings: PlaceRegressionSettings,
    /// Subtracted from a frame scaled to length 1, `[channel]`.
    pub centre: Vec<f64>,
    /// Factor applied after that, `[channel]`.
    pub scale: Vec<f64>,
    /// Learnt frames after both steps, `[press, channel]`.
    pub learnt: Array2<f64>,
    /// Weights of the learnt frames, `[press, 3]`, metres.
    pub weights: Array2<f64>,
    /// Position returned for a frame unlike all learnt ones, metres.
    pub mean_m: [f64; 3],
    /// Squared width of the kernel.
    pub width2: f64,
    /// Variance of each coordinate for a frame unlike all learnt ones, square metres.
    pub variance_m2: f64,
    inverse: Array2<f64>,
}

/// A position from regression.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct PlaceEstimate {
    /// Position, metres.
    pub position_m: [f64; 3],
    /// Standard deviation of each coordinate, metres.
    pub std_m: f64,
}

impl PlaceRegression {
    /// Learns from presses, with parameters that minimise the leave-one-out mean distance.
    ///
    /// # Errors
    /// Fewer than four presses, identical frames, or non-finite values.
    pub fn learn(presses: &Presses) -> Result<(Self, FoldErrors), InverseError> {
        presses.validate(LEAST_PRESSES)?;
        let mut best: Option<(f64, Self, FoldErrors)> = None;
        for is_standardised in [true, false] {
            let frames = Frames::new(presses, is_standardised)?;
            for width2 in WIDTHS {
                for ridge in RIDGES {
                    let settings = PlaceRegressionSettings { is_standardised, width2, ridge };
                    // skip kernels that are singular by rounding
                    let Ok((made, errors_m)) = frames.fit(settings) else { continue };
                    let score = errors_m.iter().sum::<f64>();
                    if score.is_finite() && best.as_ref().is_none_or(|(least, ..)| score < *least) {
                        best = Some((score, made, FoldErrors { errors_m }));
                    }
                }
            }
        }
        let (_, made, errors) =
            best.ok_or(InverseError::PressesAtOnePlace { presses: presses.places_m.len() })?;
        Ok((made, errors))
    }

    /// Learns with given parameters.
    ///
    /// # Errors
    /// As [`PlaceRegression::learn`], or a singular kernel.
    pub fn with_settings(
        presses: &Presses,
        settings: PlaceRegressionSettings,
    ) -> Result<Self, InverseError> {
        presses.validate(LEAST_PRESSES)?;
        Ok(Frames::new(presses, settings.is_standardised)?.fit(settings)?.0)
    }

    /// Returns the position of a touch from a complete frame of differences, `[channel]`.
    ///
    /// # Errors
    /// A wrong length, or a frame that is zero or not finite.
    pub fn place(&self, difference: &[f64]) -> Result<PlaceEstimate, InverseError> {
        check_length("frame", difference.len(), self.centre.len())?;
        let length = difference.iter().map(|v| v * v).sum::<f64>().sqrt();
        if !(length > 0.0 && length.is_finite()) {
            return Err(InverseError::EmptyPress { press: 0 });
        }
        let parts = difference.iter().zip(&self.centre).zip(&self.scale);
        let frame: Array1<f64> = parts.map(|((v, c), s)| (v / length - c) * s).collect();
        let near = |row: ArrayView1<'_, f64>| {
            let squared: f64 = row.iter().zip(&frame).map(|(a, b)| (a - b).powi(2)).sum();
            matern(squared / self.width2)
        };
        let kernel: Array1<f64> = self.learnt.rows().into_iter().map(near).collect();
        let place = kernel.dot(&self.weights);
        let unknown = 1.0 + self.settings.ridge - kernel.dot(&self.inverse.dot(&kernel));
        Ok(PlaceEstimate {
            position_m: std::array::from_fn(|k| self.mean_m[k] + place[k]),
            std_m: (self.variance_m2 * unknown.max(0.0)).sqrt(),
        })
    }
}

/// Matern 5/2 kernel of a squared distance divided by the squared width.
fn matern(squared: f64) -> f64 {
    let d = (5.0 * squared).sqrt();
    (1.0 + d + d * d / 3.0) * (-d).exp()
}

fn normalisation(unit: &Array2<f64>, is_standardised: bool) -> (Array1<f64>, Array1<f64>) {
    let channels = unit.ncols();
    if !is_standardised {
        return (Array1::zeros(channels), Array1::ones(channels));
    }
    let centre = unit.mean_axis(Axis(0)).unwrap_or_else(|| Array1::zeros(channels));
    let std = unit.std_axis(Axis(0), 0.0);
    // a channel that never changes carries no information
    (centre, std.mapv(|s| if s > 0.0 { s.recip() } else { 0.0 }))
}

fn squared_distances(rows: &Array2<f64>) -> Array2<f64> {
    let products = rows.dot(&rows.t());
    Array2::from_shape_fn(products.dim(), |(i, j)| {
        (products[[i, i]] + products[[j, j]] - 2.0 * products[[i, j]]).max(0.0)
    })
}

/// Normalised frames and their distances.
struct Frames {
    centre: Array1<f64>,
    scale: Array1<f64>,
    learnt: Array2<f64>,
    squared: Array2<f64>,
    median2: f64,
    places: Array2<f64>,
}

impl Frames {
    fn new(presses: &Presses, is_standardised: bool) -> Result<Self, InverseError> {
        let unit = unit_rows(&presses.frames).0;
        let (centre, scale) = normalisation(&unit, is_standardised);
        let learnt = (&unit - &centre) * &scale;
        let squared = squared_distances(&learnt);
        let upper = squared.indexed_iter().filter(|((i, j), _)| i < j);
        let upper: Vec<f64> = upper.map(|(_, squared)| *squared).collect();
        let median2 = quantile(&upper, 0.5);
        if median2 <= 0.0 {
            return Err(InverseError::PressesAtOnePlace { presses: presses.places_m.len() });
        }
        let places = Array2::from_shape_fn((unit.nrows(), 3), |(i, k)| presses.places_m[i][k]);
        Ok(Self { centre, scale, learnt, squared, median2, places })
    }

    /// Fits the regression and returns it with its leave-one-out errors, metres.
    fn fit(
        &self,
        settings: PlaceRegressionSettings,
    ) -> Result<(PlaceRegression, Vec<f64>), InverseError> {
        let (count, places) = (self.squared.nrows(), &self.places);
        let width2 = settings.width2 * self.median2;
        let kernel = Mat::from_fn(count, count, |i, j| {
            let ridge = if i == j { settings.ridge } else { 0.0 };
            matern(self.squared[[i, j]] / width2) + ridge
        });
        let inverse = inverse(&kernel)?;
        // generalised least squares for the constant
        let sums = inverse.sum_axis(Axis(1));
        let whole = sums.sum();
        let mean = sums.dot(places) / whole;
        let weights = inverse.dot(&(places - &mean));
        let error_m = |i: usize| {
            let own = inverse[[i, i]] - sums[i] * sums[i] / whole;
            (0..3).map(|k| (weights[[i, k]] / own).powi(2)).sum::<f64>().sqrt()
        };
        let errors_m = (0..count).map(error_m).collect();
        // for two coordinates, since presses lie on a skin
        let variance_m2 = ((places - &mean) * &weights).sum() / (2 * count) as f64;
        let made = PlaceRegression {
            settings,
            centre: self.centre.to_vec(),
            scale: self.scale.to_vec(),
            learnt: self.learnt.clone(),
            mean_m: std::array::from_fn(|k| mean[k]),
            weights,
            width2,
            variance_m2,
            inverse,
        };
        Ok((made, errors_m))
    }
}
