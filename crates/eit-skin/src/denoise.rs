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
pub use drawn::{DrawnTouch, DrawnTouches};
pub use eit_denoise::Verdict;
pub use inputs::NetInputs;
pub use live::LiveNet;
pub use scores::{Scores, scores};

use crate::error::SkinError;
use crate::progress::Progress;
use crate::scene::{DenoiseSettings, TouchSign};
use crate::skin::Skin;
use check::SequenceJudge;
use eit_denoise::{DenoiseError, Denoiser, ImageStack, UnetShape, Weights};
use eit_mesh::Raster;
use ndarray::{Array3, ArrayView2, Axis};
use serde_json::{Value, json};

/// Weights for a skin.
#[derive(Debug, Clone)]
pub struct Net {
    weights: Weights,
    /// For images whose touches are unknown, if `weights` need touches.
    of_images: Option<Weights>,
    source: String,
    skin: String,
    /// Whether it was trained for this skin and number of pixels.
    is_of_this_skin: bool,
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
    pub sign: TouchSign,
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
                let how = "(`eit denoise --any-skin`, or both keys in the scene's [denoise]";
                SkinError::input(format!("{name}: {e} {how}: weights = {name:?}, any_skin = true)"))
            })?;
        }
        let sign = if sign == TouchSign::Decrease { -1.0 } else { 1.0 };
        let (source, skin) = (name.clone(), fingerprint.to_owned());
        Ok(Self { weights, of_images, source, skin, is_of_this_skin, sign })
    }

    /// Returns the net for images without their measurements: of the shipped weights those that see the image alone.
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
            let (made, mut judge) = self.of_frames(images, raster, check)?;
            let raw = std::mem::replace(images, made);
            let mut judgements = Vec::with_capacity(raw.dim().0);
            for (frame, (mut made, raw)) in
                images.outer_iter_mut().zip(raw.outer_iter()).enumerate()
            {
                let judgement = judge.judge(frame, made.view(), raw)?;
                if judgement.verdict != Verdict::Net {
                    made.assign(&raw);
                }
                judgements.push(judgement);
            }
            Ok(Checked::new(&judge, judgements))
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
        raster: &Raster,
        check: &Check,
        progress: &mut Progress,
    ) -> Result<(), SkinError> {
        progress.stage("U-net", || {
            *images = self.of_frames(images, raster, check)?.0;
            Ok(())
        })
    }

    /// Returns the weights for frames whose touches are known or not: the shipped ones for images alone where they are
    /// not.
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

    /// Denoises with a net whose inputs may include the measurements and touches; returns the judge of its images
    /// too.
    fn of_frames<'a>(
        &self,
        raw: &Array3<f64>,
        raster: &Raster,
        check: &'a Check,
    ) -> Result<(Array3<f64>, SequenceJudge<'a>), SkinError> {
        let touches = match inputs::needs_touches(self.weights.shape) {
            true => check.touches()?,
            false => None,
        };
        let weights = self.weights_for(touches.is_some());
        let judge = check.judge(self, touches.is_some())?;
        if !inputs::needs_data(weights.shape) {
            let mut judge = judge;
            for (frame, image) in raw.outer_iter().enumerate() {
                if is_constant(image) {
                    judge.set_constant(frame);
                }
            }
            return Ok((self.of_images(raw, raster)?, judge));
        }
        if inputs::needs_touches(weights.shape) && touches.is_none() {
            return Err(SkinError::input(format!(
                "{}: this net sees the touches of each frame, and without the noise of the data none can be \
                 sought: set [noise]",
                self.source
            )));
        }
        let touches = touches.unwrap_or_default();
        let mut judge = judge.with_explained(&touches);
        let mut net = Denoiser::new(weights, raster.mask().view())?;
        let mut inputs = NetInputs::new(check.skin(), weights.shape)?;
        let mut made = raw.clone();
        for (frame, mut out) in made.outer_iter_mut().enumerate() {
            let (differences, energy) = judge.frame(frame)?;
            let raw = raw.index_axis(Axis(0), frame);
            let touches =
                touches.get(frame).map_or(&[][..], |frame| &frame.touches).iter().copied();
            inputs.push(raw, &differences, touches, Some(energy), self.sign)?;
            match inputs.with_frame(|seen| net.push_frame_into(seen, out.view_mut())) {
                // total variation may leave one value of a noisy frame: the raw image stays
                Err(DenoiseError::InFrame { error, .. })
                    if matches!(*error, DenoiseError::ConstantImage { .. }) =>
                {
                    judge.set_constant(frame);
                    continue;
                }
                made => {
                    made?;
                }
            }
            inputs.limit(out.view_mut());
            out.mapv_inplace(|value| self.sign * value);
        }
        Ok((made, judge))
    }

    /// Size of the net.
    pub fn shape(&self) -> UnetShape {
        self.weights.shape
    }

    /// Describes it in words.
    pub fn words(&self) -> String {
        let shape = self.weights.shape;
        format!(
            "U-net of {} weights ({}), {} frame{} deep in time",
            shape.parameters(),
            self.source,
            shape.history,
            if shape.history == 1 { "" } else { "s" }
        )
    }

    /// Returns it as JSON.
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

/// Whether an image has the same value, other than zero, everywhere on the skin.
fn is_constant(image: ArrayView2<'_, f64>) -> bool {
    let mut values = image.iter().filter(|value| value.is_finite());
    let first = values.next().copied().unwrap_or(0.0);
    first != 0.0 && values.all(|value| *value == first)
}
