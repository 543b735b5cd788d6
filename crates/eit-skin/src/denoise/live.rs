//! A net that takes images one by one, as they come.

use super::{Net, check};
use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::progress::Progress;
use eit_denoise::{DataConsistency, DenoiseError, Denoiser};
use eit_mesh::Raster;
use ndarray::Array2;

/// The same images and the same verdicts as [`Net::apply`] for a recording.
#[derive(Debug)]
pub struct LiveNet {
    net: Denoiser,
    sign: f64,
    /// With the limit of misfit, where the weights know theirs.
    evidence: Option<(DataConsistency, f64)>,
    raw: Array2<f64>,
    made: Array2<f64>,
}

impl LiveNet {
    /// For images of frames like these.
    ///
    /// # Errors
    ///
    /// Those of the noise and of the weights.
    pub fn new(net: &Net, fitted: &FittedFrames) -> Result<Self, SkinError> {
        let mask = fitted.skin.raster(&mut Progress::silent())?.mask().view();
        let evidence = match net.weights.misfit_limit() {
            None => None,
            Some(limit) => Some((check::evidence(fitted)?, limit)),
        };
        Ok(Self {
            net: Denoiser::new(&net.weights, mask)?,
            sign: net.sign,
            evidence,
            raw: Array2::zeros(mask.dim()),
            made: Array2::zeros(mask.dim()),
        })
    }

    /// Forgets the images before.
    pub fn restart(&mut self) {
        self.net.reset();
    }

    /// Makes the next image of a raw one, both a value for each pixel of the skin; false where it
    /// does not explain the measurements and the raw one stays. `differences` are NaN where a value
    /// is missing.
    pub fn push(
        &mut self,
        raster: &Raster,
        raw: &[f64],
        differences: &[f64],
        pixels: &mut [f64],
    ) -> Result<bool, SkinError> {
        pixels.copy_from_slice(raw);
        raster.image_from_pixels_into(raw, self.raw.view_mut())?;
        let sign = self.sign;
        self.raw.mapv_inplace(|value| sign * value);
        match self.net.push_into(self.raw.view(), self.made.view_mut()) {
            Err(DenoiseError::InFrame { error, .. })
                if matches!(*error, DenoiseError::ConstantImage { .. }) =>
            {
                // nobody touches the whole skin alike
                return Ok(false);
            }
            made => {
                made?;
            }
        }
        self.made.mapv_inplace(|value| sign * value);
        if let Some((evidence, limit)) = &mut self.evidence
            && evidence.misfit(self.made.view(), differences)?.score(*limit) > 1.0
        {
            return Ok(false);
        }
        raster.pixels_from_image_into(self.made.view(), pixels)?;
        Ok(true)
    }
}
