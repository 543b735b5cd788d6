//! What a net is trusted with on a skin.

use eit_denoise::{DenoiseError, Judge, Judgement};
use ndarray::ArrayView2;

/// What decides whether a net's image is shown.
#[derive(Debug, Clone, Copy)]
pub(super) enum Trust {
    /// How much of the data the image explains: for nets trained on this skin, and for nets that
    /// see images alone.
    Data,
    /// Whether touches explain the frame: for nets that see touches and were trained on another
    /// skin. How much a good image leaves of the data depends on how much electrodes move, which
    /// the detector allows for. On four other skins what is left rejected 26 images rightly and 271
    /// wrongly.
    Touches,
    /// No image of the net is shown, for this reason.
    None(&'static str),
}

impl Trust {
    /// Describes the criterion in words.
    pub(super) fn name(self) -> &'static str {
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
