//! What a net is trusted with on a skin.

use super::{Net, inputs};
use crate::fitted::FittedFrames;
use eit_denoise::{DenoiseError, Judge, Judgement};
use ndarray::ArrayView2;

/// What decides whether a net's image is shown.
#[derive(Debug, Clone, Copy)]
pub(super) enum Trust {
    /// What it leaves of the data: the net was trained for this skin, or sees images alone.
    Data,
    /// Whether touches explain the frame: the net sees them and was trained on another skin. How much a good image leaves
    /// of the data depends on how much electrodes move, which the detector allows for. On four other skins what is left
    /// rejected 26 images rightly and 271 wrongly.
    Touches,
    /// None is shown, for this reason.
    None(&'static str),
}

impl Net {
    /// What decides about its images of these frames.
    pub(super) fn trust(&self, has_touches: bool, fitted: &FittedFrames) -> Trust {
        let sees_touches = inputs::needs_touches(self.weights_for(has_touches).shape);
        match (self.is_of_this_skin, sees_touches) {
            (true, _) => Trust::Data,
            // of a ball in the middle of a tank it made two (`golf_ball_b`)
            (false, false) if self.of_images.is_some() => Trust::None(
                "the shipped net of images alone was trained on another skin, and the noise is unknown, without which \
                 no touches can be sought for the other one ([noise])",
            ),
            (false, false) => Trust::Data,
            (false, true) if !fitted.fit.is_alike() => Trust::None(
                "the net was trained on another skin, and the touches that it sees are not reliable, since the model \
                 does not explain the reference",
            ),
            (false, true) => Trust::Touches,
        }
    }
}

impl Trust {
    /// Names it.
    pub(super) fn words(self) -> &'static str {
        match self {
            Self::Data => "data",
            Self::Touches => "touches",
            Self::None(_) => "none",
        }
    }

    /// Judges a net's image; `is_explained` tells whether touches explain the frame, and is true for nets that do not see
    /// them.
    pub(super) fn verdict(
        self,
        judge: &mut Judge,
        is_explained: bool,
        net: ArrayView2<'_, f64>,
        raw: ArrayView2<'_, f64>,
        differences: &[f64],
    ) -> Result<Judgement, DenoiseError> {
        match self {
            Self::None(_) => judge.reject(net, raw, differences),
            _ if !is_explained => judge.reject(net, raw, differences),
            Self::Touches => judge.accept(net, differences),
            Self::Data => judge.judge(net, raw, differences),
        }
    }
}
