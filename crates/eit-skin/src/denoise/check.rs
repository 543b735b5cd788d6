//! Whether a net's images explain the measurements they came from.

use crate::error::SkinError;
use crate::frames::Frames;
use crate::pipeline::noise::DataNoise;
use crate::pipeline::{self, Linearised, Setup};
use crate::scene::Scene;
use eit_denoise::{DataConsistency, DataMisfit};
use eit_mesh::Raster;
use ndarray::{Array2, ArrayView1, ArrayView2};
use serde_json::{Value, json};

/// The measurements behind a sequence of images.
pub struct Check {
    evidence: DataConsistency,
    /// NaN where a value is missing.
    differences: Array2<f64>,
}

impl Check {
    /// `gain` is the factor from the model's voltages to the reference's.
    pub fn new(
        scene: &Scene,
        (setup, linearised, raster): (&Setup, &Linearised, &Raster),
        (frames, gain): (&Frames, f64),
    ) -> Result<Self, SkinError> {
        let evidence = evidence(scene, (setup, linearised, raster), (frames, gain))?;
        let mut differences = frames.differences(scene.difference_kind(&setup.protocol));
        let good = &frames.good & &ArrayView1::from(&frames.used);
        differences.zip_mut_with(&good, |value, good| {
            if !good {
                *value = f64::NAN;
            }
        });
        Ok(Self { evidence, differences })
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
pub fn evidence(
    scene: &Scene,
    (setup, linearised, raster): (&Setup, &Linearised, &Raster),
    (frames, gain): (&Frames, f64),
) -> Result<DataConsistency, SkinError> {
    let kind = scene.difference_kind(&setup.protocol);
    let data = pipeline::difference_data(kind, linearised);
    let noise = match pipeline::noise::known(scene, frames, (&data, gain))? {
        Some(noise) => noise,
        None => {
            let good = &frames.good & &ArrayView1::from(&frames.used);
            DataNoise::unknown(&frames.differences(kind), &good)
        }
    };
    let used = noise.std.iter().zip(&frames.used);
    let std: Vec<f64> = used.map(|(std, used)| if *used { *std } else { f64::INFINITY }).collect();
    let jacobian = pipeline::tv::pixel_jacobian(linearised, raster, kind, &frames.used)?;
    Ok(DataConsistency::new(jacobian.view(), &std, raster.mask().view())?)
}

/// Frames whose denoised image was put aside.
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
