//! The scene's movie, frame by frame: total variation over a window, then the net.

use crate::denoise::{LiveNet, Net};
use crate::error::CliError;
use crate::frames::Frames;
use crate::method::Method;
use crate::pipeline::tv;
use crate::pipeline::{Linearised, Setup};
use crate::scene::{DifferenceKind, Scene};
use eit_inverse::{InverseError, StTvStream};
use eit_mesh::Raster;

/// What makes the images of an epoch; nothing in it depends on a clock.
pub(crate) struct Movie {
    kind: DifferenceKind,
    words: String,
    window: Option<StTvStream>,
    net: Option<LiveNet>,
    raster: Raster,
    /// Differences of the frame at hand; NaN where a value is not used.
    differences: Vec<f64>,
    good: Vec<bool>,
    raw: Vec<f64>,
    made: Vec<f64>,
    state: State,
}

/// How the image at hand came about.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct State {
    /// Proven relative distance of the window to its optimum, and iterations; `None`: one step, or
    /// nothing but noise.
    pub gap: Option<f64>,
    /// Iterations.
    pub iterations: usize,
    /// The net's image does not explain the measurements: the raw one is shown.
    pub is_aside: bool,
    /// The frame could not be explained within `delta`, and its neighbours stand for it.
    pub is_interpolated: bool,
}

impl Movie {
    /// For frames like these; `gain` is the factor from the model's voltages to the reference's.
    pub fn new(
        (scene, method, net): (&Scene, Method, Option<&Net>),
        (setup, linearised, raster): (&Setup, &Linearised, &Raster),
        given: (&Frames, f64),
    ) -> Result<Self, CliError> {
        let models = (setup, linearised, raster);
        let window = match method.is_tv() {
            true => Some(tv::stream(scene, method, models, given)?),
            false => None,
        };
        let mut words = match (method, &window) {
            (Method::StTv, Some(tv)) => {
                format!("st-tv over the last {} frames, {}", tv::WINDOW, tv.words())
            }
            (_, Some(tv)) => format!("total variation of each frame, {}", tv.words()),
            (_, None) => "one-step Gauss-Newton, noise figure 1".to_owned(),
        };
        if net.is_some() {
            words += ", U-net";
        }
        let net = net.map(|net| LiveNet::new(net, scene, models, given)).transpose()?;
        let pixels = raster.masked_pixels().len();
        Ok(Self {
            kind: scene.difference_kind(&setup.protocol),
            words,
            window: window.map(|tv| tv.stream),
            net,
            raster: raster.clone(),
            differences: vec![0.0; given.0.used.len()],
            good: given.0.used.clone(),
            raw: vec![0.0; pixels],
            made: vec![0.0; pixels],
            state: State::default(),
        })
    }

    /// Takes a frame; `one_step` is its image by the detector of touches.
    pub fn push(
        &mut self,
        (values, reference): (&[f64], &[f64]),
        is_good: impl Fn(usize) -> bool,
        one_step: &[f64],
    ) -> Result<(), CliError> {
        for (i, difference) in self.differences.iter_mut().enumerate() {
            self.good[i] = is_good(i);
            *difference = match (self.good[i], self.kind) {
                (false, _) => f64::NAN,
                (true, DifferenceKind::Plain) => values[i] - reference[i],
                (true, DifferenceKind::Normalised) => (values[i] - reference[i]) / reference[i],
            };
        }
        self.state = State::default();
        match &mut self.window {
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

    /// The image after the net, where there is one: touches are found in it.
    pub fn denoised(&self) -> Option<&[f64]> {
        self.net.is_some().then_some(&*self.made)
    }

    /// How it came about.
    pub fn state(&self) -> State {
        self.state
    }
}
