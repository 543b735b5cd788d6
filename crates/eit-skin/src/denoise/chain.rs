//! Images of simulated frames as `eit reconstruct` makes them of a recording.

use crate::error::SkinError;
use crate::frames::{self, Frames};
use crate::method::{self, Method};
use crate::pipeline::{self, Linearised, Setup, movement};
use crate::progress::Progress;
use crate::scene::{Noise, Pair, Recording, Reference, Scene};
use eit_mesh::Raster;
use ndarray::{Array2, Array3};

/// What turns frames of a scene into images.
pub struct Chain {
    /// For a simulated sequence with its quiet frames.
    pub scene: Scene,
    pub method: Method,
    pub setup: Setup,
    pub linearised: Linearised,
    pub raster: Raster,
}

/// A sequence through the chain.
pub struct Chained {
    /// [frame, row, column], siemens.
    pub images: Array3<f64>,
    pub frames: Frames,
    /// Factor from the model's voltages to the reference's.
    pub gain: f64,
}

impl Chain {
    /// With lengths: for simulated sequences of so many frames, of which the first so many are
    /// reference and noise. Without: for recordings as the scene describes them.
    pub fn new(
        scene: &Scene,
        method: Option<&str>,
        lengths: Option<(usize, usize)>,
        progress: &mut Progress,
    ) -> Result<Self, SkinError> {
        let scene = match lengths {
            None => scene.clone(),
            Some((_, quiet)) => Scene {
                recording: Recording {
                    reference: Some(Reference::Text(format!("0..{quiet}"))),
                    ..Default::default()
                },
                noise: Noise { quiet_frames: Some(Pair([0, quiet - 1])), ..Default::default() },
                ..scene.clone()
            },
        };
        let method = method::choose(&scene, method, lengths.map(|(count, _)| count))?.method;
        if !(method.is_tv() || method == Method::GaussNewton) {
            return Err(SkinError::input(format!(
                "--method {}: a net learns from st-tv, tv or gauss-newton",
                method.name()
            )));
        }
        let setup = pipeline::setup(&scene, None, None, progress)?;
        let raster = pipeline::raster(&scene, &setup, progress)?;
        let linearised = pipeline::linearise(&scene, &setup, progress)?;
        Ok(Self { scene, method, setup, linearised, raster })
    }

    /// Images of frames [frame, measurement].
    pub fn reconstruct(&self, values: &Array2<f64>) -> Result<Chained, SkinError> {
        self.reconstruct_frames(frames::of_values(&self.scene, &self.setup.protocol, values)?)
    }

    /// Images of frames that were loaded.
    pub fn reconstruct_frames(&self, mut frames: Frames) -> Result<Chained, SkinError> {
        let (scene, setup, linearised) = (&self.scene, &self.setup, &self.linearised);
        let kind = scene.difference_kind(&setup.protocol);
        let voltages = linearised.voltages.to_vec();
        let gain = frames.fit_model(&voltages, kind, scene.skin.conductivity_s)?.gain;
        let mut silent = Progress::silent();
        let (models, given) = ((setup, linearised), (&frames, gain));
        let freed = movement::free(scene, self.method, models, given, &mut silent)?;
        let (scene, linearised, left) = match &freed {
            None => (scene, linearised, &frames),
            Some(freed) => (&freed.scene, &freed.linearised, &freed.frames),
        };
        let images = if self.method == Method::GaussNewton {
            let of_left = freed.as_ref().map(|freed| freed.imaging(setup, &mut silent));
            let imaging = match of_left.transpose()?.flatten() {
                Some(imaging) => imaging,
                None => pipeline::imaging(scene, setup, linearised, left, &mut silent)?,
            };
            imaging.images(left, &mut silent)?.into_parts().0
        } else {
            let (parts, movie) = ((setup, linearised, &self.raster), (left, gain));
            let made = pipeline::tv::reconstruct(scene, self.method, parts, movie, &mut silent)?;
            self.raster.images_from_pixels(made.pixels.view())?
        };
        Ok(Chained { images, frames, gain })
    }
}
