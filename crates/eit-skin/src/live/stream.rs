//! From frames to touches, one frame at a time, whatever their source.

use super::clock::Clock;
use super::reference::ReferenceFrames;
use super::{LiveImages, LiveModel};
use crate::error::SkinError;
use crate::faults::ElectrodeFault;
use crate::progress::Progress;
use crate::touches::{TouchFinder, assumed_rate_words};
use eit_hw::driver::Setup;
use eit_hw::{Frame, MeasuredFrames, Unit};
use eit_inverse::touch::Touch;
use ndarray::Array2;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

/// An image older than this says little about the next one, seconds.
const LONGEST_LINK_S: f64 = 0.5;

/// Computes the touches of frames one by one; the first frames of an epoch are its reference.
#[derive(Debug, Clone)]
pub struct LiveStream {
    model: Arc<LiveModel>,
    unit: Unit,
    frame_rate_hz: Option<f64>,
    with_images: bool,
    /// Factor for the frame's values.
    factor: f64,
    reference: ReferenceFrames,
    /// [`Frame::epoch`] of the last frame.
    connection: Option<u32>,
    epoch: Option<Epoch>,
    /// Clock of the epoch before, which the next one continues.
    clock: Option<Clock>,
    /// Id of the next epoch's first touch: ids are never used again.
    first_id: u64,
    /// Whether a frame of this epoch was searched for touches.
    has_found: bool,
    /// Number of frames since the start that were searched for touches.
    frames: u64,
    values: Vec<f64>,
    touches: Vec<Touch>,
    time_s: f64,
    latency_s: Option<f64>,
    image_latency_s: Option<f64>,
    /// Whether the image of the last frame has been made.
    has_image: bool,
    /// Time of the last image, seconds.
    image_time_s: Option<f64>,
    /// Arrival time of the last frame if it was live, seconds since 1970.
    came_s: Option<f64>,
}

/// Objects that process the frames of an epoch.
#[derive(Debug, Clone)]
struct Epoch {
    /// What its reference says about the scene.
    notes: Vec<String>,
    finder: TouchFinder,
    images: Option<LiveImages>,
    clock: Clock,
}

/// Outcome of pushing a frame.
#[derive(Debug)]
pub enum Pushed<'a> {
    /// The frame belongs to the reference.
    Waiting {
        /// Number of frames still needed for the reference.
        left: usize,
    },
    /// The frame was processed: its touches, and its image if images are made.
    Shown(LiveFrame<'a>),
}

/// Results for one frame.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct LiveFrame<'a> {
    /// Number of frames shown before it since the start.
    pub number: u64,
    /// The frame.
    pub frame: &'a Frame,
    /// Its touches.
    pub touches: &'a [Touch],
    /// Electrodes that were excluded from it.
    pub faults: &'a [ElectrodeFault],
    /// Its time for the tracker, seconds; it increases over the whole session.
    pub time_s: f64,
    /// Touch finder of the epoch, with details such as how the frame was explained.
    pub finder: &'a TouchFinder,
    /// The image, if images are made and this one has been.
    pub images: Option<&'a LiveImages>,
    /// Time from the last byte of a live frame to its touches, seconds.
    pub latency_s: Option<f64>,
    /// Time from the last byte of a live frame to its image, seconds.
    pub image_latency_s: Option<f64>,
}

impl LiveStream {
    /// Creates a stream for the frames of an instrument with this set-up.
    pub fn new(model: Arc<LiveModel>, setup: &Setup) -> Self {
        Self::of_unit(model, setup.unit, setup.frame_rate_hz)
    }

    /// Creates a stream for frames in a unit, with the frame rate if it is known.
    pub fn of_unit(model: Arc<LiveModel>, unit: Unit, frame_rate_hz: Option<f64>) -> Self {
        Self {
            factor: model.skin().live_factor(unit),
            unit,
            frame_rate_hz,
            with_images: true,
            reference: ReferenceFrames::new(model.reference_frames),
            connection: None,
            model,
            epoch: None,
            clock: None,
            first_id: 1,
            has_found: false,
            frames: 0,
            values: Vec::new(),
            touches: Vec::new(),
            time_s: 0.0,
            latency_s: None,
            image_latency_s: None,
            has_image: false,
            image_time_s: None,
            came_s: None,
        }
    }

    /// Disables images, which touches do not need.
    pub fn without_images(mut self) -> Self {
        self.with_images = false;
        self
    }

    /// Enables images from the next epoch on.
    pub(super) fn make_images(&mut self) {
        self.with_images = true;
    }

    /// Begins a new epoch: the next frames are its reference.
    pub fn restart(&mut self) {
        if let Some(epoch) = self.epoch.take() {
            self.first_id = epoch.finder.next_id();
            self.clock = Some(epoch.clock);
        }
        self.has_found = false;
        self.touches.clear();
        self.reference = ReferenceFrames::new(self.model.reference_frames);
    }

    /// Returns by what part of the voltages frames change, if the reference waits for that reason
    /// ([`unrest_words`](super::unrest_words)); `None` once it is taken.
    pub fn unrest(&self) -> Option<f64> {
        self.reference.unrest().filter(|_| self.epoch.is_none())
    }

    /// Takes a frame, finds its touches and makes its image. `is_live` means that the frame arrives now, so
    /// that latency is measured.
    ///
    /// # Errors
    ///
    /// A frame with the wrong length; a reference without noise; an image that cannot be made.
    pub fn push<'a>(
        &'a mut self,
        frame: &'a Frame,
        is_live: bool,
    ) -> Result<Pushed<'a>, SkinError> {
        if let Some(left) = self.find(frame, is_live)? {
            return Ok(Pushed::Waiting { left });
        }
        self.make_image(frame)?;
        Ok(self.pushed(frame))
    }

    /// Like [`LiveStream::push`], but without the image, so that touches can be acted on first.
    /// [`LiveStream::make_image`] can make it any time before the next frame.
    ///
    /// # Errors
    ///
    /// The errors of [`LiveStream::push`].
    pub fn push_touches<'a>(
        &'a mut self,
        frame: &'a Frame,
        is_live: bool,
    ) -> Result<Pushed<'a>, SkinError> {
        match self.find(frame, is_live)? {
            Some(left) => Ok(Pushed::Waiting { left }),
            None => Ok(self.pushed(frame)),
        }
    }

    /// Makes the image of the frame passed to [`LiveStream::push_touches`], if images are enabled. After
    /// frames without an image it is coupled to the last one, unless that is older than half a second.
    ///
    /// # Errors
    ///
    /// An image that cannot be made.
    pub fn make_image(&mut self, frame: &Frame) -> Result<(), SkinError> {
        let Some(Epoch { finder, images: Some(images), .. }) = &mut self.epoch else {
            return Ok(());
        };
        if self.has_image || self.values.len() != frame.values.len() {
            return Ok(());
        }
        let is_old =
            self.image_time_s.is_none_or(|before_s| self.time_s - before_s > LONGEST_LINK_S);
        if is_old {
            images.restart();
        }
        self.image_time_s = Some(self.time_s);
        let is_good = |i: usize| !finder.is_missing(i);
        let is_explained = finder.step().is_none_or(|step| step.is_explained());
        images.push(&self.values, finder.reference(), is_good, &self.touches, is_explained)?;
        self.image_latency_s = self.came_s.map(|came_s| now_s() - came_s);
        self.has_image = true;
        Ok(())
    }

    fn pushed<'a>(&'a self, frame: &'a Frame) -> Pushed<'a> {
        let left = self.model.reference_frames;
        self.shown(frame).map_or(Pushed::Waiting { left }, Pushed::Shown)
    }

    /// Takes a frame; returns the number of frames that the reference still needs, or `None` if the frame was
    /// searched for touches.
    fn find(&mut self, frame: &Frame, is_live: bool) -> Result<Option<usize>, SkinError> {
        let wanted = self.model.skin().protocol.measurements();
        if frame.values.len() != wanted || frame.quality.len() != wanted {
            return Err(SkinError::FrameLength {
                values: frame.values.len(),
                flags: frame.quality.len(),
                measurements: wanted,
            });
        }
        // a reference of another connection, gain or set-up does not hold any more
        if self.connection.replace(frame.epoch).is_some_and(|before| before != frame.epoch) {
            self.restart();
        }
        let Some(Epoch { finder, clock, .. }) = &mut self.epoch else {
            if self.reference.take(frame) {
                let (reference, notes) = self.reference.finish();
                let mut epoch = self.begin(&reference)?;
                epoch.notes.splice(0..0, notes);
                self.epoch = Some(epoch);
                // reference frames have no touches, so there is no image to make
                (self.has_image, self.image_time_s) = (true, None);
                return Ok(Some(0));
            }
            return Ok(Some(self.reference.left()));
        };
        let factor = self.factor;
        self.values.clear();
        self.values.extend(frame.values.iter().map(|value| factor * value));
        let time_s = clock.next_s(frame);
        let is_good = |i: usize| frame.quality[i].is_good();
        self.touches.clear();
        self.has_image = true;
        self.touches.extend_from_slice(finder.push(&self.values, is_good, time_s)?);
        self.has_image = false;
        self.has_found = true;
        self.time_s = time_s;
        self.came_s = frame.host_time_s.filter(|_| is_live);
        self.latency_s = self.came_s.map(|came_s| now_s() - came_s);
        self.image_latency_s = None;
        self.frames += 1;
        Ok(None)
    }

    /// Returns the results for the frame that was pushed last, which must be `frame`; `None` while the
    /// reference is taken.
    pub fn shown<'a>(&'a self, frame: &'a Frame) -> Option<LiveFrame<'a>> {
        let Epoch { finder, images, .. } = self.epoch.as_ref().filter(|_| self.has_found)?;
        Some(LiveFrame {
            number: self.frames.checked_sub(1)?,
            frame,
            touches: &self.touches,
            faults: finder.faults(),
            time_s: self.time_s,
            finder,
            images: images.as_ref().filter(|_| self.has_image),
            latency_s: self.latency_s,
            image_latency_s: self.image_latency_s,
        })
    }

    /// Returns a line that describes how the images are made, such as for a caption; empty if there are none
    /// yet.
    pub fn image_words(&self) -> &str {
        self.epoch.as_ref().and_then(|epoch| epoch.images.as_ref()).map_or("", LiveImages::words)
    }

    /// Returns what the reference of this epoch says about the scene, such as voltages that are not those of its
    /// electrodes; empty while the reference is taken.
    pub fn notes(&self) -> &[String] {
        self.epoch.as_ref().map_or(&[], |epoch| &epoch.notes)
    }

    /// Begins an epoch with these reference frames.
    fn begin(&self, reference: &[Frame]) -> Result<Epoch, SkinError> {
        let clock = match self.clock {
            Some(before) => before.next_epoch(self.frame_rate_hz, reference),
            None => Clock::new(self.frame_rate_hz, reference),
        };
        let skin = self.model.skin();
        let frames = skin.frames_of_quiet(measured(reference, self.unit))?;
        let fitted = self.model.linearised.fit(frames)?;
        let mut progress = Progress::silent();
        let finder = TouchFinder::new(&fitted, clock.rate_hz, &mut progress)?;
        let finder = finder.map(|finder| finder.with_first_id(self.first_id)).ok_or_else(|| {
            SkinError::input(
                "the reference frames show no noise, from which touches are distinguished: set \
                 [noise] additive_v",
            )
        })?;
        let images = match self.with_images {
            true => Some(LiveImages::new(&self.model, &fitted)?),
            false => None,
        };
        let mut notes = fitted.frames.notes;
        // later epochs have the rate of the first
        if clock.is_assumed && self.clock.is_none() {
            notes.push(assumed_rate_words());
        }
        Ok(Epoch { notes, finder, images, clock })
    }
}

fn now_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64()
}

/// Converts frames to those of a recording.
pub(super) fn measured(frames: &[Frame], unit: Unit) -> MeasuredFrames {
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
