//! Checks whether the homogeneous model explains the reference frame: sign, size, correlation.

use super::Frames;
use crate::error::SkinError;
use crate::scene::{DifferenceKind, ValueKind};

/// How well the homogeneous model explains a reference frame.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub struct ModelFit {
    /// Factor `g` of the best fit `v_ref = g v0`.
    pub gain: f64,
    /// Cosine of the angle between the two.
    pub correlation: f64,
    /// Standard deviation of `ln |v_ref / v0|` over the used measurements: 0.05 for a sheet that is uneven by 5 %,
    /// above 0.7 if the instrument's levels are not those of the model by a factor of two either way.
    pub level_scatter: f64,
}

/// Scatter of the levels above which the smallest of them carry no information.
const SCATTERED: f64 = 0.7;

/// Factor by which the correlation must come closer to 1 with another reading of the values: an uneven sheet leaves as much as
/// before.
const MUCH_BETTER: f64 = 5.0;

/// Reciprocity error up to which the order of the measurements is right (as in [`eit_hw::recognise_order`]).
const ORDERED: f64 = 0.2;

/// Size of the correlation below which the voltages are not those of the scene's skin.
pub(crate) const ALIKE: f64 = 0.9;

impl ModelFit {
    /// Returns whether the reference frame resembles the model; it does not if the electrodes are
    /// in another order.
    pub fn is_alike(&self) -> bool {
        self.correlation.abs() >= ALIKE
    }

    /// Returns whether the reference frame has other levels than the model: a signal path that the model does not
    /// describe, or channels of very different gain.
    pub fn is_scattered(&self) -> bool {
        self.level_scatter > SCATTERED
    }

    /// Says that the reference has other levels than the model.
    fn scatter_note(&self) -> Option<String> {
        self.is_scattered().then(|| {
            format!(
                "measured and modelled levels differ by a factor of {:.1} from measurement to measurement: one-step \
                 images weight them by the reference frame and are as smooth as possible",
                self.level_scatter.exp()
            )
        })
    }

    /// Says what to check where the reference does not resemble the model, or does so much better as another kind of
    /// value.
    fn poor_note(&self, other: Option<(ValueKind, f64)>, reciprocity_error: Option<f64>) -> String {
        let poorly = format!(
            "the homogeneous model explains the reference poorly (correlation {:.3})",
            self.correlation
        );
        match (other, reciprocity_error.filter(|error| *error <= ORDERED)) {
            (Some((kind, better)), _) => {
                let (name, meaning) = kind.name();
                format!(
                    "{poorly}, and well if the values are {meaning} (correlation {better:.3}): set \
                     [recording] values = \"{name}\""
                )
            }
            (None, Some(error)) => format!(
                "{poorly}, although the order of the measurements is right (reciprocity error {:.1} %): check the number \
                 and places of electrodes and which one is the first, and what the values are ([recording] values)",
                100.0 * error
            ),
            (None, None) => {
                format!("{poorly}: check the protocol and the number and order of electrodes")
            }
        }
    }

    /// Says what a gain far from 1 means for the images.
    fn gain_note(&self, is_plain: bool, conductivity_s: f64) -> Option<String> {
        let (gain, usual) = (self.gain, 0.5..=2.0);
        if is_plain && !usual.contains(&gain) {
            return Some(format!(
                "voltages are {gain:.3} times the model's, so image values are off: set \
                 [skin] conductivity_s = {:.3e}, or [recording] scale",
                conductivity_s / gain
            ));
        }
        (!usual.contains(&gain.abs())).then(|| {
            format!(
                "voltages are {:.3e} times the model's: another conductivity, current or unit. Places of touches and \
                 their least strength allow for it; strengths (intensity) are those of a sheet of {:.3e} S per square, \
                 so compare them only with others of this skin and unit. Set [skin] conductivity_s, or [recording] \
                 scale if the unit (1e-3 for millivolts) or the current is another",
                gain.abs(),
                conductivity_s / gain.abs()
            )
        })
    }
}

impl Frames {
    /// Compares the reference with the model's voltages, magnitudes with magnitudes if differences are normalised. A wrong
    /// sign inverts plain differences, which reciprocity cannot detect.
    ///
    /// # Errors
    ///
    /// A reference frame that is zero in every used measurement, and one of the opposite sign.
    pub(crate) fn fit_model(
        &mut self,
        model_voltages: &[f64],
        kind: DifferenceKind,
        conductivity_s: f64,
        values: ValueKind,
    ) -> Result<ModelFit, SkinError> {
        let usable = |values: &[f64]| -> Vec<f64> {
            values.iter().zip(&self.used).filter(|(_, used)| **used).map(|(v, _)| *v).collect()
        };
        let (mut model, reference) = (usable(model_voltages), usable(&self.reference));
        // normalised differences of magnitudes are those of the voltages
        if kind == DifferenceKind::Normalised && are_magnitudes(&reference) {
            model.iter_mut().for_each(|v| *v = v.abs());
        }
        let Some(correlation) = eit_hw::model_correlation(&reference, &model) else {
            return Err(SkinError::input("the reference frame is zero in every used measurement"));
        };
        let product: f64 = model.iter().zip(&reference).map(|(m, r)| m * r).sum();
        let gain = product / model.iter().map(|m| m * m).sum::<f64>();
        let level_scatter = level_scatter(&reference, &model);
        let plain = kind == DifferenceKind::Plain;
        if plain && correlation < -0.5 {
            return Err(SkinError::input(format!(
                "the reference frame has the opposite sign of the model (correlation \
                 {correlation:.3}): images would be inverted; set [recording] scale = -1"
            )));
        }
        let fit = ModelFit { gain, correlation, level_scatter };
        self.notes.extend(fit.scatter_note());
        let other = other_kind(&reference, &model, values);
        let other =
            other.filter(|(_, found)| MUCH_BETTER * (1.0 - found) < 1.0 - correlation.abs());
        self.notes.extend(match fit.is_alike() && other.is_none() {
            true => fit.gain_note(plain, conductivity_s),
            false => Some(fit.poor_note(other, self.reciprocity_error)),
        });
        Ok(fit)
    }
}

/// What the values may be instead, if the model then explains them, and the correlation.
fn other_kind(reference: &[f64], model: &[f64], values: ValueKind) -> Option<(ValueKind, f64)> {
    if values != ValueKind::Voltage {
        return None;
    }
    let model: Vec<f64> = model.iter().map(|v| v.abs()).collect();
    let others = ValueKind::ALL.into_iter().filter(|kind| *kind != values);
    let tried = others.filter_map(|kind| {
        let voltages: Vec<f64> = reference.iter().map(|v| kind.voltage(*v).abs()).collect();
        let is_known = voltages.iter().all(|v| v.is_finite());
        let correlation = eit_hw::model_correlation(&voltages, &model).filter(|_| is_known)?;
        Some((kind, correlation))
    });
    tried.filter(|(_, found)| *found >= ALIKE).max_by(|a, b| a.1.total_cmp(&b.1))
}

/// Whether values are magnitudes, which say nothing of signs.
pub(crate) fn are_magnitudes<'a>(values: impl IntoIterator<Item = &'a f64>) -> bool {
    values.into_iter().all(|v| *v >= 0.0)
}

/// Standard deviation of the logarithm of the ratios; 0 if fewer than two are known.
fn level_scatter(reference: &[f64], model: &[f64]) -> f64 {
    let ratios = reference.iter().zip(model).map(|(r, m)| (r / m).abs().ln());
    let known: Vec<f64> = ratios.filter(|ratio| ratio.is_finite()).collect();
    if known.len() < 2 {
        return 0.0;
    }
    let count = known.len() as f64;
    let mean = known.iter().sum::<f64>() / count;
    (known.iter().map(|ratio| (ratio - mean).powi(2)).sum::<f64>() / count).sqrt()
}
