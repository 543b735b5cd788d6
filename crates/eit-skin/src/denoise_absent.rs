//! Without feature `denoise` there is no net: a skin that asks for one is refused.

use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::skin::Skin;
use eit_inverse::touch::Touch;
use eit_mesh::Raster;

/// No weights.
#[derive(Debug, Clone)]
pub(crate) enum Net {}

impl Skin {
    pub(crate) fn net(&self) -> Result<Option<Net>, SkinError> {
        match &self.settings.denoise {
            None => Ok(None),
            Some(_) => Err(SkinError::input(
                "[denoise]: this program was built without nets (feature `denoise` of eit-skin)",
            )
            .within(&self.place)),
        }
    }
}

/// Which image of a frame is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    Net,
    Neither,
}

/// No net, frame by frame.
#[derive(Debug, Clone)]
pub(crate) enum LiveNet {}

impl LiveNet {
    pub fn new(net: &Net, _: &FittedFrames) -> Result<Self, SkinError> {
        match *net {}
    }

    pub fn restart(&mut self) {
        match *self {}
    }

    pub fn push(
        &mut self,
        _: &Raster,
        _: &[f64],
        _: &[f64],
        _: &[Touch],
        _: bool,
        _: &mut [f64],
    ) -> Result<Verdict, SkinError> {
        match *self {}
    }
}
