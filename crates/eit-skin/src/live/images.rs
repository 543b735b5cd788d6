//! Images frame by frame: one-step or total variation, then the U-net.

use super::LiveModel;
use super::one_step::LiveOneStep;
use crate::denoise::{LiveNet, Verdict};
use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::movement;
use crate::progress::Progress;
use crate::scene::DifferenceKind;
use crate::total_variation::TvStream;
use eit_inverse::touch::Touch;
use eit_inverse::{InverseError, NuisanceParameters, SequenceStatus};
use eit_mesh::Raster;

/// Makes the images of an epoch; independent of any clock.
#[derive(Debug, Clone)]
pub struct LiveImages {
    kind: DifferenceKind,
    words: String,
    /// Removes electrode movement from the differences for total variation.
    side: Option<NuisanceParameters>,
    /// Electrodes may move: only frames in which every used measurement is good have an image.
    is_whole: bool,
    maker: Maker,
    net: Option<LiveNet>,
    raster: Raster,
    /// Differences of the current frame; NaN where a value is not used.
    differences: Vec<f64>,
    good: Vec<bool>,
    used: Vec<bool>,
    raw: Vec<f64>,
    made: Vec<f64>,
    state: ImageState,
}

/// Reconstructs an image from differences.
#[derive(Debug, Clone)]
enum Maker {
    OneStep(Box<LiveOneStep>),
    TotalVariation(Box<TvStream>),
}

/// How the current image was made.
#[derive(Debug, Clone, Copy, Default, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct ImageState {
    /// Certified bound on the relative distance of the image to its optimum; `None` for one-step images, for
    /// frames with nothing but noise, and for frames without data.
    pub gap: Option<f64>,
    /// Number of iterations that the image took.
    pub iterations: usize,
    /// Its time was over before it reached the gap that it should have.
    pub is_unfinished: bool,
    /// The U-net's image does not explain the measurements; its input is shown instead.
    pub is_aside: bool,
    /// The raw image shown in place of the net's does not explain the measurements either.
    pub is_unexplained: bool,
    /// The frame could not be explained within `delta` and was replaced by its neighbours.
    pub is_interpolated: bool,
    /// The frame has bad values, without which no image can be made when electrodes may move.
    pub is_lost: bool,
}

impl LiveImages {
    /// Prepares images for frames like `fitted`.
    ///
    /// # Errors
    ///
    /// Errors of the method and the U-net.
    pub(crate) fn new(model: &LiveModel, fitted: &FittedFrames) -> Result<Self, SkinError> {
        model.check_images()?;
        let (method, skin) = (model.method, &fitted.skin);
        let mut silent = Progress::silent();
        // total variation takes white differences, and the U-net's image is checked against them
        let freed = match method.is_tv() || model.net.is_some() {
            true => fitted.without_movement(method, &mut silent)?,
            false => None,
        };
        let left = freed.as_ref().map_or(fitted, |freed| &freed.fitted);
        let movement_m = skin.skin.settings.reconstruction.electrode_movement_m;
        let (maker, mut words) = match method.is_tv() {
            false => {
                let words = "one-step Gauss-Newton, noise figure 1".to_owned();
                (Maker::OneStep(Box::new(LiveOneStep::new(fitted, &mut silent)?)), words)
            }
            true => {
                let tv = left.tv_stream(method, &mut silent)?;
                let words = match tv.has_time() {
                    true => {
                        format!("st-tv, each frame linked to the one before, {}", tv.description())
                    }
                    false => format!("total variation of each frame, {}", tv.description()),
                };
                (Maker::TotalVariation(Box::new(tv)), words)
            }
        };
        if let Some(movement_m) = movement_m {
            words += &format!(", {}", movement::description(movement_m));
        }
        if model.net.is_some() {
            words += ", U-net";
        }
        let net = model.net.as_ref().map(|net| LiveNet::new(net, left)).transpose()?;
        let raster = skin.raster(&mut silent)?.clone();
        let used = fitted.frames.used.clone();
        let pixels = raster.masked_pixels().len();
        Ok(Self {
            kind: skin.difference_kind(),
            words,
            side: freed.map(|freed| freed.side),
            is_whole: movement_m.is_some(),
            maker,
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

    /// Takes a frame `[measurement]`, volts, its reference, and its touches, which the U-net sees; `is_good` tells
    /// which values count, `is_explained` whether the touches explain the frame.
    ///
    /// # Errors
    ///
    /// Errors of the method and the U-net.
    pub(super) fn push(
        &mut self,
        values: &[f64],
        reference: &[f64],
        is_good: impl Fn(usize) -> bool,
        touches: &[Touch],
        is_explained: bool,
    ) -> Result<(), SkinError> {
        for (i, good) in self.good.iter_mut().enumerate() {
            *good = self.used[i] && is_good(i);
        }
        self.state = ImageState::default();
        let mut of_used = self.used.iter().zip(&self.good);
        self.state.is_lost = self.is_whole && of_used.any(|(used, good)| *used && !*good);
        if self.net.is_some() || matches!(self.maker, Maker::TotalVariation(_)) {
            self.subtract(values, reference)?;
        }
        let Self { used, good, .. } = self;
        match &mut self.maker {
            Maker::OneStep(one_step) => {
                let is_missing = |i: usize| used[i] && !good[i];
                one_step.push(values, reference, is_missing, &mut self.raw)?;
            }
            Maker::TotalVariation(stream) => {
                let step = match self.state.is_lost {
                    true => stream.push_dropped(),
                    false => match stream.push(&self.differences, Some(&self.good)) {
                        Err(InverseError::DeltaTooSmall { .. }) => {
                            self.state.is_interpolated = true;
                            stream.push_dropped()
                        }
                        step => step?,
                    },
                };
                self.raw.copy_from_slice(step.image);
                if !self.state.is_lost {
                    self.state.iterations = step.iterations;
                    let gap = step.certificate.relative_gap();
                    self.state.is_unfinished = step.status == SequenceStatus::IterationCap;
                    self.state.gap = (!step.quiet && gap.is_finite()).then_some(gap);
                }
            }
        }
        if let Some(net) = &mut self.net {
            let Self { raster, raw, differences, made, .. } = self;
            let verdict = net.push(raster, raw, differences, touches, is_explained, made)?;
            self.state.is_aside = verdict != Verdict::Net;
            self.state.is_unexplained = verdict == Verdict::Neither;
        }
        Ok(())
    }

    /// Starts again after frames without an image.
    pub(super) fn restart(&mut self) {
        if let Maker::TotalVariation(stream) = &mut self.maker {
            stream.restart();
        }
        if let Some(net) = &mut self.net {
            net.restart();
        }
    }

    /// Differences of the current frame, with electrode movement removed.
    fn subtract(&mut self, values: &[f64], reference: &[f64]) -> Result<(), SkinError> {
        for (i, difference) in self.differences.iter_mut().enumerate() {
            *difference = match self.good[i] {
                true => self.kind.difference(values[i], reference[i]),
                false => f64::NAN,
            };
        }
        match &self.side {
            Some(side) => Ok(side.whiten(&mut self.differences)?),
            None => Ok(()),
        }
    }

    /// Returns the pixel raster of the images.
    pub fn raster(&self) -> &Raster {
        &self.raster
    }

    /// Returns a line that describes how the images are made, such as for a caption.
    pub fn description(&self) -> &str {
        &self.words
    }

    /// Returns the image to show, one value per pixel of the skin.
    pub fn pixels(&self) -> &[f64] {
        if self.net.is_some() { &self.made } else { &self.raw }
    }

    /// Returns the image before the U-net, if there is one.
    pub fn raw(&self) -> Option<&[f64]> {
        self.net.is_some().then_some(&*self.raw)
    }

    /// Returns how the current image was made.
    pub fn state(&self) -> ImageState {
        self.state
    }
}
