//! The model used to reconstruct images, as opposed to the finer ones that simulate the data.

use crate::error::ReportError;
use eit_inverse::Prior;
use eit_inverse::metrics::Cells;
use eit_mesh::Raster;
use eit_skin::frames::{Frames, ModelFit};
use eit_skin::scene::{DifferenceKind, ReconstructionSettings};
use eit_skin::{FittedFrames, LinearisedSkin, MeshOverride, Progress, Scene, Skin};
use ndarray::{Array2, ArrayView3};
use std::sync::Arc;

/// A built-in skin, linearised, with its pixels and prior.
pub struct ReconstructionModel {
    /// The skin and its sensitivities.
    pub linearised: LinearisedSkin,
    /// The pixels.
    pub raster: Raster,
    /// The pixels, for figures of merit.
    pub cells: Cells<2>,
    /// Prior of the methods on mesh elements.
    pub prior: Box<dyn Prior + Send + Sync>,
}

impl ReconstructionModel {
    /// Sets up a scene (a file, or the name of a built-in one) with the given number of pixels across its
    /// skin.
    ///
    /// # Errors
    /// A scene that cannot be read, a skin that cannot be solved.
    pub fn new(scene: &str, pixels: usize, progress: &mut Progress) -> Result<Self, ReportError> {
        let mut scene = Scene::load(scene)?;
        scene.reconstruction.pixels = Some(pixels);
        let skin = Skin::set_up(&scene, &MeshOverride::default(), progress)?;
        let linearised = skin.linearise(progress)?;
        let raster = linearised.raster(progress)?.clone();
        let prior = linearised.prior()?;
        Ok(Self { cells: Cells::of_raster(&raster), linearised, raster, prior })
    }

    /// Returns the skin whose images are compared.
    pub fn skin(&self) -> &Skin {
        &self.linearised.skin
    }

    /// The scene's reconstruction settings.
    pub fn settings(&self) -> &ReconstructionSettings {
        &self.skin().settings.reconstruction
    }

    /// Plain or normalised difference.
    pub fn difference_kind(&self) -> DifferenceKind {
        self.linearised.difference_kind()
    }

    /// Fits simulated frames with known noise for reconstruction with these settings. The gain is
    /// 1, because the same skin simulated them.
    pub fn fit(
        &self,
        frames: &Frames,
        noise_std_v: f64,
        settings: ReconstructionSettings,
    ) -> FittedFrames {
        let mut linearised = self.linearised.clone().with_reconstruction(settings);
        linearised.skin.settings.noise.additive_v = Some(noise_std_v);
        let fit = ModelFit { gain: 1.0, correlation: 1.0, level_scatter: 0.0 };
        FittedFrames { skin: Arc::new(linearised), frames: frames.clone(), fit, weave: None }
    }

    /// Returns the masked pixels of images [frame, row, column] as [frame, masked pixel].
    ///
    /// # Errors
    /// Images of another raster.
    pub fn pixels_of(&self, images: ArrayView3<'_, f64>) -> Result<Array2<f64>, ReportError> {
        let mut pixels = Array2::zeros((images.shape()[0], self.raster.masked_pixels().len()));
        for (image, mut row) in images.outer_iter().zip(pixels.rows_mut()) {
            if let Some(row) = row.as_slice_mut() {
                self.raster.pixels_from_image_into(image, row)?;
            }
        }
        Ok(pixels)
    }
}
