//! Images of simulated frames as a reconstruction makes them of a recording.

use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::frames::Frames;
use crate::linearised::LinearisedSkin;
use crate::method::{self, Method};
use crate::progress::Progress;
use crate::scene::{ChangeSign, NoiseSettings, RecordingSettings, Reference};
use crate::skin::Skin;
use ndarray::{Array2, Array3};
use std::sync::Arc;

/// Reconstructs images from frames of a skin, as input of a net.
#[derive(Debug, Clone)]
pub struct Chain {
    /// Reconstruction method.
    pub method: Method,
    /// The skin, with the quiet frames of a simulated sequence in its settings.
    pub linearised: Arc<LinearisedSkin>,
}

/// Length of a simulated sequence, and of its quiet start, which gives reference and noise.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Lengths {
    /// Number of frames of the sequence.
    pub frames: usize,
    /// Number of frames at the start in which nothing touches the skin.
    pub quiet: usize,
    /// Frames per second.
    pub rate_hz: f64,
}

/// A reconstructed sequence.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Chained {
    /// Images [frame, row, column], siemens.
    pub images: Array3<f64>,
    /// The frames that they were made from.
    pub fitted: FittedFrames,
}

impl Chain {
    /// Sets up the chain for simulated sequences of these lengths or, with `None`, for recordings as the skin's
    /// settings describe them.
    ///
    /// # Errors
    ///
    /// A method whose images nets are not trained on, or a skin that cannot be linearised.
    pub fn new(
        mut skin: Skin,
        method: Option<&str>,
        lengths: Option<Lengths>,
        progress: &mut Progress,
    ) -> Result<Self, SkinError> {
        if let Some(Lengths { quiet, rate_hz, .. }) = lengths {
            skin.settings.recording = RecordingSettings {
                reference: Some(Reference::Text(format!("0..{quiet}"))),
                frame_rate_hz: Some(rate_hz),
                ..Default::default()
            };
            skin.settings.noise =
                NoiseSettings { quiet_frames: Some((0..quiet).into()), additive_v: None };
            // simulated fingers raise the conductivity, and nets learn increases
            if std::mem::take(&mut skin.settings.touch.sign) == ChangeSign::Decrease {
                let image = &mut skin.settings.reconstruction;
                (image.lower_s, image.upper_s) =
                    (image.upper_s.map(|s| -s), image.lower_s.map(|s| -s));
            }
        }
        let method = method::choose(&skin.settings, method, lengths.map(|l| l.frames))?.method;
        if !(method.is_tv() || method == Method::GaussNewton) {
            return Err(SkinError::argument(
                "method",
                format!("{}: a net learns from st-tv, tv or gauss-newton", method.name()),
            ));
        }
        let linearised = skin.linearise(progress)?;
        linearised.raster(progress)?;
        Ok(Self { method, linearised: Arc::new(linearised) })
    }

    /// Reconstructs frames [frame, measurement].
    ///
    /// # Errors
    ///
    /// The errors of the frames and of the method.
    pub fn reconstruct(&self, values: &Array2<f64>) -> Result<Chained, SkinError> {
        self.reconstruct_frames(self.linearised.skin.frames_of_values(values)?)
    }

    /// Reconstructs loaded frames.
    ///
    /// # Errors
    ///
    /// The errors of the method.
    pub(crate) fn reconstruct_frames(&self, frames: Frames) -> Result<Chained, SkinError> {
        let fitted = self.linearised.fit(frames)?;
        let images = fitted.images(self.method, &mut Progress::silent())?.values;
        Ok(Chained { images, fitted })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests")]
    use super::*;
    use crate::scene::Scene;

    /// Simulated fingers raise the conductivity: a scene whose touches lower it is turned, its bounds too.
    #[test]
    fn simulated_sequences_of_a_falling_conductivity_are_turned() {
        let mut skin = Skin::from_scene(Scene::load("paper-disc").unwrap()).unwrap();
        skin.settings.touch.sign = ChangeSign::Decrease;
        skin.settings.reconstruction.lower_s = Some(-2e-4);
        let lengths = Lengths { frames: 40, quiet: 20, rate_hz: 20.0 };
        let mut silent = Progress::silent();
        let chain = Chain::new(skin.clone(), Some("gauss-newton"), Some(lengths), &mut silent);
        let settings = chain.unwrap().linearised.skin.settings.clone();
        assert_eq!(settings.touch.sign, ChangeSign::Increase);
        let image = &settings.reconstruction;
        assert_eq!((image.lower_s, image.upper_s), (None, Some(2e-4)));
        // recordings are what they are
        let chain = Chain::new(skin, Some("gauss-newton"), None, &mut silent).unwrap();
        assert_eq!(chain.linearised.skin.settings.touch.sign, ChangeSign::Decrease);
    }
}
