//! Frames to touches one by one, whoever brings them.

use super::clock::Clock;
use super::{LiveImages, LiveModel};
use crate::error::SkinError;
use crate::faults::ElectrodeFault;
use crate::progress::Progress;
use crate::touches::TouchFinder;
use eit_hw::driver::Setup;
use eit_hw::{Frame, MeasuredFrames, Unit};
use eit_inverse::touch::Touch;
use ndarray::Array2;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

/// Takes frames and gives their touches: the first frames of an epoch are its reference.
#[derive(Debug)]
pub struct LiveStream {
    model: Arc<LiveModel>,
    unit: Unit,
    frame_rate_hz: Option<f64>,
    with_images: bool,
    /// What values are multiplied by.
    factor: f64,
    reference: Vec<Frame>,
    epoch: Option<Epoch>,
    /// Frames since the start that gave touches, or none.
    frames: u64,
    values: Vec<f64>,
    touches: Vec<Touch>,
    time_s: f64,
    latency_s: Option<f64>,
}

/// What is made of an epoch's frames.
#[derive(Debug)]
struct Epoch {
    finder: TouchFinder,
    images: Option<LiveImages>,
    clock: Clock,
}

/// What became of a frame.
#[derive(Debug)]
pub enum Pushed<'a> {
    /// It belongs to the reference.
    Waiting {
        /// Frames that are still wanted for it.
        left: usize,
    },
    /// It has touches, or none, and an image where they are made.
    Shown(LiveFrame<'a>),
}

/// What one frame showed.
#[derive(Debug, Clone, Copy)]
pub struct LiveFrame<'a> {
    /// Frames before it since the start that were shown.
    pub number: u64,
    /// The frame.
    pub frame: &'a Frame,
    /// Its touches.
    pub touches: &'a [Touch],
    /// Electrodes that were left out of it.
    pub faults: &'a [ElectrodeFault],
    /// Its time for the tracker, seconds.
    pub time_s: f64,
    /// Finder of the epoch: how the frame was explained, level of a touch.
    pub finder: &'a TouchFinder,
    /// The image, where they are made.
    pub images: Option<&'a LiveImages>,
    /// From the last byte of the frame to all of this, for a live one.
    pub latency_s: Option<f64>,
}

impl LiveStream {
    /// For frames of an instrument that was set up so.
    pub fn new(model: Arc<LiveModel>, setup: &Setup) -> Self {
        Self::of_unit(model, setup.unit, setup.frame_rate_hz)
    }

    /// For frames in a unit, at a rate where it is known.
    pub fn of_unit(model: Arc<LiveModel>, unit: Unit, frame_rate_hz: Option<f64>) -> Self {
        Self {
            factor: model.skin().live_factor(unit),
            model,
            unit,
            frame_rate_hz,
            with_images: true,
            reference: Vec::new(),
            epoch: None,
            frames: 0,
            values: Vec::new(),
            touches: Vec::new(),
            time_s: 0.0,
            latency_s: None,
        }
    }

    /// Touches alone: no image is set up or made, which touches do not need.
    pub fn without_images(mut self) -> Self {
        self.with_images = false;
        self
    }

    /// Images from the next epoch on.
    pub(super) fn make_images(&mut self) {
        self.with_images = true;
    }

    /// Begins a new epoch: the next frames are its reference.
    pub fn restart(&mut self) {
        self.epoch = None;
        self.reference.clear();
    }

    /// Takes a frame; `is_live`: it comes now, so that its latency counts.
    ///
    /// # Errors
    ///
    /// A frame of another length, a reference without noise, or images that cannot be made.
    pub fn push<'a>(
        &'a mut self,
        frame: &'a Frame,
        is_live: bool,
    ) -> Result<Pushed<'a>, SkinError> {
        let wanted = self.model.skin().protocol.measurements();
        if frame.values.len() != wanted || frame.quality.len() != wanted {
            return Err(SkinError::FrameLength {
                values: frame.values.len(),
                flags: frame.quality.len(),
                measurements: wanted,
            });
        }
        if self.epoch.is_none() {
            self.reference.push(frame.clone());
            let left = self.model.reference_frames.saturating_sub(self.reference.len());
            if left == 0 {
                let reference = std::mem::take(&mut self.reference);
                self.epoch = Some(self.begin(&reference)?);
            }
            return Ok(Pushed::Waiting { left });
        }
        let factor = self.factor;
        self.values.clear();
        self.values.extend(frame.values.iter().map(|value| factor * value));
        let Some(Epoch { finder, images, clock }) = &mut self.epoch else {
            return Ok(Pushed::Waiting { left: self.model.reference_frames });
        };
        let time_s = clock.next_s(frame);
        let is_good = |i: usize| frame.quality[i].is_good();
        self.touches.clear();
        self.touches.extend_from_slice(finder.push(&self.values, is_good, time_s)?);
        if let Some(images) = images {
            images.push(&self.values, finder.reference(), |i| !finder.is_missing(i))?;
        }
        self.time_s = time_s;
        self.latency_s = frame.host_time_s.filter(|_| is_live).map(|came| now_s() - came);
        self.frames += 1;
        let left = self.model.reference_frames;
        Ok(self.shown(frame).map_or(Pushed::Waiting { left }, Pushed::Shown))
    }

    /// What the last frame that was pushed showed; `frame` is that frame. `None` while the reference is
    /// taken.
    pub fn shown<'a>(&'a self, frame: &'a Frame) -> Option<LiveFrame<'a>> {
        let Epoch { finder, images, .. } = self.epoch.as_ref()?;
        Some(LiveFrame {
            number: self.frames.checked_sub(1)?,
            frame,
            touches: &self.touches,
            faults: finder.faults(),
            time_s: self.time_s,
            finder,
            images: images.as_ref(),
            latency_s: self.latency_s,
        })
    }

    /// How images are made, for small print; empty where there are none, or none yet.
    pub fn image_words(&self) -> &str {
        self.epoch.as_ref().and_then(|epoch| epoch.images.as_ref()).map_or("", LiveImages::words)
    }

    /// An epoch whose first frames are these.
    fn begin(&self, reference: &[Frame]) -> Result<Epoch, SkinError> {
        let clock = Clock::new(self.frame_rate_hz, reference);
        let skin = self.model.skin();
        let frames = skin.frames_of_quiet(measured(reference, self.unit))?;
        let fitted = self.model.linearised.fit(frames)?;
        let mut progress = Progress::silent();
        let finder = TouchFinder::new(&fitted, clock.rate_hz, &mut progress)?.ok_or_else(|| {
            SkinError::input(
                "the reference frames show no noise to tell touches from: set [noise] \
                     additive_v",
            )
        })?;
        let images = match self.with_images {
            true => Some(LiveImages::new(&self.model, &fitted)?),
            false => None,
        };
        Ok(Epoch { finder, images, clock })
    }
}

fn now_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64()
}

/// Frames as those of a recording.
fn measured(frames: &[Frame], unit: Unit) -> MeasuredFrames {
    let shape = (frames.len(), frames.first().map_or(0, |frame| frame.values.len()));
    MeasuredFrames {
        values: Array2::from_shape_fn(shape, |(row, column)| frames[row].values[column]),
        quality: Array2::from_shape_fn(shape, |(row, column)| frames[row].quality[column]),
        unit,
        device_time_s: None,
        frequency_hz: None,
        current_a: None,
        phase_rad: None,
    }
}
