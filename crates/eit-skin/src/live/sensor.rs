//! The interface for a robot: touches from the frames of its instrument, a recording, or its own code.

use super::summary::NOTICES;
use super::{LiveModel, LiveStream, REFERENCE_FRAMES, Step, TouchFrame, WAIT};
use crate::error::SkinError;
use crate::progress::Progress;
use crate::skin::Skin;
use eit_hw::driver::{Event, FrameSource, Statistics};
use eit_hw::{Frame, Unit};
use eit_inverse::touch::Touch;
use std::sync::Arc;
use std::time::{Duration, Instant};

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
    /// When touches were found last.
    found_at: Option<Instant>,
    notices: Vec<String>,
}

/// What a [`Sensor`] reports next.
#[derive(Debug, Clone)]
pub enum Next<'a> {
    /// The touches of a frame.
    Frame(TouchFrame<'a>),
    /// A frame for the reference came, which needs `left` more; at 0 it has been taken.
    Waiting {
        /// Number of frames still needed.
        left: usize,
    },
    /// Something that is no frame: the instrument is silent, lost or found again, or frames were lost.
    Event(Event),
    /// Nothing came in time.
    Nothing,
    /// The source has ended; nothing will come. Always if frames are pushed.
    Over,
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

    /// Plays a recording as if it were live (feature `recording`), as fast as touches are requested. Its reference is the
    /// recorded one, if it has one ([`replayed_reference_frames`](super::replayed_reference_frames)).
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
        let mut replay = eit_hw::driver::Replay::open(recording.as_ref(), Some(quadruples), pace)?
            .with_frame_rate(settings.frame_rate_hz);
        let frames = super::replayed_reference_frames(&mut replay, settings);
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
            found_at: None,
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
        Ok(Sensor { stream, source, reference_frames, found_at: None, notices: Vec::new() })
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
            match self.poll(WAIT)?.0 {
                Step::Over => return Ok(None),
                // borrow again: a borrow that a loop may return lasts for the whole loop
                Step::Touches => return Ok(self.shown()),
                _ => {}
            }
        }
    }

    /// Waits up to `timeout` for whatever comes next: a frame, or an event.
    ///
    /// # Errors
    ///
    /// The errors of [`Sensor::next`].
    pub fn next_within(&mut self, timeout: Duration) -> Result<Next<'_>, SkinError> {
        // not an end, which a long time would put beyond what a clock holds
        let start = Instant::now();
        loop {
            return Ok(match self.poll(timeout.saturating_sub(start.elapsed()))? {
                (Step::Idle, _) if start.elapsed() < timeout => continue,
                (Step::Over, _) => Next::Over,
                (Step::Touches, _) => self.shown().map_or(Next::Nothing, Next::Frame),
                (Step::Waiting { left }, _) => Next::Waiting { left },
                (Step::Idle | Step::Event, event) => event.map_or(Next::Nothing, Next::Event),
            });
        }
    }

    /// Takes a frame in volt and protocol order; returns `None` while the reference is taken.
    ///
    /// # Errors
    ///
    /// A frame with the wrong length, or a reference without noise.
    pub fn push(&mut self, frame: &Frame) -> Result<Option<TouchFrame<'_>>, SkinError> {
        let step = self.stream.push(frame, false)?;
        self.finish(step)?;
        Ok(self.shown().filter(|_| step == Step::Touches))
    }

    /// Returns the touches of the last frame if it arrived within `age`; `None` while the reference is taken,
    /// or if the instrument has been silent for longer.
    pub fn touches_within(&self, age: Duration) -> Option<&[Touch]> {
        let is_fresh = self.found_at.is_some_and(|found| found.elapsed() <= age);
        self.shown().filter(|_| is_fresh).map(|shown| shown.touches)
    }

    /// Returns what the reference says about the scene, such as voltages that are not those of its electrodes: touches
    /// may then be elsewhere. Empty while the reference is taken.
    pub fn notes(&self) -> &[String] {
        self.stream.notes()
    }

    /// Returns the first notices of the source itself, such as damage of a recording.
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
        self.found_at = None;
    }

    /// Takes these frames of the untouched skin as the reference at once, such as those of an earlier run: in volt and
    /// protocol order if frames are pushed, else as the source has them. It holds until the instrument is lost.
    ///
    /// # Errors
    ///
    /// The errors of [`LiveStream::set_reference`].
    pub fn set_reference(&mut self, frames: &[Frame]) -> Result<(), SkinError> {
        self.found_at = None;
        self.stream.set_reference(frames)
    }

    /// Returns the frames of the reference; empty while it is taken.
    pub fn reference(&self) -> &[Frame] {
        self.stream.reference_frames()
    }

    /// Returns counts of lost, flagged and damaged frames so far; `None` if frames are pushed.
    pub fn statistics(&self) -> Option<Statistics> {
        match &self.source {
            Source::Stream { frames, .. } => Some(frames.statistics()),
            Source::Pushed => None,
        }
    }

    /// Returns the results of the last frame; `None` while the reference is taken.
    pub fn shown(&self) -> Option<TouchFrame<'_>> {
        self.stream.shown()
    }

    /// Waits for one event of the source; returns it too if it is no frame.
    fn poll(&mut self, timeout: Duration) -> Result<(Step, Option<Event>), SkinError> {
        let Source::Stream { frames, is_live } = &mut self.source else {
            return Ok((Step::Over, None));
        };
        let mut seen = None;
        let step = self.stream.step(frames.as_mut(), *is_live, timeout, |event, _| {
            if let Event::Notice(notice) = event
                && self.notices.len() < NOTICES
            {
                self.notices.push(notice.clone());
            }
            seen = (!matches!(event, Event::Frame(_))).then(|| event.clone());
            Ok::<_, SkinError>(())
        })?;
        self.finish(step)?;
        Ok((step, seen))
    }

    /// Makes the image of a frame whose touches were found.
    fn finish(&mut self, step: Step) -> Result<(), SkinError> {
        match step {
            Step::Touches => {
                self.stream.make_image()?;
                self.found_at = Some(Instant::now());
            }
            Step::Waiting { .. } => self.found_at = None,
            Step::Over | Step::Idle | Step::Event => {}
        }
        Ok(())
    }
}
