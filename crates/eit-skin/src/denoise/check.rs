//! Whether a net's images explain the measurements behind them.

use super::trust::Trust;
use super::{DrawnTouches, Net};
use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::linearised::LinearisedSkin;
use crate::noise::DataNoise;
use crate::progress::Progress;
use crate::touches::{self, Touches};
use eit_denoise::{DataMisfit, Judge, Judgement, Verdict};
use ndarray::{Array2, ArrayView2};
use serde_json::{Value, json};
use std::sync::Arc;

/// The measurements that a sequence of images was made from.
#[derive(Debug, Clone)]
pub struct Check {
    fitted: FittedFrames,
    /// Differences [frame, measurement], NaN where a value is missing.
    differences: Array2<f64>,
    /// Touches of each frame; `None` if they have not been sought.
    touches: Option<Vec<DrawnTouches>>,
}

/// Judges one net's images of a sequence.
#[derive(Debug)]
pub(super) struct SequenceJudge<'a> {
    check: &'a Check,
    judge: Judge,
    /// Whether touches explain each frame; empty for nets that do not see them.
    is_explained: Vec<bool>,
    /// Frames whose raw image is constant, so that there is no other.
    constant: Vec<usize>,
    trust: Trust,
}

impl Check {
    /// Takes the measurements of these frames.
    pub fn new(fitted: &FittedFrames) -> Self {
        let differences = fitted.differences_or_nan();
        Self { fitted: fitted.clone(), differences, touches: None }
    }

    /// Takes the touches that were found in the frames, so that a net that sees them needs not seek them again.
    pub fn with_touches(self, touches: &Touches) -> Self {
        let touches = DrawnTouches::of_frames(touches, self.fitted.image_per_strength());
        Self { touches: Some(touches), ..self }
    }

    /// Returns the touches of each frame; `None` if the noise of the data is unknown, so that none can be sought.
    ///
    /// # Errors
    ///
    /// The errors of [`touches::touches`].
    pub(super) fn touches(&self) -> Result<Option<Vec<DrawnTouches>>, SkinError> {
        if let Some(touches) = &self.touches {
            return Ok(Some(touches.clone()));
        }
        let found = touches::touches(&self.fitted, &mut Progress::silent())?;
        let factor = self.fitted.image_per_strength();
        Ok(found.map(|found| DrawnTouches::of_frames(&found, factor)))
    }

    /// Returns the differences of a frame.
    fn row(&self, frame: usize) -> Result<Vec<f64>, SkinError> {
        let frames = self.differences.nrows();
        if frame >= frames {
            let message = format!("image {frame}, but the measurements have {frames} frames");
            return Err(SkinError::input(message));
        }
        Ok(self.differences.row(frame).to_vec())
    }

    /// Returns the model of the frames.
    pub(super) fn skin(&self) -> &Arc<LinearisedSkin> {
        &self.fitted.skin
    }

    pub(super) fn judge(
        &self,
        net: &Net,
        has_touches: bool,
    ) -> Result<SequenceJudge<'_>, SkinError> {
        let judge = judge(net, has_touches, &self.fitted)?;
        let trust = net.trust(has_touches, &self.fitted);
        let (is_explained, constant) = (Vec::new(), Vec::new());
        Ok(SequenceJudge { check: self, judge, is_explained, constant, trust })
    }
}

impl SequenceJudge<'_> {
    /// Returns a frame's differences, NaN where a value is missing, and their energy in units of the noise.
    ///
    /// # Errors
    ///
    /// A frame beyond the last.
    pub fn frame(&self, frame: usize) -> Result<(Vec<f64>, DataMisfit), SkinError> {
        let row = self.check.row(frame)?;
        let energy = self.judge.energy(&row)?;
        Ok((row, energy))
    }

    pub fn judge(
        &mut self,
        frame: usize,
        net: ArrayView2<'_, f64>,
        raw: ArrayView2<'_, f64>,
    ) -> Result<Judgement, SkinError> {
        let row = self.check.row(frame)?;
        if self.constant.contains(&frame) {
            return Ok(self.judge.reject(net, raw, &row)?);
        }
        let is_explained = self.is_explained.get(frame) != Some(&false);
        Ok(self.trust.verdict(&mut self.judge, is_explained, net, raw, &row)?)
    }

    /// Takes a frame for one whose image is the raw one.
    pub fn set_constant(&mut self, frame: usize) {
        self.constant.push(frame);
    }

    /// Takes whether touches explain each frame.
    pub fn with_explained(self, touches: &[DrawnTouches]) -> Self {
        Self { is_explained: touches.iter().map(|frame| frame.is_explained).collect(), ..self }
    }
}

/// Creates a judge with the model and noise of these frames.
pub(super) fn judge(
    net: &Net,
    has_touches: bool,
    fitted: &FittedFrames,
) -> Result<Judge, SkinError> {
    let FittedFrames { skin, frames, .. } = fitted;
    let noise = match fitted.noise()? {
        Some(noise) => noise,
        None => DataNoise::unknown(&fitted.differences(), &fitted.good()),
    };
    let used = noise.std.iter().zip(&frames.used);
    let std: Vec<f64> = used.map(|(std, used)| if *used { *std } else { f64::INFINITY }).collect();
    let raster = skin.raster(&mut Progress::silent())?;
    let jacobian = skin.pixel_jacobian(raster, &frames.used)?;
    let weights = net.weights_for(has_touches);
    let new = if net.is_of_this_skin { Judge::new } else { Judge::on_another_skin };
    Ok(new(weights, jacobian.view(), &std, raster.mask().view())?)
}

/// Verdicts on a net's images, frame by frame.
#[derive(Debug, Clone)]
pub struct Checked {
    /// Fraction of the data's energy that a correct image may leave unexplained.
    pub limit: f64,
    /// Description of the rule.
    rule: String,
    trust: Trust,
    /// Verdict on each frame.
    pub judgements: Vec<Judgement>,
}

impl Checked {
    pub(super) fn new(judge: &SequenceJudge<'_>, judgements: Vec<Judgement>) -> Option<Self> {
        let SequenceJudge { judge: rule, trust, .. } = judge;
        rule.limit().map(|limit| Self { limit, rule: rule.words(), trust: *trust, judgements })
    }

    fn frames(&self, wanted: impl Fn(Verdict) -> bool) -> Vec<usize> {
        let all = self.judgements.iter().enumerate();
        all.filter(|(_, judgement)| wanted(judgement.verdict)).map(|(frame, _)| frame).collect()
    }

    /// Number of frames that keep their raw image.
    pub fn put_aside(&self) -> Vec<usize> {
        self.frames(|verdict| verdict != Verdict::Net)
    }

    /// Number of frames that keep their raw image although it does not explain the measurements either.
    pub fn unexplained(&self) -> Vec<usize> {
        self.frames(|verdict| verdict == Verdict::Neither)
    }

    /// Describes the verdicts in words.
    pub fn words(&self) -> String {
        let (aside, unexplained) = (self.put_aside(), self.unexplained());
        let count = self.judgements.len();
        let also = match unexplained.len() {
            0 => String::new(),
            n => format!("; in {n} of them it explains the measurements no better"),
        };
        match (self.trust, aside.as_slice()) {
            (Trust::None(why), _) => format!("the raw images stay: {why}"),
            (Trust::Touches, []) => {
                format!("trained on another skin; touches explain every one of {count} frames")
            }
            (Trust::Touches, [first, ..]) => format!(
                "trained on another skin: the raw image stays in {} of {count} frames, the first of them {first}, which \
                 the touches found do not explain{also}",
                aside.len()
            ),
            (Trust::Data, []) => {
                format!("every one of its {count} images explains its measurements")
            }
            (Trust::Data, [first, ..]) => format!(
                "{} of its {count} images, the first in frame {first}, do not explain their measurements ({}): there \
                 the raw image stays{also}",
                aside.len(),
                self.rule,
            ),
        }
    }

    /// Returns the verdicts as JSON.
    pub fn json(&self) -> Value {
        let scores: Vec<f64> = self.judgements.iter().map(|judgement| judgement.net).collect();
        json!({
            "judged_by": self.trust.words(),
            "misfit_limit": self.limit,
            "scores": scores,
            "raw_frames": self.put_aside(),
            "unexplained_frames": self.unexplained(),
        })
    }
}
