//! What a robot holds: frames from its instrument, a recording or its own code, as touches.

use super::{LiveFrame, LiveModel, LiveStream, Pushed, REFERENCE_FRAMES};
use crate::error::SkinError;
use crate::faults::ElectrodeFault;
use crate::progress::Progress;
use crate::skin::Skin;
use eit_hw::driver::{Event, FrameSource, Statistics};
use eit_hw::{Frame, Unit};
use eit_inverse::touch::Touch;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How long to wait for an event before looking again.
const WAIT: Duration = Duration::from_millis(50);

/// The touches of one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TouchFrame<'a> {
    /// Frames before it since the start that were shown.
    pub number: u64,
    /// Number of the frame as the instrument counts; holes are frames that were lost.
    pub sequence: u64,
    /// Number of the connection, from 0: it rises when an instrument was lost and found again.
    pub epoch: u32,
    /// Its time, seconds: that of the instrument, else of its arrival.
    pub time_s: f64,
    /// When its last byte had come by this computer's clock, seconds since 1970.
    pub host_time_s: Option<f64>,
    /// Its touches; empty where nothing touches the skin.
    pub touches: &'a [Touch],
    /// Electrodes that were left out of the frame: open, shorted, noisy, stuck or drifting.
    pub faults: &'a [ElectrodeFault],
    /// Whether every measurement counted: no faulty electrode or bad value was left out.
    pub whole: bool,
    /// From the last byte of the frame to its touches, for a live one, seconds.
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
            whole: used.all(|(i, used)| !used || !finder.is_missing(i)),
            latency_s: shown.latency_s,
        }
    }
}

/// A skin that feels: gives the touches of every frame of a source, one after the other.
///
/// The first frames, [`Sensor::reference_frames`], are taken as those of the untouched skin, again
/// after the instrument was lost and found. Images are made for who asks ([`Sensor::with_images`]):
/// touches do without.
#[derive(Debug)]
pub struct Sensor {
    stream: LiveStream,
    source: Source,
    reference_frames: usize,
    /// The frame whose touches were given last.
    last: Option<Frame>,
    /// When that was.
    taken: Option<Instant>,
}

/// Where frames come from.
enum Source {
    /// An instrument, live, or a recording.
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
    /// Opens the scene's instrument (feature `hw`). The skin must be untouched until the reference is taken.
    ///
    /// # Errors
    ///
    /// No instrument in the scene, or one that does not answer as it should.
    #[cfg(feature = "hw")]
    pub fn open(&self) -> Result<Sensor, SkinError> {
        self.open_at(None)
    }

    /// [`Skin::open`] at another port than the scene's: a serial port or `tcp:HOST:PORT`.
    ///
    /// # Errors
    ///
    /// As [`Skin::open`].
    #[cfg(feature = "hw")]
    pub fn open_at(&self, port: Option<&str>) -> Result<Sensor, SkinError> {
        let instrument = &self.instrument()?;
        let overflow = eit_hw::driver::Overflow::KeepLatest;
        let session = crate::connect::open(instrument, port, overflow)?;
        self.sensor_of(Box::new(session), true)
    }

    /// Plays a recording as if it were live (feature `recording`), as fast as the touches are asked for.
    ///
    /// # Errors
    ///
    /// A recording that cannot be read, or of another protocol.
    #[cfg(feature = "recording")]
    pub fn replay(&self, recording: impl AsRef<std::path::Path>) -> Result<Sensor, SkinError> {
        let quadruples = self.protocol.quadruples().ok_or_else(|| {
            SkinError::input("[protocol] has general current patterns, which no recording names")
        })?;
        let pace = eit_hw::driver::Pace::OnDemand;
        let replay = eit_hw::driver::Replay::open(recording.as_ref(), Some(quadruples), pace)?;
        self.sensor_of(Box::new(replay), false)
    }

    /// A sensor whose frames the caller pushes, in volt and protocol order.
    ///
    /// # Errors
    ///
    /// A skin that cannot be linearised.
    pub fn sensor(&self) -> Result<Sensor, SkinError> {
        let model = Arc::new(LiveModel::new(self, REFERENCE_FRAMES, &mut Progress::silent())?);
        let rate_hz = self.settings.recording.frame_rate_hz;
        let stream = LiveStream::of_unit(model, Unit::Volt, rate_hz).without_images();
        let reference_frames = REFERENCE_FRAMES;
        Ok(Sensor { stream, source: Source::Pushed, reference_frames, last: None, taken: None })
    }

    /// Frames of any source; `is_live`: they come now, so that their latency counts.
    ///
    /// # Errors
    ///
    /// As [`Skin::sensor`].
    pub fn sensor_of(
        &self,
        frames: Box<dyn FrameSource + Send>,
        is_live: bool,
    ) -> Result<Sensor, SkinError> {
        let model = Arc::new(LiveModel::new(self, REFERENCE_FRAMES, &mut Progress::silent())?);
        let stream = LiveStream::new(model, frames.setup()).without_images();
        let source = Source::Stream { frames, is_live };
        Ok(Sensor { stream, source, reference_frames: REFERENCE_FRAMES, last: None, taken: None })
    }
}

impl Sensor {
    /// Makes an image of each frame, too ([`Sensor::shown`]); to be asked for before the first frame, else
    /// they begin with the next reference.
    pub fn with_images(mut self) -> Self {
        self.stream.make_images();
        self
    }

    /// Waits for the next frame after the reference and gives its touches; `None` when the source is
    /// over, and always for a sensor whose frames are pushed.
    ///
    /// # Errors
    ///
    /// An instrument that was lost for good, or a reference without noise.
    #[allow(clippy::should_implement_trait, reason = "the touches are borrowed from the sensor")]
    pub fn next(&mut self) -> Result<Option<TouchFrame<'_>>, SkinError> {
        loop {
            match self.poll(WAIT)? {
                Polled::Over => return Ok(None),
                Polled::Nothing => {}
                // borrowed anew: a borrow that a loop may return lasts for all of it
                Polled::Touches => return Ok(self.current()),
            }
        }
    }

    /// [`Sensor::next`] that waits no longer than so; `None` also where no frame came in time.
    ///
    /// # Errors
    ///
    /// As [`Sensor::next`].
    pub fn next_within(&mut self, timeout: Duration) -> Result<Option<TouchFrame<'_>>, SkinError> {
        match self.poll(timeout)? {
            Polled::Touches => Ok(self.current()),
            Polled::Over | Polled::Nothing => Ok(None),
        }
    }

    /// Takes a frame in volt and protocol order; `None` while the reference is taken.
    ///
    /// # Errors
    ///
    /// A frame of another length, or a reference without noise.
    pub fn push(&mut self, frame: &Frame) -> Result<Option<TouchFrame<'_>>, SkinError> {
        self.last = Some(frame.clone());
        match self.take(false)? {
            true => Ok(self.current()),
            false => Ok(None),
        }
    }

    /// The touches of the last frame, if it came within `age`: `None` while the reference is taken and
    /// where the instrument has been silent for longer.
    pub fn touches_within(&self, age: Duration) -> Option<&[Touch]> {
        let is_fresh = self.taken.is_some_and(|taken| taken.elapsed() <= age);
        self.shown().filter(|_| is_fresh).map(|shown| shown.touches)
    }

    /// Frames at the start that are the reference.
    pub fn reference_frames(&self) -> usize {
        self.reference_frames
    }

    /// Takes a new reference: the next frames must be those of the untouched skin.
    pub fn restart(&mut self) {
        self.stream.restart();
        self.taken = None;
    }

    /// Frames that were lost, flagged or damaged so far; `None` where frames are pushed.
    pub fn statistics(&self) -> Option<Statistics> {
        match &self.source {
            Source::Stream { frames, .. } => Some(frames.statistics()),
            Source::Pushed => None,
        }
    }

    /// The current frame as the stream shows it: touches, finder, and the image where they are made.
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
            _ => Ok(Polled::Nothing),
        }
    }

    /// Whether the last frame was shown.
    fn take(&mut self, is_live: bool) -> Result<bool, SkinError> {
        let Some(frame) = &self.last else { return Ok(false) };
        let is_shown = matches!(self.stream.push(frame, is_live)?, Pushed::Shown(_));
        self.taken = is_shown.then(Instant::now);
        Ok(is_shown)
    }
}

/// What an event was.
enum Polled {
    Touches,
    Nothing,
    Over,
}
