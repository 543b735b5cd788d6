//! Whether a net's images explain the measurements they came from.

use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::noise::DataNoise;
use crate::progress::Progress;
use eit_denoise::{DataConsistency, DataMisfit};
use ndarray::{Array2, ArrayView2};
use serde_json::{Value, json};

/// The measurements behind a sequence of images.
#[derive(Debug)]
pub struct Check {
    evidence: DataConsistency,
    /// NaN where a value is missing.
    differences: Array2<f64>,
}

impl Check {
    /// The measurements of these frames, and the model that images are held against.
    ///
    /// # Errors
    ///
    /// Those of the noise.
    pub fn new(fitted: &FittedFrames) -> Result<Self, SkinError> {
        Ok(Self { evidence: evidence(fitted)?, differences: fitted.differences_or_nan() })
    }

    /// What an image of a frame explains.
    pub fn misfit(
        &mut self,
        frame: usize,
        image: ArrayView2<'_, f64>,
    ) -> Result<DataMisfit, SkinError> {
        let row = self.differences.row(frame).to_vec();
        Ok(self.evidence.misfit(image, &row)?)
    }
}

/// The model that images are held against, with the noise of these frames.
pub(super) fn evidence(fitted: &FittedFrames) -> Result<DataConsistency, SkinError> {
    let FittedFrames { skin, frames, .. } = fitted;
    let noise = match fitted.noise()? {
        Some(noise) => noise,
        None => DataNoise::unknown(&fitted.differences(), &fitted.good()),
    };
    let used = noise.std.iter().zip(&frames.used);
    let std: Vec<f64> = used.map(|(std, used)| if *used { *std } else { f64::INFINITY }).collect();
    let raster = skin.raster(&mut Progress::silent())?;
    let jacobian = skin.pixel_jacobian(raster, &frames.used)?;
    Ok(DataConsistency::new(jacobian.view(), &std, raster.mask().view())?)
}

/// Frames whose denoised image was put aside.
#[derive(Debug, Clone)]
pub struct Checked {
    /// Part of the data's energy that known images leave.
    pub limit: f64,
    /// Of each frame; above 1 the raw image stayed.
    pub scores: Vec<f64>,
}

impl Checked {
    /// Frames with their raw image.
    pub fn put_aside(&self) -> Vec<usize> {
        self.scores.iter().enumerate().filter(|(_, s)| **s > 1.0).map(|(f, _)| f).collect()
    }

    /// For people.
    pub fn words(&self) -> String {
        let aside = self.put_aside();
        let count = self.scores.len();
        match aside.as_slice() {
            [] => format!("every one of its {count} images explains its measurements"),
            [first, ..] => format!(
                "{} of its {count} images, the first in frame {first}, do not explain their \
                 measurements (more than {:.0} % of them left): there the raw image stays",
                aside.len(),
                100.0 * self.limit
            ),
        }
    }

    /// For programs.
    pub fn json(&self) -> Value {
        json!({"misfit_limit": self.limit, "scores": self.scores, "raw_frames": self.put_aside()})
    }
}
