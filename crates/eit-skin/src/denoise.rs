//! A scene's U-net: which weights, whether they fit, images through them.

mod chain;
mod check;
mod drawn;
mod inputs;
mod live;
mod scores;
mod trust;

pub use chain::{Chain, Chained, Lengths};
pub use check::{Check, Checked};
pub(crate) use drawn::{DrawnTouch, DrawnTouches};
pub use eit_denoise::Verdict;
pub(crate) use inputs::NetInputs;
pub use live::LiveNet;
pub use scores::{Scores, scores};

use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::noise::DataNoise;
use crate::progress::Progress;
use crate::scene::{ChangeSign, DenoiseSettings};
use crate::skin::Skin;
use eit_denoise::{DenoiseError, Denoiser, ImageStack, Judge, UnetShape, Weights};
use eit_mesh::Raster;
use ndarray::Array3;
use serde_json::{Value, json};
use trust::Trust;

/// Weights for a skin.
#[derive(Debug, Clone)]
pub struct Net {
    weights: Weights,
    /// For images whose touches are unknown, if `weights` need touches.
    of_images: Option<Weights>,
    source: String,
    skin: String,
    /// Whether it was trained for this skin and number of pixels.
    pub(crate) is_of_this_skin: bool,
    /// Sign by which images are multiplied: -1 if touches lower the conductivity, since nets are trained on
    /// touches that raise it.
    sign: f64,
}

/// The skin and raster that weights must have been trained for.
#[derive(Debug, Clone, Copy)]
pub struct NetTarget<'a> {
    /// Checksum of shape, electrodes and protocol of the skin.
    pub fingerprint: &'a str,
    /// Pixels along the longer side of the images.
    pub pixels: usize,
    /// Sign of the conductivity change of a touch.
    pub sign: ChangeSign,
}

impl Skin {
    /// Loads the net that the settings name; `None` if they name none.
    ///
    /// # Errors
    ///
    /// Weights that cannot be read, or that were trained for another skin or number of pixels.
    pub fn net(&self) -> Result<Option<Net>, SkinError> {
        let Some(settings) = &self.settings.denoise else { return Ok(None) };
        Net::load(settings, &self.net_target()).map(Some)
    }

    /// Returns the skin and raster that weights for this skin must have been trained for.
    pub fn net_target(&self) -> NetTarget<'_> {
        NetTarget {
            fingerprint: &self.fingerprint,
            pixels: self.pixels(),
            sign: self.settings.touch.sign,
        }
    }
}

impl Net {
    /// Loads weights, "default" or a file, and rejects those trained for another skin or number of pixels.
    ///
    /// # Errors
    ///
    /// The errors of [`Skin::net`].
    pub fn load(settings: &DenoiseSettings, target: &NetTarget<'_>) -> Result<Self, SkinError> {
        let DenoiseSettings { weights: name, any_skin } = settings;
        let within = |e: DenoiseError| SkinError::from(e).within(name);
        let (weights, of_images) = match name.as_str() {
            "default" => {
                let of_images = Weights::paper_disc().map_err(within)?;
                (Weights::paper_disc_with_touches().map_err(within)?, Some(of_images))
            }
            file => {
                let bytes = crate::scene::read_file(std::path::Path::new(file))?;
                (Weights::from_bytes(&bytes).map_err(within)?, None)
            }
        };
        let NetTarget { fingerprint, pixels, sign } = *target;
        let fits = weights.check_skin(fingerprint, [pixels, pixels]);
        let is_of_this_skin = fits.is_ok();
        if !any_skin {
            fits.map_err(|e| {
                let how = "(`eit net apply --any-skin`, or both keys in the scene's [denoise]";
                SkinError::input(format!("{name}: {e} {how}: weights = {name:?}, any_skin = true)"))
            })?;
        }
        let (source, skin) = (name.clone(), fingerprint.to_owned());
        Ok(Self { weights, of_images, source, skin, is_of_this_skin, sign: sign.factor() })
    }

    /// Returns the net for images without measurements; of the shipped weights, those that see the
    /// image alone.
    pub fn for_images(self) -> Self {
        match self.of_images {
            Some(weights) => Self { weights, of_images: None, ..self },
            None => self,
        }
    }

    /// Denoises images [frame, row, column] of a raster in place. If `check` has the measurements, a denoised
    /// image that does not explain them is discarded and the raw one kept.
    ///
    /// # Errors
    ///
    /// A net that needs measurements, without `check`; the errors of the noise and the images.
    pub fn apply(
        &self,
        images: &mut Array3<f64>,
        raster: &Raster,
        check: Option<&Check>,
        progress: &mut Progress,
    ) -> Result<Option<Checked>, SkinError> {
        progress.stage("U-net", || {
            let Some(check) = check else {
                *images = self.of_images(images, raster)?;
                return Ok(None);
            };
            let (mut net, touches) = self.of_frames(check)?;
            let mut judgements = Vec::with_capacity(images.dim().0);
            for (frame, mut image) in images.outer_iter_mut().enumerate() {
                let differences = check.row(frame)?;
                let judgement = net.denoise(image.view(), &differences, touches.get(frame))?;
                if judgement.verdict == Verdict::Net {
                    image.assign(&net.made());
                }
                judgements.push(judgement);
            }
            Ok(net.checked(judgements))
        })
    }

    /// Like [`Net::apply`], but keeps every denoised image, even one that does not explain its measurements.
    ///
    /// # Errors
    ///
    /// The errors of [`Net::apply`].
    pub fn apply_unchecked(
        &self,
        images: &mut Array3<f64>,
        check: &Check,
        progress: &mut Progress,
    ) -> Result<(), SkinError> {
        progress.stage("U-net", || {
            let (mut net, touches) = self.of_frames(check)?;
            for (frame, mut image) in images.outer_iter_mut().enumerate() {
                net.denoise(image.view(), &check.row(frame)?, touches.get(frame))?;
                image.assign(&net.made());
            }
            Ok(())
        })
    }

    /// Returns the weights to use: of the shipped ones, those for images alone if the touches of
    /// the frames are unknown.
    fn weights_for(&self, has_touches: bool) -> &Weights {
        match &self.of_images {
            Some(of_images) if !has_touches => of_images,
            _ => &self.weights,
        }
    }

    /// Denoises with a net whose only input is the image.
    fn of_images(&self, raw: &Array3<f64>, raster: &Raster) -> Result<Array3<f64>, SkinError> {
        let weights = self.weights_for(false);
        if inputs::needs_data(weights.shape) {
            return Err(SkinError::input(format!(
                "{}: this net sees the measurements too, and there are images alone; eit reconstruct \
                 with [denoise] has both",
                self.source
            )));
        }
        let turned = |v: f64| self.sign * v;
        let mut net = Denoiser::new(weights, raster.mask().view())?;
        let raw = ImageStack::new(raw.mapv(turned), raster.mask().clone())?;
        Ok(net.denoise(&raw)?.into_parts().0.mapv_into(turned))
    }

    /// Prepares the net for the frames of a check, and finds their touches if it takes them.
    fn of_frames(&self, check: &Check) -> Result<(LiveNet, Vec<DrawnTouches>), SkinError> {
        let touches = match inputs::needs_touches(self.weights.shape) {
            true => check.touches()?,
            false => None,
        };
        let weights = self.weights_for(touches.is_some());
        if inputs::needs_touches(weights.shape) && touches.is_none() {
            return Err(SkinError::input(format!(
                "{}: this net sees the touches of each frame, and without the noise of the data none can be \
                 sought: set [noise]",
                self.source
            )));
        }
        let net = LiveNet::of(self, touches.is_some(), check.fitted())?;
        Ok((net, touches.unwrap_or_default()))
    }

    /// Creates a judge with the model and noise of these frames.
    fn judge(&self, has_touches: bool, fitted: &FittedFrames) -> Result<Judge, SkinError> {
        let FittedFrames { skin, frames, .. } = fitted;
        let noise = match fitted.noise()? {
            Some(noise) => noise,
            None => DataNoise::unknown(&fitted.differences(), &fitted.good()),
        };
        let used = noise.std.iter().zip(&frames.used);
        let std: Vec<f64> =
            used.map(|(std, used)| if *used { *std } else { f64::INFINITY }).collect();
        let raster = skin.raster(&mut Progress::silent())?;
        let jacobian = skin.pixel_jacobian(raster, &frames.used)?;
        let weights = self.weights_for(has_touches);
        let new = if self.is_of_this_skin { Judge::new } else { Judge::on_another_skin };
        Ok(new(weights, jacobian.view(), &std, raster.mask().view())?)
    }

    /// Returns what decides about the net's images of these frames.
    fn trust(&self, has_touches: bool, fitted: &FittedFrames) -> Trust {
        let sees_touches = inputs::needs_touches(self.weights_for(has_touches).shape);
        match (self.is_of_this_skin, sees_touches) {
            (true, _) => Trust::Data,
            // of a ball in the middle of a tank it made two (`golf_ball_b`)
            (false, false) if self.of_images.is_some() => Trust::None(
                "the shipped net of images alone was trained on another skin, and the noise is unknown, without which \
                 no touches can be sought for the other one ([noise])",
            ),
            (false, false) => Trust::Data,
            (false, true) if !fitted.fit.is_alike() => Trust::None(
                "the net was trained on another skin, and the touches that it sees are not reliable, since the model \
                 does not explain the reference",
            ),
            (false, true) => Trust::Touches,
        }
    }

    /// Size of the net.
    pub fn shape(&self) -> UnetShape {
        self.weights.shape
    }

    /// Describes it in words.
    pub fn description(&self) -> String {
        let shape = self.weights.shape;
        format!(
            "U-net of {} weights ({}), {} frame{} deep in time",
            shape.parameters(),
            self.source,
            shape.history,
            if shape.history == 1 { "" } else { "s" }
        )
    }

    /// Returns what the net's file states as JSON.
    pub fn json(&self) -> Value {
        json!({
            "weights": self.source,
            "parameters": self.weights.shape.parameters(),
            "history": self.weights.shape.history,
            "trained_for": self.weights.skin,
            "skin": self.skin,
            "about": self.weights.about,
        })
    }
}
