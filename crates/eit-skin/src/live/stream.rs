//! From frames to touches, one frame at a time, whatever their source.

use super::clock::Clock;
use super::epoch::{Epoch, EpochSettings};
use super::listed::ListedTouches;
use super::reference::ReferenceFrames;
use super::{
    LiveImages, LiveModel, SkinState, TouchFrame, check_reference_frames, is_interruption,
    is_reference,
};
use crate::error::SkinError;
use eit_hw::driver::{Event, FrameSource, Setup};
use eit_hw::{Frame, Unit};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Computes the touches of frames one by one; the first frames of an epoch are its reference. What needs the reference is set up on a
/// thread of its own if frames arrive now: none of them waits, and touches follow from the first one after that. Frames of a recording
/// wait, and touches follow where they did.
#[derive(Debug)]
pub struct LiveStream {
    settings: EpochSettings,
    /// Factor for the frame's values.
    factor: f64,
    reference: ReferenceFrames,
    /// [`Frame::epoch`] of the last frame.
    connection: Option<u32>,
    /// [`Frame::sequence`] of the last frame.
    sequence: Option<u64>,
    /// [`Frame::host_time_s`] of the last frame.
    host_time_s: Option<f64>,
    epoch: Option<Epoch>,
    /// The next epoch while it is set up beside the frames.
    coming: Option<JoinHandle<Result<Epoch, SkinError>>>,
    /// Number of the last frame of this epoch that is not searched for touches, if it is known.
    until: Option<u64>,
    /// Whether that frame has come.
    is_ready: bool,
    /// Clock of the epoch before, which the next one continues.
    clock: Option<Clock>,
    listed: ListedTouches,
    /// Whether a frame of this epoch was searched for touches.
    has_found: bool,
    /// Number of frames since the start that were searched for touches.
    frames: u64,
    values: Vec<f64>,
    time_s: f64,
    latency_s: Option<f64>,
    image_latency_s: Option<f64>,
    /// Arrival time of the last frame if it was live, seconds since 1970.
    came_s: Option<f64>,
}

/// What an event of a source led to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// The source has ended.
    Over,
    /// No event came in time.
    Idle,
    /// An event that is no frame.
    Event,
    /// A frame for the reference, or one that came while the detector of touches was set up.
    Waiting {
        /// Number of frames still needed, at least 1; 0 with the last one that is not searched for touches.
        left: usize,
    },
    /// A frame whose touches were found ([`LiveStream::shown`]).
    Touches,
}

impl LiveStream {
    /// Creates a stream for the frames of an instrument with this set-up.
    pub(crate) fn new(model: Arc<LiveModel>, setup: &Setup) -> Self {
        Self::of_unit(model, setup.unit, setup.frame_rate_hz)
    }

    /// Creates a stream for frames in a unit, with the frame rate if it is known.
    pub fn of_unit(model: Arc<LiveModel>, unit: Unit, frame_rate_hz: Option<f64>) -> Self {
        Self {
            factor: model.skin().live_factor(unit),
            reference: ReferenceFrames::new(model.reference_frames),
            connection: None,
            sequence: None,
            host_time_s: None,
            settings: EpochSettings { model, unit, frame_rate_hz, with_images: true },
            epoch: None,
            coming: None,
            until: None,
            is_ready: false,
            clock: None,
            listed: ListedTouches::new(),
            has_found: false,
            frames: 0,
            values: Vec::new(),
            time_s: 0.0,
            latency_s: None,
            image_latency_s: None,
            came_s: None,
        }
    }

    /// Disables images, which touches do not need.
    pub fn without_images(mut self) -> Self {
        self.settings.with_images = false;
        self
    }

    /// Enables images from the next epoch on.
    pub(super) fn make_images(&mut self) {
        self.settings.with_images = true;
    }

    /// Begins a new epoch: the next frames are its reference.
    pub fn restart(&mut self) {
        if let Some(epoch) = self.epoch.take() {
            self.listed.end_epoch(epoch.finder.next_id());
            self.clock = Some(epoch.clock);
        }
        (self.coming, self.until, self.is_ready) = (None, None, false);
        self.has_found = false;
        self.listed.touches.clear();
        self.reference = ReferenceFrames::new(self.settings.model.reference_frames);
    }

    /// Begins a new epoch with these frames as its reference.
    ///
    /// # Errors
    ///
    /// Too few or too many frames, or some with the wrong length; a reference without noise. The next frames are
    /// then the reference.
    pub fn set_reference(&mut self, frames: &[Frame]) -> Result<(), SkinError> {
        check_reference_frames(frames.len())?;
        let measurements = self.settings.model.skin().protocol.measurements();
        frames.iter().try_for_each(|frame| SkinError::check_frame(frame, measurements))?;
        self.restart();
        let epoch = self.settings.set_up(self.clock, frames.to_vec(), Vec::new())?;
        self.begin(epoch);
        (self.until, self.is_ready) = (self.sequence, true);
        Ok(())
    }

    /// Returns the frames of this epoch's reference; empty while it is taken.
    pub fn reference_frames(&self) -> &[Frame] {
        self.epoch.as_ref().map_or(&[], |epoch| &epoch.reference)
    }

    /// Returns the number of the last frame of this epoch that was not searched for touches; `None` before it has come.
    pub fn until(&self) -> Option<u64> {
        self.until.filter(|_| self.is_ready)
    }

    /// Takes the frames with these numbers as the reference, unless there is one or they have passed, and searches those after
    /// `until` for touches, else those after the reference.
    fn name_reference(&mut self, sequences: Vec<u64>, until: Option<u64>) {
        let is_ahead = sequences.iter().max() > self.sequence.as_ref();
        if is_ahead && self.epoch.is_none() && is_reference(sequences.len()) {
            self.reference =
                ReferenceFrames::of_named(self.settings.model.reference_frames, sequences);
            self.until = until;
        }
    }

    /// Ends the touches that were shown last, because no frame comes: the instrument is silent or gone, or the run is over. Returns
    /// the list that says so ([`SkinState::NoData`]); `None` if the last list already did.
    pub fn end(&mut self) -> Option<TouchFrame<'_>> {
        if !self.listed.end() {
            return None;
        }
        self.has_found = false;
        let host_time_s = self.came_s.map(|_| now_s()).or(self.host_time_s);
        Some(TouchFrame { host_time_s, ..self.last_frame(SkinState::NoData)? })
    }

    /// The last frame and its touches; `None` before the first one.
    fn last_frame(&self, state: SkinState) -> Option<TouchFrame<'_>> {
        Some(TouchFrame {
            number: self.frames.checked_sub(1)?,
            sequence: self.sequence?,
            epoch: self.connection?,
            time_s: self.time_s,
            host_time_s: self.host_time_s,
            state,
            touches: &self.listed.touches,
            ..TouchFrame::default()
        })
    }

    /// Returns by what part of the voltages frames change, if the reference waits for that reason
    /// ([`unrest_text`](super::unrest_text)); `None` once it is taken.
    pub fn unrest(&self) -> Option<f64> {
        self.reference.unrest().filter(|_| self.epoch.is_none())
    }

    /// Waits for the next event of a source and processes it; `see` is called first, with the list of touches that end with it.
    pub(super) fn step<E: From<SkinError>>(
        &mut self,
        source: &mut dyn FrameSource,
        is_live: bool,
        timeout: Duration,
        see: impl FnOnce(&Event, Option<TouchFrame<'_>>) -> Result<(), E>,
    ) -> Result<Step, E> {
        if source.is_over() {
            return Ok(Step::Over);
        }
        let Some(event) = source.next_event(timeout).map_err(SkinError::from)? else {
            return Ok(if source.is_over() { Step::Over } else { Step::Idle });
        };
        let ended = if is_interruption(&event) { self.end() } else { None };
        see(&event, ended)?;
        match event {
            Event::Frame(frame) => {
                let step = self.push(&frame, is_live);
                source.recycle(frame);
                Ok(step?)
            }
            Event::Reconnected { epoch } => {
                // contacts and gains may have changed: the old reference is invalid
                self.restart();
                (self.connection, self.sequence) = (Some(epoch), None);
                Ok(Step::Event)
            }
            Event::Reference { sequences, until, .. } => {
                self.name_reference(sequences, until);
                Ok(Step::Event)
            }
            _ => Ok(Step::Event),
        }
    }

    /// Makes the image of the frame passed to [`LiveStream::push`], if images are enabled. After
    /// frames without an image it is coupled to the last one, unless that is older than half a second.
    ///
    /// # Errors
    ///
    /// An image that cannot be made.
    pub fn make_image(&mut self) -> Result<(), SkinError> {
        let Some(epoch) = &mut self.epoch else { return Ok(()) };
        if epoch.make_image(&self.values, &self.listed.touches, self.time_s)? {
            self.image_latency_s = self.came_s.map(|came_s| now_s() - came_s);
        }
        Ok(())
    }

    /// Takes a frame and finds its touches; [`LiveStream::make_image`] can make its image any time before the next
    /// frame. `is_live` means that the frame arrives now, so that latency is measured.
    ///
    /// # Errors
    ///
    /// A frame with the wrong length; a reference without noise.
    pub fn push(&mut self, frame: &Frame, is_live: bool) -> Result<Step, SkinError> {
        SkinError::check_frame(frame, self.settings.model.skin().protocol.measurements())?;
        (self.sequence, self.host_time_s) = (Some(frame.sequence), frame.host_time_s);
        // a reference of another connection, gain or set-up does not hold any more
        if self.connection.replace(frame.epoch).is_some_and(|before| before != frame.epoch) {
            self.restart();
        }
        let Some(epoch) = self.epoch.as_mut().filter(|_| self.is_ready) else {
            return self.wait(frame, is_live);
        };
        let factor = self.factor;
        self.values.clear();
        let kind = self.settings.model.skin().settings.recording.values;
        self.values.extend(frame.values.iter().map(|value| factor * kind.voltage(*value)));
        let time_s = epoch.clock.next_s(frame);
        let values = &self.values;
        let is_good = |i: usize| frame.quality[i].is_good() && values[i].is_finite();
        let is_resumed = self.listed.clear(epoch.finder.next_id());
        epoch.has_image = true;
        self.listed.take(epoch.finder.push(values, is_good, time_s)?, is_resumed);
        epoch.has_image = false;
        self.has_found = true;
        self.time_s = time_s;
        self.came_s = frame.host_time_s.filter(|_| is_live);
        self.latency_s = self.came_s.map(|came_s| now_s() - came_s);
        self.image_latency_s = None;
        self.frames += 1;
        Ok(Step::Touches)
    }

    /// Takes a frame that is not searched for touches.
    fn wait(&mut self, frame: &Frame, is_live: bool) -> Result<Step, SkinError> {
        if self.epoch.is_none() {
            let epoch = match self.coming.take() {
                Some(coming) if !coming.is_finished() => {
                    self.coming = Some(coming);
                    return Ok(Step::Waiting { left: 1 });
                }
                Some(come) => {
                    come.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))?
                }
                None if !self.reference.take(frame) => {
                    return Ok(Step::Waiting { left: self.reference.left() });
                }
                None => {
                    let (reference, notes) = self.reference.finish();
                    let (settings, before) = (self.settings.clone(), self.clock);
                    let set_up = move || settings.set_up(before, reference, notes);
                    if is_live {
                        let thread = std::thread::Builder::new().name("eit set-up".to_owned());
                        let failed = |e| SkinError::Failure(format!("a thread: {e}"));
                        self.coming = Some(thread.spawn(set_up).map_err(failed)?);
                        return Ok(Step::Waiting { left: 1 });
                    }
                    set_up()?
                }
            };
            self.begin(epoch);
        }
        self.is_ready = frame.sequence >= *self.until.get_or_insert(frame.sequence);
        Ok(Step::Waiting { left: usize::from(!self.is_ready) })
    }

    /// Returns the results for the frame that was pushed last; `None` while the reference is taken.
    pub fn shown(&self) -> Option<TouchFrame<'_>> {
        let epoch = self.epoch.as_ref().filter(|_| self.has_found)?;
        Some(TouchFrame {
            faults: epoch.finder.faults(),
            whole: epoch.is_whole(),
            level_s: epoch.finder.level_s(),
            latency_s: self.latency_s,
            images: epoch.images.as_ref().filter(|_| epoch.has_image),
            image_latency_s: self.image_latency_s,
            ..self.last_frame(epoch.state())?
        })
    }

    /// Returns a line that describes how the images are made, such as for a caption; empty if there are none
    /// yet.
    pub(crate) fn image_text(&self) -> &str {
        self.epoch
            .as_ref()
            .and_then(|epoch| epoch.images.as_ref())
            .map_or("", LiveImages::description)
    }

    /// Returns what the reference of this epoch says about the scene, such as voltages that are not those of its
    /// electrodes; empty while the reference is taken.
    pub fn notes(&self) -> &[String] {
        self.epoch.as_ref().map_or(&[], |epoch| &epoch.notes)
    }

    /// Begins an epoch.
    fn begin(&mut self, mut epoch: Epoch) {
        epoch.finder.set_first_id(self.listed.first_id);
        self.epoch = Some(epoch);
    }
}

fn now_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64()
}
