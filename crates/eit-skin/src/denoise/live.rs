//! A net that takes images one by one, as they come.

use super::inputs::needs_touches;
use super::trust::Trust;
use super::{Checked, DrawnTouch, DrawnTouches, Net, NetInputs};
use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::progress::Progress;
use eit_denoise::{DenoiseError, Denoiser, Judge, Judgement, Verdict};
#[cfg(doc)]
use eit_inverse::touch::DetectorStep;
use eit_inverse::touch::Touch;
use eit_mesh::Raster;
use ndarray::{Array2, ArrayView2};

/// Denoises live images one by one, with the same images and verdicts as [`Net::apply`] for a recording.
#[derive(Debug, Clone)]
pub struct LiveNet {
    net: Denoiser,
    inputs: NetInputs,
    sign: f64,
    trust: Trust,
    image_per_strength: f64,
    judge: Judge,
    raw: Array2<f64>,
    made: Array2<f64>,
}

impl LiveNet {
    /// Prepares a net for frames like these.
    ///
    /// # Errors
    ///
    /// The errors of the noise and of the weights.
    pub fn new(net: &Net, fitted: &FittedFrames) -> Result<Self, SkinError> {
        Self::of(net, fitted.noise()?.is_some(), fitted)
    }

    /// The same for frames whose touches are known or not.
    pub(super) fn of(
        net: &Net,
        has_touches: bool,
        fitted: &FittedFrames,
    ) -> Result<Self, SkinError> {
        let mask = fitted.skin.raster(&mut Progress::silent())?.mask().view();
        let weights = net.weights_for(has_touches);
        Ok(Self {
            inputs: NetInputs::new(&fitted.skin, weights.shape)?,
            judge: net.judge(has_touches, fitted)?,
            net: Denoiser::new(weights, mask)?,
            sign: net.sign,
            trust: net.trust(has_touches, fitted),
            image_per_strength: fitted.image_per_strength(),
            raw: Array2::zeros(mask.dim()),
            made: Array2::zeros(mask.dim()),
        })
    }

    /// Discards the earlier images of the sequence.
    pub fn restart(&mut self) {
        self.net.reset();
    }

    /// Denoises the next raw image and returns which image is now in `pixels`; both have one value per pixel of
    /// the skin. `differences` are NaN where a value is missing; `touches` are those of the frame,
    /// and `is_explained` tells whether they explain it ([`DetectorStep::is_explained`]); if not, the net's image is not
    /// shown.
    ///
    /// # Errors
    ///
    /// The errors of the net and its inputs.
    pub fn push(
        &mut self,
        raster: &Raster,
        raw: &[f64],
        differences: &[f64],
        touches: &[Touch],
        is_explained: bool,
        pixels: &mut [f64],
    ) -> Result<Verdict, SkinError> {
        pixels.copy_from_slice(raw);
        raster.image_from_pixels_into(raw, self.raw.view_mut())?;
        let raw = std::mem::take(&mut self.raw);
        let factor = self.image_per_strength;
        let touches = touches.iter().filter_map(|touch| DrawnTouch::of(touch, factor));
        let judged = self.image(raw.view(), differences, touches, is_explained);
        self.raw = raw;
        let verdict = judged?.verdict;
        if verdict == Verdict::Net {
            raster.pixels_from_image_into(self.made.view(), pixels)?;
        }
        Ok(verdict)
    }

    /// Denoises the next raw image [row, column] of a recording.
    pub(super) fn denoise(
        &mut self,
        raw: ArrayView2<'_, f64>,
        differences: &[f64],
        touches: Option<&DrawnTouches>,
    ) -> Result<Judgement, SkinError> {
        let is_explained = touches.is_none_or(|touches| touches.is_explained);
        let touches = touches.map_or(&[][..], |touches| &touches.touches);
        self.image(raw, differences, touches.iter().copied(), is_explained)
    }

    /// The last image [row, column] that the net made, or the raw one if the net makes no other.
    pub(super) fn made(&self) -> ArrayView2<'_, f64> {
        self.made.view()
    }

    /// Verdicts on a recording; `None` if the weights have no rule.
    pub(super) fn checked(&self, judgements: Vec<Judgement>) -> Option<Checked> {
        Checked::new(&self.judge, self.trust, judgements)
    }

    fn image(
        &mut self,
        raw: ArrayView2<'_, f64>,
        differences: &[f64],
        touches: impl Iterator<Item = DrawnTouch>,
        is_explained: bool,
    ) -> Result<Judgement, SkinError> {
        let Self { net, inputs, sign, trust, judge, made, .. } = self;
        let energy = judge.energy(differences)?;
        inputs.push(raw, differences, touches, Some(energy), *sign)?;
        match inputs.with_frame(|frame| net.push_frame_into(frame, made.view_mut())) {
            Err(DenoiseError::InFrame { error, .. })
                if matches!(*error, DenoiseError::ConstantImage { .. }) =>
            {
                // total variation may leave one value of a noisy frame; no touch raises the whole skin by the same amount
                made.assign(&raw);
                return Ok(judge.reject(raw, raw, differences)?);
            }
            result => {
                result?;
            }
        }
        inputs.limit(made.view_mut());
        made.mapv_inplace(|value| *sign * value);
        let is_explained = is_explained || !needs_touches(inputs.shape);
        Ok(trust.verdict(judge, is_explained, made.view(), raw, differences)?)
    }
}
