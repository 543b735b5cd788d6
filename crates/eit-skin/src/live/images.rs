//! Images frame by frame: total variation over a window, then the net.

use super::LiveModel;
use crate::denoise::LiveNet;
use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::method::Method;
use crate::movement;
use crate::progress::Progress;
use crate::scene::DifferenceKind;
use crate::total_variation::WINDOW;
use eit_inverse::{InverseError, NuisanceParameters, StTvStream};
use eit_mesh::Raster;

/// What makes the images of an epoch; nothing in it depends on a clock.
#[derive(Debug)]
pub struct LiveImages {
    kind: DifferenceKind,
    words: String,
    /// Takes the movement of electrodes out of differences for the window.
    side: Option<NuisanceParameters>,
    /// Electrodes move: only frames that are good in every used measurement have an image.
    is_whole: bool,
    window: Option<StTvStream>,
    net: Option<LiveNet>,
    raster: Raster,
    /// DifferenceFrames of the frame at hand; NaN where a value is not used.
    differences: Vec<f64>,
    good: Vec<bool>,
    used: Vec<bool>,
    raw: Vec<f64>,
    made: Vec<f64>,
    state: ImageState,
}

/// How the image at hand came about.
#[derive(Debug, Clone, Copy, Default)]
pub struct ImageState {
    /// Proven relative distance of the window to its optimum, and iterations; `None`: one step, or
    /// nothing but noise.
    pub gap: Option<f64>,
    /// Iterations.
    pub iterations: usize,
    /// The net's image does not explain the measurements: the raw one is shown.
    pub is_aside: bool,
    /// The frame could not be explained within `delta`, and its neighbours stand for it.
    pub is_interpolated: bool,
    /// The frame has bad values, and electrodes that move leave no image without them.
    pub is_lost: bool,
}

impl LiveImages {
    /// For frames like these.
    ///
    /// # Errors
    ///
    /// Those of the method and the net.
    pub fn new(model: &LiveModel, fitted: &FittedFrames) -> Result<Self, SkinError> {
        let (method, skin) = (model.method, &fitted.skin);
        let mut silent = Progress::silent();
        let freed = match method.is_tv() {
            true => fitted.without_movement(method, &mut silent)?,
            false => None,
        };
        let left = freed.as_ref().map_or(fitted, |freed| &freed.fitted);
        let window = match method.is_tv() {
            false => None,
            true => Some(left.tv_stream(method, &mut silent)?),
        };
        let movement_m = skin.skin.settings.reconstruction.electrode_movement_m;
        let mut words = match (method, &window) {
            (Method::StTv, Some(tv)) => {
                format!("st-tv over the last {} frames, {}", WINDOW, tv.words())
            }
            (_, Some(tv)) => format!("total variation of each frame, {}", tv.words()),
            (_, None) => "one-step Gauss-Newton, noise figure 1".to_owned(),
        };
        if let Some(movement_m) = movement_m {
            words += &format!(", {}", movement::words(movement_m));
        }
        if model.net.is_some() {
            words += ", U-net";
        }
        let net = model.net.as_ref().map(|net| LiveNet::new(net, fitted)).transpose()?;
        let raster = skin.raster(&mut silent)?.clone();
        let used = fitted.frames.used.clone();
        let pixels = raster.masked_pixels().len();
        Ok(Self {
            kind: skin.difference_kind(),
            words,
            side: freed.map(|freed| freed.side),
            is_whole: movement_m.is_some(),
            window: window.map(|tv| tv.stream),
            net,
            raster,
            differences: vec![0.0; used.len()],
            good: used.clone(),
            used,
            raw: vec![0.0; pixels],
            made: vec![0.0; pixels],
            state: ImageState::default(),
        })
    }

    /// Takes a frame; `one_step` is its image by the detector of touches.
    pub fn push(
        &mut self,
        values: &[f64],
        reference: &[f64],
        is_good: impl Fn(usize) -> bool,
        one_step: &[f64],
    ) -> Result<(), SkinError> {
        for (i, difference) in self.differences.iter_mut().enumerate() {
            self.good[i] = is_good(i);
            *difference = match self.good[i] {
                true => self.kind.difference(values[i], reference[i]),
                false => f64::NAN,
            };
        }
        self.state = ImageState::default();
        let mut of_used = self.used.iter().zip(&self.good);
        self.state.is_lost = self.is_whole && of_used.any(|(used, good)| *used && !*good);
        if let Some(side) = &self.side {
            side.whiten(&mut self.differences)?;
        }
        match &mut self.window {
            Some(window) if self.state.is_lost => {
                if let Some(image) = window.push_dropped().image {
                    self.raw.copy_from_slice(image);
                }
            }
            None => self.raw.copy_from_slice(one_step),
            Some(window) => {
                let step = match window.push(&self.differences, Some(&self.good)) {
                    Err(InverseError::DeltaTooSmall { .. }) => {
                        self.state.is_interpolated = true;
                        window.push_dropped()
                    }
                    step => step?,
                };
                // a window of one frame that was dropped holds the image before
                if let Some(image) = step.image {
                    self.raw.copy_from_slice(image);
                }
                self.state.iterations = step.iterations;
                self.state.gap = (!step.quiet).then(|| step.certificate.relative_gap());
            }
        }
        if let Some(net) = &mut self.net {
            let is_made = net.push(&self.raster, &self.raw, &self.differences, &mut self.made)?;
            self.state.is_aside = !is_made;
        }
        Ok(())
    }

    /// How its images are made, for small print.
    pub fn words(&self) -> &str {
        &self.words
    }

    /// The image that is shown, a value for each pixel of the skin.
    pub fn pixels(&self) -> &[f64] {
        if self.net.is_some() { &self.made } else { &self.raw }
    }

    /// The image before the net, where there is one.
    pub fn raw(&self) -> Option<&[f64]> {
        self.net.is_some().then_some(&*self.raw)
    }

    /// How it came about.
    pub fn state(&self) -> ImageState {
        self.state
    }
}
