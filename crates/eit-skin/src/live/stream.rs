//! From frames to touches, one frame at a time, whatever their source.

use super::clock::Clock;
use super::reference::{ReferenceFrames, measured};
use super::{
    LiveImages, LiveModel, SkinState, check_reference_frames, is_interruption, is_reference,
};
use crate::error::SkinError;
use crate::faults::ElectrodeFault;
use crate::progress::Progress;
use crate::touches::{TouchFinder, assumed_rate_text};
use eit_hw::driver::{Event, FrameSource, Setup};
use eit_hw::{Frame, Unit};
use eit_inverse::touch::{Touch, TouchState};
use std::sync::Arc;
use std::thread::{JoinHandle, ScopedJoinHandle};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// An image older than this says little about the next one, seconds.
const LONGEST_LINK_S: f64 = 0.5;

/// Computes the touches of frames one by one; the first frames of an epoch are its reference. What needs the reference is set up on a
/// thread of its own if frames arrive now: none of them waits, and touches follow from the first one after that. Frames of a recording
/// wait, and touches follow where they did.
#[derive(Debug)]
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
    /// Id of the next epoch's first touch: ids are never used again.
    first_id: u64,
    /// Added to the ids of the epoch's finder, some of whose touches have ended for everybody else.
    id_offset: u64,
    /// Whether the list that was made last says that all touches have ended.
    is_ended: bool,
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
#[derive(Debug)]
struct Epoch {
    /// Frames of its reference, ...
    reference: Vec<Frame>,
    /// ... and what they say about the scene.
    notes: Vec<String>,
    finder: TouchFinder,
    images: Option<LiveImages>,
    clock: Clock,
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

/// The touches of one frame, and its image if images are made.
#[derive(Debug, Clone, Copy, Default)]
pub struct TouchFrame<'a> {
    /// Number of frames shown before it since the start.
    pub number: u64,
    /// Sequence number assigned by the instrument; gaps are lost frames.
    pub sequence: u64,
    /// Number of the connection, from 0; it increases when a lost instrument is found again.
    pub epoch: u32,
    /// Time of the frame, seconds: the instrument's, else that of its arrival. It increases over the whole session, also
    /// where an instrument that was found again begins at 0.
    pub time_s: f64,
    /// Time when its last byte arrived by this computer's clock, seconds since 1970.
    pub host_time_s: Option<f64>,
    /// What is known of the skin.
    pub state: SkinState,
    /// Touches. Empty if nothing touches the skin, and if nothing is known of it: see `state`, `whole`.
    pub touches: &'a [Touch],
    /// Electrodes excluded from the frame: open, shorted, noisy, stuck or drifting.
    pub faults: &'a [ElectrodeFault],
    /// Whether every used measurement counted: no faulty electrode or bad value was excluded.
    pub whole: bool,
    /// Conductivity change of the faintest touch, siemens.
    pub level_s: f64,
    /// Time from the last byte of a live frame to its touches, seconds.
    pub latency_s: Option<f64>,
    /// The image, if images are made and this one has been.
    pub images: Option<&'a LiveImages>,
    /// Time from the last byte of a live frame to its image, seconds.
    pub image_latency_s: Option<f64>,
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
            unit,
            frame_rate_hz,
            with_images: true,
            reference: ReferenceFrames::new(model.reference_frames),
            connection: None,
            sequence: None,
            host_time_s: None,
            model,
            epoch: None,
            coming: None,
            until: None,
            is_ready: false,
            clock: None,
            first_id: 1,
            id_offset: 0,
            is_ended: true,
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
            self.first_id = epoch.finder.next_id() + std::mem::take(&mut self.id_offset);
            self.clock = Some(epoch.clock);
        }
        (self.coming, self.until, self.is_ready) = (None, None, false);
        self.has_found = false;
        self.touches.clear();
        self.reference = ReferenceFrames::new(self.model.reference_frames);
    }

    /// Begins a new epoch with these frames as its reference.
    ///
    /// # Errors
    ///
    /// Too few or too many frames, or some with the wrong length; a reference without noise. The next frames are
    /// then the reference.
    pub fn set_reference(&mut self, frames: &[Frame]) -> Result<(), SkinError> {
        check_reference_frames(frames.len())?;
        let measurements = self.model.skin().protocol.measurements();
        frames.iter().try_for_each(|frame| SkinError::check_frame(frame, measurements))?;
        self.restart();
        let epoch = self.set_up(frames.to_vec(), Vec::new())()?;
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
            self.reference = ReferenceFrames::of_named(self.model.reference_frames, sequences);
            self.until = until;
        }
    }

    /// Ends the touches that were shown last, because no frame comes: the instrument is silent or gone, or the run is over. Returns
    /// the list that says so ([`SkinState::NoData`]); `None` if the last list already did.
    pub fn end(&mut self) -> Option<TouchFrame<'_>> {
        if std::mem::replace(&mut self.is_ended, true) {
            return None;
        }
        self.has_found = false;
        self.touches.retain(|touch| touch.state != TouchState::End);
        for touch in &mut self.touches {
            (touch.state, touch.valid) = (TouchState::End, false);
        }
        Some(TouchFrame {
            number: self.frames.checked_sub(1)?,
            sequence: self.sequence?,
            epoch: self.connection?,
            time_s: self.time_s,
            host_time_s: self.came_s.map(|_| now_s()).or(self.host_time_s),
            state: SkinState::NoData,
            touches: &self.touches,
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
        let Some(Epoch { finder, images: Some(images), .. }) = &mut self.epoch else {
            return Ok(());
        };
        if self.has_image {
            return Ok(());
        }
        let is_old =
            self.image_time_s.is_none_or(|before_s| self.time_s - before_s > LONGEST_LINK_S);
        if is_old {
            images.restart();
        }
        self.image_time_s = Some(self.time_s);
        let is_good = |i: usize| !finder.is_missing(i);
        let is_explained = finder.step().is_none_or(|step| step.is_explained);
        images.push(&self.values, finder.reference(), is_good, &self.touches, is_explained)?;
        self.image_latency_s = self.came_s.map(|came_s| now_s() - came_s);
        self.has_image = true;
        Ok(())
    }

    /// Takes a frame and finds its touches; [`LiveStream::make_image`] can make its image any time before the next
    /// frame. `is_live` means that the frame arrives now, so that latency is measured.
    ///
    /// # Errors
    ///
    /// A frame with the wrong length; a reference without noise.
    pub fn push(&mut self, frame: &Frame, is_live: bool) -> Result<Step, SkinError> {
        SkinError::check_frame(frame, self.model.skin().protocol.measurements())?;
        (self.sequence, self.host_time_s) = (Some(frame.sequence), frame.host_time_s);
        // a reference of another connection, gain or set-up does not hold any more
        if self.connection.replace(frame.epoch).is_some_and(|before| before != frame.epoch) {
            self.restart();
        }
        let Some(Epoch { finder, clock, .. }) = self.epoch.as_mut().filter(|_| self.is_ready)
        else {
            return self.wait(frame, is_live);
        };
        let factor = self.factor;
        self.values.clear();
        let kind = self.model.skin().settings.recording.values;
        self.values.extend(frame.values.iter().map(|value| factor * kind.voltage(*value)));
        let time_s = clock.next_s(frame);
        let values = &self.values;
        let is_good = |i: usize| frame.quality[i].is_good() && values[i].is_finite();
        // what goes on after it was said to have ended is another touch to whoever was told
        let is_resumed = self.is_ended && !self.touches.is_empty();
        if is_resumed {
            self.id_offset += finder.next_id() - 1;
        }
        self.touches.clear();
        self.has_image = true;
        let offset = self.id_offset;
        let touches = finder.push(&self.values, is_good, time_s)?;
        self.touches.extend(touches.iter().map(|touch| Touch {
            id: touch.id + offset,
            state: match touch.state {
                TouchState::Hold if is_resumed => TouchState::Begin,
                state => state,
            },
            split_from: touch.split_from.map(|id| id + offset),
            merged_into: touch.merged_into.map(|id| id + offset),
            ..*touch
        }));
        self.is_ended = false;
        self.has_image = false;
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
                    let set_up = self.set_up(reference, notes);
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
        let Epoch { finder, images, .. } = self.epoch.as_ref().filter(|_| self.has_found)?;
        let mut used = finder.used().iter().enumerate();
        Some(TouchFrame {
            number: self.frames.checked_sub(1)?,
            sequence: self.sequence?,
            epoch: self.connection?,
            time_s: self.time_s,
            host_time_s: self.host_time_s,
            state: match (finder.is_frozen(), finder.is_explained()) {
                (true, _) => SkinState::Frozen,
                (false, true) => SkinState::Sound,
                (false, false) => SkinState::NotExplained,
            },
            touches: &self.touches,
            faults: finder.faults(),
            whole: finder.faults().is_empty()
                && used.all(|(i, used)| !used || !finder.is_missing(i)),
            level_s: finder.level_s(),
            latency_s: self.latency_s,
            images: images.as_ref().filter(|_| self.has_image),
            image_latency_s: self.image_latency_s,
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

    /// Returns what sets up an epoch with these reference frames and notes about them, on any thread.
    fn set_up(
        &self,
        reference: Vec<Frame>,
        mut notes: Vec<String>,
    ) -> impl FnOnce() -> Result<Epoch, SkinError> + Send + 'static {
        let Self { unit, frame_rate_hz, clock: before, with_images, .. } = *self;
        let model = Arc::clone(&self.model);
        move || {
            let clock = match before {
                Some(before) => before.next_epoch(frame_rate_hz, &reference),
                None => Clock::new(frame_rate_hz, &reference),
            };
            let frames = model.skin().frames_of_quiet(measured(&reference, unit))?;
            let fitted = model.linearised.fit(frames)?;
            let (finder, images) = std::thread::scope(|scope| {
                let images = with_images.then(|| scope.spawn(|| LiveImages::new(&model, &fitted)));
                let finder = TouchFinder::new(&fitted, clock.rate_hz, &mut Progress::silent());
                let join = |images: ScopedJoinHandle<'_, _>| {
                    images.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
                };
                (finder, images.map(join).transpose())
            });
            let finder = finder?.ok_or_else(|| {
                SkinError::input(
                    "the reference frames show no noise, from which touches are distinguished: set \
                     [noise] additive_v",
                )
            })?;
            notes.extend(fitted.frames.notes);
            notes.extend(finder.choices.warnings());
            // later epochs have the rate of the first
            if clock.is_assumed && before.is_none() {
                notes.push(assumed_rate_text());
            }
            Ok(Epoch { reference, notes, finder, images: images?, clock })
        }
    }

    /// Begins an epoch.
    fn begin(&mut self, mut epoch: Epoch) {
        epoch.finder.set_first_id(self.first_id);
        self.epoch = Some(epoch);
        // reference frames have no touches, so there is no image to make
        (self.has_image, self.image_time_s) = (true, None);
    }
}

fn now_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64()
}
