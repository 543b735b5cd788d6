//! Images frame by frame: one step or total variation, then the net.

use super::LiveModel;
use super::one_step::LiveOneStep;
use crate::denoise::{LiveNet, Verdict};
use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::movement;
use crate::progress::Progress;
use crate::scene::DifferenceKind;
use crate::total_variation::TvStream;
use eit_inverse::{InverseError, NuisanceParameters};
use eit_mesh::Raster;

/// What makes the images of an epoch; nothing in it depends on a clock.
#[derive(Debug)]
pub struct LiveImages {
    kind: DifferenceKind,
    words: String,
    /// Takes the movement of electrodes out of differences for total variation.
    side: Option<NuisanceParameters>,
    /// Electrodes move: only frames that are good in every used measurement have an image.
    is_whole: bool,
    maker: Maker,
    net: Option<LiveNet>,
    raster: Raster,
    /// Differences of the frame at hand; NaN where a value is not used.
    differences: Vec<f64>,
    good: Vec<bool>,
    used: Vec<bool>,
    raw: Vec<f64>,
    made: Vec<f64>,
    state: ImageState,
}

/// What makes an image of differences.
#[derive(Debug)]
enum Maker {
    OneStep(Box<LiveOneStep>),
    TotalVariation(Box<TvStream>),
}

/// How the image at hand came about.
#[derive(Debug, Clone, Copy, Default)]
pub struct ImageState {
    /// Proven relative distance of the image to its optimum; `None`: one step, nothing but noise, or
    /// a frame without data.
    pub gap: Option<f64>,
    /// Iterations.
    pub iterations: usize,
    /// The net's image does not explain the measurements: the raw one is shown.
    pub is_aside: bool,
    /// The raw image that is shown in its place does not explain the measurements either.
    pub is_unexplained: bool,
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
        // total variation takes white differences, and a net is held against them
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
                    true => format!("st-tv, each frame linked to the one before, {}", tv.words()),
                    false => format!("total variation of each frame, {}", tv.words()),
                };
                (Maker::TotalVariation(Box::new(tv)), words)
            }
        };
        if let Some(movement_m) = movement_m {
            words += &format!(", {}", movement::words(movement_m));
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

    /// Takes a frame `[measurement]`, volts, and what is subtracted from it; `is_good` says what of it
    /// counts.
    ///
    /// # Errors
    ///
    /// A frame of another length; those of the method and the net.
    pub fn push(
        &mut self,
        values: &[f64],
        reference: &[f64],
        is_good: impl Fn(usize) -> bool,
    ) -> Result<(), SkinError> {
        let measurements = self.used.len();
        if let Some(wrong) = [values, reference].iter().find(|v| v.len() != measurements) {
            let flags = measurements;
            return Err(SkinError::FrameLength { values: wrong.len(), flags, measurements });
        }
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
                // a frame that was dropped holds the image before
                if let Some(image) = step.image {
                    self.raw.copy_from_slice(image);
                }
                if !self.state.is_lost {
                    self.state.iterations = step.iterations;
                    let gap = step.certificate.relative_gap();
                    self.state.gap = (!step.quiet && gap.is_finite()).then_some(gap);
                }
            }
        }
        if let Some(net) = &mut self.net {
            let verdict = net.push(&self.raster, &self.raw, &self.differences, &mut self.made)?;
            self.state.is_aside = verdict != Verdict::Net;
            self.state.is_unexplained = verdict == Verdict::Neither;
        }
        Ok(())
    }

    /// Begins anew after frames of which no image was made.
    pub(super) fn restart(&mut self) {
        if let Maker::TotalVariation(stream) = &mut self.maker {
            stream.restart();
        }
        if let Some(net) = &mut self.net {
            net.restart();
        }
    }

    /// Differences of the frame at hand, without what electrodes that move explain.
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

    /// Pixels of its images.
    pub fn raster(&self) -> &Raster {
        &self.raster
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
