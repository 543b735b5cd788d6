//! Noise figure.

use super::chosen::{ChosenHyperparameter, CurvePoint, HyperparameterStatus};
use super::curve::curve;
use crate::check::{check_length, check_positive};
use crate::geometry::{distance_m, extent_m};
use crate::one_step::spectrum::Spectrum;
use crate::{InverseError, Reconstructor};
use eit_mesh::Surface;
use faer::{Col, ColRef};
use ndarray::ArrayRef2;

/// Radius of the central target relative to the extent of the skin; small compared with the
/// resolution of EIT.
const TARGET_RADIUS: f64 = 0.05;

/// Relative accuracy of the noise figure at which bisection stops.
const ACCURACY: f64 = 1e-3;

/// Maximum number of bisections in log lambda; 60 exhaust double precision for any bracket.
const MAX_HALVINGS: usize = 60;

/// Small target whose signal defines the noise figure.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct NoiseTarget {
    /// Change of each measurement caused by the target, volts, `[measurement]`.
    pub signal_v: Vec<f64>,
    /// Element areas, square metres, `[element]`.
    pub areas_m2: Vec<f64>,
}

impl NoiseTarget {
    /// Creates a target of 1 S at the centre of the skin, with the signal given by the Jacobian
    /// `[measurement, element]`.
    ///
    /// The target consists of the elements whose distance from the area centroid (on a ring-shaped
    /// skin, from the nearest place on the skin) is within 5 % of the skin's extent. Its amplitude
    /// cancels in the noise figure.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`] if the Jacobian belongs to another mesh.
    pub fn central(surface: &Surface, jacobian: &ArrayRef2<f64>) -> Result<Self, InverseError> {
        let areas_m2 = surface.areas_m2().to_vec();
        check_length("Jacobian columns", jacobian.ncols(), areas_m2.len())?;
        let centroids = surface.centroids();
        let total: f64 = areas_m2.iter().sum();
        let middle: [f64; 3] = std::array::from_fn(|k| {
            centroids.iter().zip(&areas_m2).map(|(c, a)| c[k] * a).sum::<f64>() / total
        });
        let nearest = centroids
            .iter()
            .copied()
            .min_by(|a, b| distance_m(*a, middle).total_cmp(&distance_m(*b, middle)))
            .unwrap_or(middle);
        let centre = if distance_m(nearest, middle) > TARGET_RADIUS * extent_m(surface) {
            nearest
        } else {
            middle
        };
        let radius_m = (TARGET_RADIUS * extent_m(surface)).max(distance_m(nearest, centre));
        let inside: Vec<usize> = (0..centroids.len())
            .filter(|&e| distance_m(centroids[e], centre) <= radius_m)
            .collect();
        let signal_v =
            jacobian.rows().into_iter().map(|row| inside.iter().map(|&e| row[e]).sum()).collect();
        Ok(Self { signal_v, areas_m2 })
    }
}

pub(super) fn choose(
    reconstructor: &Reconstructor,
    spectrum: &Spectrum,
    figure: f64,
    target: &NoiseTarget,
) -> Result<ChosenHyperparameter, InverseError> {
    check_positive("noise figure", figure)?;
    let figure_of = NoiseFigure::new(reconstructor, spectrum, target)?;
    let data = spectrum.decompose(figure_of.signal.as_mat());
    let curve = curve(spectrum, &data, |h| figure_of.at(h));
    let nearest = |a: &&CurvePoint, b: &&CurvePoint| {
        let miss = |p: &CurvePoint| (p.criterion / figure).ln().abs();
        miss(a).total_cmp(&miss(b))
    };
    // Use the falling branch only. Beyond its minimum the noise figure rises again towards that of
    // the matched filter, and may fall once more when almost no degree of freedom is left. Of several
    // crossings, take the first.
    let crossing = curve.windows(2).find(|w| w[0].criterion > figure && w[1].criterion <= figure);
    let (hyperparameter, status) = match crossing {
        Some(pair) => {
            let bracket = [pair[0].hyperparameter, pair[1].hyperparameter];
            (figure_of.bisect(figure, bracket), HyperparameterStatus::NoiseFigureReached)
        }
        None => {
            let nearest = curve.iter().min_by(nearest).map_or(f64::NAN, |p| p.hyperparameter);
            (nearest, HyperparameterStatus::NoiseFigureUnreachable)
        }
    };
    Ok(ChosenHyperparameter {
        hyperparameter,
        status,
        criterion: figure_of.at(hyperparameter),
        curve,
    })
}

/// Noise figure as a function of lambda.
struct NoiseFigure<'a> {
    reconstructor: &'a Reconstructor,
    spectrum: &'a Spectrum,
    /// Weighted signal `b = W^1/2 dv_t`, `[used measurement]`.
    signal: Col<f64>,
    /// `U' b`, `[rank]`.
    coefficients: Col<f64>,
    /// `area / total area`, `[element]`.
    area_shares: Vec<f64>,
    /// `sum area_share B_ek^2`, `[rank]`: image noise contributed by eigenvector k.
    noise: Vec<f64>,
}

impl<'a> NoiseFigure<'a> {
    fn new(
        reconstructor: &'a Reconstructor,
        spectrum: &'a Spectrum,
        target: &NoiseTarget,
    ) -> Result<Self, InverseError> {
        let channels = &reconstructor.channels;
        check_length("signal_v", target.signal_v.len(), channels.count)?;
        check_length("areas_m2", target.areas_m2.len(), reconstructor.image_len())?;
        let total: f64 = target.areas_m2.iter().sum();
        check_positive("total area of areas_m2", total)?;
        let area_shares: Vec<f64> = target.areas_m2.iter().map(|a| a / total).collect();
        let signal = Col::from_fn(channels.used.len(), |k| {
            channels.row_factor(k) * target.signal_v[channels.used[k]]
        });
        let coefficients = spectrum.vectors.transpose() * &signal;
        let size = coefficients.norm_l2();
        if !(size > 0.0 && size.is_finite()) {
            return Err(InverseError::NoDifference { rule: "noise figure" });
        }
        let basis = reconstructor.image_rows();
        let mut noise = vec![0.0; spectrum.values.len()];
        for (e, share) in area_shares.iter().enumerate() {
            noise.iter_mut().zip(basis.row(e).iter()).for_each(|(n, b)| *n += share * b * b);
        }
        Ok(Self { reconstructor, spectrum, signal, coefficients, area_shares, noise })
    }

    /// Returns the noise figure at a given lambda.
    fn at(&self, hyperparameter: f64) -> f64 {
        let filter = self.spectrum.filter(hyperparameter);
        let noise: f64 = self.noise.iter().zip(&filter).map(|(n, f)| n * f * f).sum();
        let filtered: Vec<f64> =
            self.coefficients.iter().zip(&filter).map(|(c, f)| c * f).collect();
        let image = self.reconstructor.image_rows() * ColRef::from_slice(&filtered);
        let mean: f64 = image.iter().zip(&self.area_shares).map(|(x, a)| x.abs() * a).sum();
        let signal = self.signal.norm_l1() / self.signal.nrows() as f64;
        signal * noise.sqrt() / mean
    }

    /// Bisects a bracket in log lambda until the requested noise figure is reached.
    fn bisect(&self, figure: f64, bracket: [f64; 2]) -> f64 {
        let [mut low, mut high] = bracket.map(f64::ln);
        let side = |log: f64| self.at(log.exp()) > figure;
        let low_side = side(low);
        let mut middle = 0.5 * (low + high);
        for _ in 0..MAX_HALVINGS {
            middle = 0.5 * (low + high);
            if (self.at(middle.exp()) / figure - 1.0).abs() < ACCURACY {
                break;
            }
            if side(middle) == low_side { low = middle } else { high = middle }
        }
        middle.exp()
    }
}
