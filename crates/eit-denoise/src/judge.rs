//! Whether to show a net's image, the raw one, or to say that neither explains the measurements.

use crate::model_error::ModelErrorNorm;
use crate::{DataConsistency, DataMisfit, DenoiseError, Weights};
use ndarray::ArrayView2;

/// Largest fraction of the data's energy that a correct image leaves unexplained on a skin whose model error
/// the weights do not contain: on six simulated recordings true images left 4 to 29 % in the median and up to 35 % in nine frames of
/// ten; images of the wrong sign leave all of it and more.
const SHARE_OF_OTHER_SKINS: f64 = 0.66;

/// Compares a net's image with the raw one by their residuals, in units of noise and model error.
#[derive(Debug, Clone)]
pub struct Judge {
    consistency: DataConsistency,
    rule: Rule,
    noise_std: Vec<f64>,
    left: Vec<f64>,
}

#[derive(Debug, Clone)]
enum Rule {
    /// Weights that contain the model error of their skin.
    ModelError(Box<ModelErrorNorm>),
    /// Older weights, and other skins: the largest fraction of the data's energy that a correct image leaves
    /// unexplained.
    Share(f64),
    /// Weights that contain neither.
    None,
}

/// Which image of a frame to show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Verdict {
    /// The net's image: it explains the measurements, or the weights have no rule to judge it by.
    #[default]
    Net,
    /// The raw image: it explains the measurements, and the net's does not.
    Raw,
    /// The raw image, although neither explains the measurements.
    Neither,
}

/// A verdict with its scores: an image explains its measurements up to a score of 1.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Judgement {
    /// Which image to show.
    pub verdict: Verdict,
    /// Score of the net's image; 0 where the weights have no rule.
    pub net: f64,
    /// Score of the raw image, computed only where the net's image fails.
    pub raw: Option<f64>,
}

impl Judge {
    /// Prepares the rule of these weights; see [`DataConsistency::new`] for the other arguments. A model
    /// error for another number of measurements is not used; a share of the data's energy takes its place.
    ///
    /// # Errors
    /// Those of [`DataConsistency::new`] and [`ModelErrorNorm::new`].
    pub fn new(
        weights: &Weights,
        jacobian: ArrayView2<'_, f64>,
        noise_std: &[f64],
        mask: ArrayView2<'_, bool>,
    ) -> Result<Self, DenoiseError> {
        let error = weights.model_error.as_ref();
        match error.filter(|error| error.directions.ncols() == noise_std.len()) {
            Some(error) => {
                let rule = Rule::ModelError(Box::new(ModelErrorNorm::new(error)?));
                Self::with_rule(rule, jacobian, noise_std, mask)
            }
            None => Self::on_another_skin(weights, jacobian, noise_std, mask),
        }
    }

    /// Prepares these weights for another skin than that of their training. Their model error does
    /// not apply there: a fraction of the data's energy takes its place. See [`new`](Self::new) for
    /// the arguments.
    ///
    /// # Errors
    ///
    /// Those of [`DataConsistency::new`].
    pub fn on_another_skin(
        weights: &Weights,
        jacobian: ArrayView2<'_, f64>,
        noise_std: &[f64],
        mask: ArrayView2<'_, bool>,
    ) -> Result<Self, DenoiseError> {
        let rule = match weights.model_error {
            Some(_) => Rule::Share(SHARE_OF_OTHER_SKINS),
            None => Rule::None,
        };
        Self::with_rule(rule, jacobian, noise_std, mask)
    }

    fn with_rule(
        rule: Rule,
        jacobian: ArrayView2<'_, f64>,
        noise_std: &[f64],
        mask: ArrayView2<'_, bool>,
    ) -> Result<Self, DenoiseError> {
        let consistency = DataConsistency::new(jacobian, noise_std, mask)?;
        let (noise_std, left) = (noise_std.to_vec(), vec![0.0; noise_std.len()]);
        Ok(Self { consistency, rule, noise_std, left })
    }

    /// The rule in words.
    pub fn description(&self) -> String {
        match &self.rule {
            Rule::ModelError(norm) => format!(
                "more than {:.0} % of their energy left outside noise and model error",
                100.0 * norm.limit()
            ),
            Rule::Share(limit) => format!("more than {:.0} % of their energy left", 100.0 * limit),
            Rule::None => "no rule".to_owned(),
        }
    }

    /// The limit that scores are relative to: a part of the data's energy.
    pub fn limit(&self) -> Option<f64> {
        match &self.rule {
            Rule::ModelError(norm) => Some(norm.limit()),
            Rule::Share(limit) => Some(*limit),
            Rule::None => None,
        }
    }

    /// Energy of a frame's differences in units of the noise.
    ///
    /// # Errors
    /// Those of [`DataConsistency::energy`].
    pub fn energy(&self, differences: &[f64]) -> Result<DataMisfit, DenoiseError> {
        self.consistency.energy(differences)
    }

    /// Judges the images [row, column] of a frame by its differences; values that are not finite are
    /// missing measurements. Does not allocate.
    ///
    /// # Errors
    /// Those of [`DataConsistency::misfit`].
    pub fn judge(
        &mut self,
        net: ArrayView2<'_, f64>,
        raw: ArrayView2<'_, f64>,
        differences: &[f64],
    ) -> Result<Judgement, DenoiseError> {
        let of_net = self.score(net, differences)?;
        if of_net <= 1.0 {
            return Ok(Judgement { verdict: Verdict::Net, net: of_net, raw: None });
        }
        let of_raw = self.score(raw, differences)?;
        let verdict = if of_raw <= 1.0 { Verdict::Raw } else { Verdict::Neither };
        Ok(Judgement { verdict, net: of_net, raw: Some(of_raw) })
    }

    /// Judges a frame whose touches are known to explain it: the net's image is shown, whatever its
    /// score.
    ///
    /// # Errors
    ///
    /// Those of [`DataConsistency::misfit`].
    pub fn accept(
        &mut self,
        net: ArrayView2<'_, f64>,
        differences: &[f64],
    ) -> Result<Judgement, DenoiseError> {
        Ok(Judgement { verdict: Verdict::Net, net: self.score(net, differences)?, raw: None })
    }

    /// Judges a frame that is known not to be explained by touches: the net's image is not shown,
    /// whatever its score.
    ///
    /// # Errors
    ///
    /// Those of [`DataConsistency::misfit`].
    pub fn reject(
        &mut self,
        net: ArrayView2<'_, f64>,
        raw: ArrayView2<'_, f64>,
        differences: &[f64],
    ) -> Result<Judgement, DenoiseError> {
        let (net, of_raw) = (self.score(net, differences)?, self.score(raw, differences)?);
        let verdict = if of_raw <= 1.0 { Verdict::Raw } else { Verdict::Neither };
        Ok(Judgement { verdict, net, raw: Some(of_raw) })
    }

    /// Score of an image: up to 1 it explains the frame.
    ///
    /// # Errors
    /// Those of [`DataConsistency::misfit`].
    pub fn score(
        &mut self,
        image: ArrayView2<'_, f64>,
        differences: &[f64],
    ) -> Result<f64, DenoiseError> {
        let Self { consistency, rule, noise_std, left } = self;
        match rule {
            Rule::None => Ok(0.0),
            Rule::Share(limit) => Ok(consistency.misfit(image, differences)?.score(*limit)),
            Rule::ModelError(norm) => {
                consistency.left_into(image, differences, left)?;
                norm.score(left, differences, noise_std)
            }
        }
    }
}
