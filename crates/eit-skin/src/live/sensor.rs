//! The interface for a robot: touches from the frames of its instrument, a recording, or its own code.

use super::{LiveFrame, LiveModel, LiveStream, Pushed, REFERENCE_FRAMES};
use crate::error::SkinError;
use crate::faults::ElectrodeFault;
use crate::progress::Progress;
#[cfg(any(doc, feature = "recording"))]
use crate::scene::Reference;
use crate::skin::Skin;
use eit_hw::driver::{Event, FrameSource, Statistics};
use eit_hw::{Frame, Unit};
use eit_inverse::touch::Touch;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Most notices that are kept.
const MOST_NOTICES: usize = 100;
/// How long to wait for an event before checking again.
const WAIT: Duration = Duration::from_millis(50);

/// The touches of one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
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
    /// Touches. Empty if nothing touches the skin, and if nothing is known of it: see `explained`, `whole`, `frozen`.
    pub touches: &'a [Touch],
    /// Electrodes excluded from the frame: open, shorted, noisy, stuck or drifting.
    pub faults: &'a [ElectrodeFault],
    /// Whether every used measurement counted: no faulty electrode or bad value was excluded.
    pub whole: bool,
    /// Whether the touches, or the absence of any, explain the frame. If not, it is something else, such as a fault that is
    /// not known yet, and none of the touches is valid.
    pub explained: bool,
    /// Whether the instrument repeats an old frame.
    pub frozen: bool,
    /// Time from the last byte of a live frame to its touches, seconds.
    pub latency_s: Option<f64>,
}

impl<'a> From<LiveFrame<'a>> for TouchFrame<'a> {
    fn from(shown: LiveFrame<'a>) -> Self {
        let (frame, finder) = (shown.frame, shown.finder);
        let mut used = finder.used().iter().enumerate();
        Self {
            number: shown.number,
            sequence: frame.sequence,
            epoch: frame.epoch,
            time_s: shown.time_s,
            host_time_s: frame.host_time_s,
            touches: shown.touches,
            faults: shown.faults,
            whole: finder.faults().is_empty()
                && used.all(|(i, used)| !used || !finder.is_missing(i)),
            explained: finder.is_explained(),
            frozen: finder.is_frozen(),
            latency_s: shown.latency_s,
        }
    }
}

/// Reports the touches of every frame of a source, one after the other.
///
/// The first [`Sensor::reference_frames`] frames are assumed to show the untouched skin, and again after a
/// lost instrument is found. Images are made only on request ([`Sensor::with_images`]), because touches do
/// not need them.
#[derive(Debug)]
pub struct Sensor {
    stream: LiveStream,
    source: Source,
    reference_frames: usize,
    /// The frame whose touches were returned last.
    last: Option<Frame>,
    /// When they were returned.
    taken: Option<Instant>,
    notices: Vec<String>,
}

/// Where frames come from.
enum Source {
    /// An instrument (live) or a recording.
    Stream { frames: Box<dyn FrameSource + Send>, is_live: bool },
    /// The caller.
    Pushed,
}

impl std::fmt::Debug for Source {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Stream { is_live: true, .. } => f.write_str("Instrument"),
            Self::Stream { is_live: false, .. } => f.write_str("Recording"),
            Self::Pushed => f.write_str("Pushed"),
        }
    }
}

impl Skin {
    /// Opens the scene's instrument (feature `hw`). The skin must be untouched until the reference has been
    /// taken.
    ///
    /// # Errors
    ///
    /// No instrument in the scene, or one that does not respond correctly.
    #[cfg(feature = "hw")]
    pub fn open(&self) -> Result<Sensor, SkinError> {
        self.open_at(None)
    }

    /// Like [`Skin::open`], but at another port than the scene's: a serial port or `tcp:HOST:PORT`.
    ///
    /// # Errors
    ///
    /// The errors of [`Skin::open`].
    #[cfg(feature = "hw")]
    pub fn open_at(&self, port: Option<&str>) -> Result<Sensor, SkinError> {
        let instrument = &self.instrument()?;
        let session = crate::connect::open(instrument, port, crate::connect::Backlog::Latest)?;
        self.sensor_of(Box::new(session), true)
    }

    /// Plays a recording as if it were live (feature `recording`), as fast as touches are requested. Its reference is as
    /// long as that of the scene's recording ([`Reference::first_frames`]).
    ///
    /// # Errors
    ///
    /// A recording that cannot be read, or with another protocol.
    #[cfg(feature = "recording")]
    pub fn replay(&self, recording: impl AsRef<std::path::Path>) -> Result<Sensor, SkinError> {
        let quadruples = self.protocol.quadruples().ok_or_else(|| {
            SkinError::input(
                "[protocol] has general current patterns, which recordings do not support",
            )
        })?;
        let pace = eit_hw::driver::Pace::OnDemand;
        let settings = &self.settings.recording;
        let replay = eit_hw::driver::Replay::open(recording.as_ref(), Some(quadruples), pace)?
            .with_frame_rate(settings.frame_rate_hz);
        let reference = settings.reference.as_ref();
        let frames = reference.and_then(Reference::first_frames).unwrap_or(REFERENCE_FRAMES);
        self.sensor_of_frames(Box::new(replay), false, frames)
    }

    /// Creates a sensor whose frames the caller pushes, in volt and protocol order.
    ///
    /// # Errors
    ///
    /// A skin that cannot be linearised.
    pub fn sensor(&self) -> Result<Sensor, SkinError> {
        let model = Arc::new(LiveModel::new(self, REFERENCE_FRAMES, &mut Progress::silent())?);
        let rate_hz = self.settings.recording.frame_rate_hz;
        let stream = LiveStream::of_unit(model, Unit::Volt, rate_hz).without_images();
        let reference_frames = REFERENCE_FRAMES;
        Ok(Sensor {
            stream,
            source: Source::Pushed,
            reference_frames,
            last: None,
            taken: None,
            notices: Vec::new(),
        })
    }

    /// Creates a sensor for any source of frames. `is_live` means that they arrive now, so that latency is
    /// measured.
    ///
    /// # Errors
    ///
    /// The errors of [`Skin::sensor`].
    pub fn sensor_of(
        &self,
        frames: Box<dyn FrameSource + Send>,
        is_live: bool,
    ) -> Result<Sensor, SkinError> {
        self.sensor_of_frames(frames, is_live, REFERENCE_FRAMES)
    }

    fn sensor_of_frames(
        &self,
        frames: Box<dyn FrameSource + Send>,
        is_live: bool,
        reference_frames: usize,
    ) -> Result<Sensor, SkinError> {
        let model = Arc::new(LiveModel::new(self, reference_frames, &mut Progress::silent())?);
        let stream = LiveStream::new(model, frames.setup()).without_images();
        let source = Source::Stream { frames, is_live };
        Ok(Sensor {
            stream,
            source,
            reference_frames,
            last: None,
            taken: None,
            notices: Vec::new(),
        })
    }
}

impl Sensor {
    /// Also makes an image of each frame ([`Sensor::shown`]). Call it before the first frame; otherwise
    /// images begin with the next reference.
    pub fn with_images(mut self) -> Self {
        self.stream.make_images();
        self
    }

    /// Waits for the next frame after the reference and returns its touches. Returns `None` at the end of the
    /// source, and always if frames are pushed.
    ///
    /// # Errors
    ///
    /// An instrument that is lost for good, or a reference without noise.
    #[allow(clippy::should_implement_trait, reason = "the touches are borrowed from the sensor")]
    pub fn next(&mut self) -> Result<Option<TouchFrame<'_>>, SkinError> {
        loop {
            match self.poll(WAIT)? {
                Polled::Over => return Ok(None),
                Polled::Nothing => {}
                // borrow again: a borrow that a loop may return lasts for the whole loop
                Polled::Touches => return Ok(self.current()),
            }
        }
    }

    /// Like [`Sensor::next`], but also returns `None` if no frame with touches or without any comes within
    /// `timeout`, such as while the reference is taken.
    ///
    /// # Errors
    ///
    /// The errors of [`Sensor::next`].
    pub fn next_within(&mut self, timeout: Duration) -> Result<Option<TouchFrame<'_>>, SkinError> {
        // not an end, which a long time would put beyond what a clock holds
        let start = Instant::now();
        loop {
            match self.poll(timeout.saturating_sub(start.elapsed()))? {
                Polled::Touches => return Ok(self.current()),
                Polled::Nothing if start.elapsed() < timeout => {}
                Polled::Over | Polled::Nothing => return Ok(None),
            }
        }
    }

    /// Takes a frame in volt and protocol order; returns `None` while the reference is taken.
    ///
    /// # Errors
    ///
    /// A frame with the wrong length, or a reference without noise.
    pub fn push(&mut self, frame: &Frame) -> Result<Option<TouchFrame<'_>>, SkinError> {
        self.last = Some(frame.clone());
        match self.take(false)? {
            true => Ok(self.current()),
            false => Ok(None),
        }
    }

    /// Returns the touches of the last frame if it arrived within `age`; `None` while the reference is taken,
    /// or if the instrument has been silent for longer.
    pub fn touches_within(&self, age: Duration) -> Option<&[Touch]> {
        let is_fresh = self.taken.is_some_and(|taken| taken.elapsed() <= age);
        self.shown().filter(|_| is_fresh).map(|shown| shown.touches)
    }

    /// Returns what the reference says about the scene, such as voltages that are not those of its electrodes: touches
    /// may then be elsewhere. Empty while the reference is taken.
    pub fn notes(&self) -> &[String] {
        self.stream.notes()
    }

    /// Returns the first things that the source itself had to say, such as damage of a recording.
    pub fn notices(&self) -> &[String] {
        &self.notices
    }

    /// Returns the number of initial frames that form the reference.
    pub fn reference_frames(&self) -> usize {
        self.reference_frames
    }

    /// Takes a new reference: the next frames must show the untouched skin.
    pub fn restart(&mut self) {
        self.stream.restart();
        self.taken = None;
    }

    /// Returns counts of lost, flagged and damaged frames so far; `None` if frames are pushed.
    pub fn statistics(&self) -> Option<Statistics> {
        match &self.source {
            Source::Stream { frames, .. } => Some(frames.statistics()),
            Source::Pushed => None,
        }
    }

    /// Returns the current frame as the stream shows it: touches, finder, and the image if images are made.
    pub fn shown(&self) -> Option<LiveFrame<'_>> {
        self.stream.shown(self.last.as_ref()?)
    }

    fn current(&self) -> Option<TouchFrame<'_>> {
        self.shown().map(TouchFrame::from)
    }

    /// Waits for one event of the source.
    fn poll(&mut self, timeout: Duration) -> Result<Polled, SkinError> {
        let Source::Stream { frames, is_live } = &mut self.source else { return Ok(Polled::Over) };
        if frames.is_over() {
            return Ok(Polled::Over);
        }
        let is_live = *is_live;
        match frames.next_event(timeout)? {
            Some(Event::Frame(frame)) => {
                if let Some(last) = self.last.replace(frame) {
                    frames.recycle(last);
                }
                Ok(if self.take(is_live)? { Polled::Touches } else { Polled::Nothing })
            }
            Some(Event::Reconnected { .. }) => {
                self.restart();
                Ok(Polled::Nothing)
            }
            Some(Event::Notice(notice)) => {
                if self.notices.len() < MOST_NOTICES {
                    self.notices.push(notice);
                }
                Ok(Polled::Nothing)
            }
            _ => Ok(Polled::Nothing),
        }
    }

    /// Processes the last frame; returns whether it was shown.
    fn take(&mut self, is_live: bool) -> Result<bool, SkinError> {
        let Some(frame) = &self.last else { return Ok(false) };
        let is_shown = matches!(self.stream.push(frame, is_live)?, Pushed::Shown(_));
        self.taken = is_shown.then(Instant::now);
        Ok(is_shown)
    }
}

/// Kind of event.
enum Polled {
    Touches,
    Nothing,
    Over,
}
