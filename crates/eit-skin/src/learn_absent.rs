//! Without feature `learn`, nothing learnt can be applied: a skin that needs it is rejected.

use crate::error::SkinError;
use crate::linearised::LinearisedSkin;
use eit_inverse::touch::DetectedTouch;
use std::path::Path;

/// Never constructed without feature `learn`.
#[derive(Debug, Clone)]
pub(crate) enum LearnedTouches {}

impl LearnedTouches {
    pub fn load(_: &Path, skin: &LinearisedSkin, _: &[bool], _: &[f64]) -> Result<Self, SkinError> {
        Err(SkinError::input(
            "touch.learned: this program was built without learning (feature `learn` of eit-skin)",
        )
        .within(&skin.skin.place))
    }

    pub fn refine<'a>(
        &'a mut self,
        _: &[f64],
        _: &[f64],
        _: impl Fn(usize) -> bool,
        _: &'a [DetectedTouch],
    ) -> &'a [DetectedTouch] {
        match *self {}
    }
}
