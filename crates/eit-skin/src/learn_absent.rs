//! Without feature `learn`, nothing learnt can be applied: a skin that needs it is rejected.

use crate::error::SkinError;
use crate::linearised::LinearisedSkin;
use eit_inverse::touch::LearntTouch;
use eit_mesh::Surface;
use std::path::Path;

/// Only forces depend on where a sheet is uneven.
#[derive(Debug, Clone, Default)]
pub(crate) struct LocalSheet;

impl LocalSheet {
    pub(crate) fn new(_: &Surface, _: &[f64], _: &[f64]) -> Self {
        Self
    }
}

/// Never constructed without feature `learn`.
#[derive(Debug, Clone)]
pub(crate) enum LearnedSkin {}

impl LearnedSkin {
    pub(crate) fn read_for(_: &Path, skin: &LinearisedSkin) -> Result<Self, SkinError> {
        Err(SkinError::input(
            "touch.learned: this program was built without learning (feature `learn` of eit-skin)",
        )
        .within(&skin.skin.place))
    }

    pub(crate) fn model_forces(&self, _: LocalSheet) -> ModelForces {
        match *self {}
    }
}

/// Never constructed without feature `learn`.
#[derive(Debug, Clone)]
pub(crate) enum ModelForces {}

impl ModelForces {
    pub(crate) fn of(&self, _: [f64; 2], _: [f64; 3]) -> LearntTouch {
        match *self {}
    }
}
