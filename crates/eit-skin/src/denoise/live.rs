//! A net that takes images one by one, as they come.

use super::trust::Trust;
use super::{DrawnTouch, Net, NetInputs, check};
use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::progress::Progress;
use eit_denoise::{DenoiseError, Denoiser, Judge, Verdict};
#[cfg(doc)]
use eit_inverse::touch::DetectorStep;
use eit_inverse::touch::Touch;
use eit_mesh::Raster;
use ndarray::Array2;

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
        let mask = fitted.skin.raster(&mut Progress::silent())?.mask().view();
        let has_touches = fitted.noise()?.is_some();
        let weights = net.weights_for(has_touches);
        Ok(Self {
            inputs: NetInputs::new(&fitted.skin, weights.shape)?,
            judge: check::judge(net, has_touches, fitted)?,
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
        let (sign, factor) = (self.sign, self.image_per_strength);
        let energy = self.judge.energy(differences)?;
        let touches = touches.iter().filter_map(|touch| DrawnTouch::of(touch, factor));
        self.inputs.push(self.raw.view(), differences, touches, Some(energy), sign)?;
        let Self { net, inputs, made, .. } = self;
        match inputs.with_frame(|seen| net.push_frame_into(seen, made.view_mut())) {
            Err(DenoiseError::InFrame { error, .. })
                if matches!(*error, DenoiseError::ConstantImage { .. }) =>
            {
                // no touch raises the whole skin by the same amount
                let raw = self.raw.view();
                return Ok(self.judge.reject(raw, raw, differences)?.verdict);
            }
            made => {
                made?;
            }
        }
        inputs.limit(made.view_mut());
        made.mapv_inplace(|value| sign * value);
        let (made, raw) = (self.made.view(), self.raw.view());
        let is_explained = is_explained || !self.inputs.needs_touches();
        let verdict =
            self.trust.verdict(&mut self.judge, is_explained, made, raw, differences)?.verdict;
        if verdict == Verdict::Net {
            raster.pixels_from_image_into(self.made.view(), pixels)?;
        }
        Ok(verdict)
    }
}
