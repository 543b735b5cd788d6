//! Whether a net's images explain the measurements behind them.

use super::DrawnTouches;
use super::trust::Trust;
use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::progress::Progress;
use crate::touches::{self, Touches};
use eit_denoise::{Judge, Judgement, Verdict};
use ndarray::Array2;
use serde::Serialize;

/// The measurements that a sequence of images was made from.
#[derive(Debug, Clone)]
pub struct Check {
    fitted: FittedFrames,
    /// Differences [frame, measurement], NaN where a value is missing.
    differences: Array2<f64>,
    /// Touches of each frame; `None` if they have not been sought.
    touches: Option<Vec<DrawnTouches>>,
}

impl Check {
    /// Takes the measurements of these frames.
    pub fn new(fitted: &FittedFrames) -> Self {
        let differences = fitted.differences_or_nan();
        Self { fitted: fitted.clone(), differences, touches: None }
    }

    /// Adds touches already found in the frames, so that a net that sees touches does not search
    /// again.
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
    pub(super) fn row(&self, frame: usize) -> Result<Vec<f64>, SkinError> {
        let frames = self.differences.nrows();
        if frame >= frames {
            let message = format!("image {frame}, but the measurements have {frames} frames");
            return Err(SkinError::input(message));
        }
        Ok(self.differences.row(frame).to_vec())
    }

    /// Returns the frames.
    pub(super) fn fitted(&self) -> &FittedFrames {
        &self.fitted
    }
}

/// Verdicts on a net's images, frame by frame.
#[derive(Debug, Clone, Serialize)]
pub struct Checked {
    judged_by: &'static str,
    /// Fraction of the data's energy that a correct image may leave unexplained.
    misfit_limit: f64,
    scores: Vec<f64>,
    /// Frames that keep their raw image.
    pub raw_frames: Vec<usize>,
    /// Frames that keep their raw image although it does not explain the measurements either.
    unexplained_frames: Vec<usize>,
    /// Description of the rule.
    #[serde(skip)]
    rule: String,
    #[serde(skip)]
    trust: Trust,
    /// Verdict on each frame.
    #[serde(skip)]
    pub judgements: Vec<Judgement>,
}

impl Checked {
    pub(super) fn new(rule: &Judge, trust: Trust, judgements: Vec<Judgement>) -> Option<Self> {
        let frames = |wanted: fn(Verdict) -> bool| {
            let all = judgements.iter().enumerate();
            all.filter(|(_, judgement)| wanted(judgement.verdict)).map(|(frame, _)| frame).collect()
        };
        Some(Self {
            judged_by: trust.name(),
            misfit_limit: rule.limit()?,
            scores: judgements.iter().map(|judgement| judgement.net).collect(),
            raw_frames: frames(|verdict| verdict != Verdict::Net),
            unexplained_frames: frames(|verdict| verdict == Verdict::Neither),
            rule: rule.description(),
            trust,
            judgements,
        })
    }

    /// Describes the verdicts in words.
    pub fn description(&self) -> String {
        let (aside, count) = (&self.raw_frames, self.judgements.len());
        let also = match self.unexplained_frames.len() {
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
}
