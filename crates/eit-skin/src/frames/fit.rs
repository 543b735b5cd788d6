//! Checks whether the homogeneous model explains the reference frame: sign, size, correlation.

use super::Frames;
use crate::error::SkinError;
use crate::scene::DifferenceKind;

/// How well the homogeneous model explains a reference frame.
#[derive(Debug, Clone, Copy)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ModelFit {
    /// Factor `g` of the best fit `v_ref = g v0`.
    pub gain: f64,
    /// Cosine of the angle between the two.
    pub correlation: f64,
}

impl Frames {
    /// Compares the reference with the model's voltages. A wrong sign inverts plain differences, which
    /// reciprocity cannot detect.
    ///
    /// # Errors
    ///
    /// A reference frame that is zero in every used measurement, and one of the opposite sign.
    pub fn fit_model(
        &mut self,
        model_voltages: &[f64],
        kind: DifferenceKind,
        conductivity_s: f64,
    ) -> Result<ModelFit, SkinError> {
        let usable = |values: &[f64]| -> Vec<f64> {
            values.iter().zip(&self.used).filter(|(_, used)| **used).map(|(v, _)| *v).collect()
        };
        let (model, reference) = (usable(model_voltages), usable(&self.reference));
        let Some(correlation) = eit_hw::model_correlation(&reference, &model) else {
            return Err(SkinError::input("the reference frame is zero in every used measurement"));
        };
        let product: f64 = model.iter().zip(&reference).map(|(m, r)| m * r).sum();
        let gain = product / model.iter().map(|m| m * m).sum::<f64>();
        let plain = kind == DifferenceKind::Plain;
        if plain && correlation < -0.5 {
            return Err(SkinError::input(format!(
                "the reference frame has the opposite sign of the model (correlation \
                 {correlation:.3}): images would be inverted; set [recording] scale = -1"
            )));
        }
        if correlation.abs() < 0.9 {
            self.notes.push(format!(
                "the homogeneous model explains the reference poorly (correlation \
                 {correlation:.3}): check the protocol and the number and order of electrodes"
            ));
        } else if plain && !(0.5..=2.0).contains(&gain) {
            self.notes.push(format!(
                "voltages are {gain:.3} times the model's, so image values are off: set \
                 [skin] conductivity_s = {:.3e}, or [recording] scale",
                conductivity_s / gain
            ));
        }
        Ok(ModelFit { gain, correlation })
    }
}
