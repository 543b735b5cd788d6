//! Encodes frames and events as lines, and hands them to every sink.

mod sinks;

use crate::VERSION;
use crate::error::PublishError;
use crate::line::{EventLine, FrameLine, StartLine};
use crate::lines::LineSink;
#[cfg(any(feature = "foxglove", feature = "zenoh"))]
use crate::outbox::Severity;
use crate::outbox::SinkStatistics;
use crate::udp::UdpSink;
use eit_skin::eit_hw::driver::Event;
use eit_skin::text::{event_text, printable_json};
use eit_skin::{SkinState, Touch, TouchFrame, TouchState};
use serde::Serialize;
use std::borrow::Cow;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// How often datagrams repeat the first line.
const START_EVERY: Duration = Duration::from_secs(1);

/// What is published.
#[derive(Debug, Clone, Copy)]
pub struct Start<'a> {
    /// Name of the skin.
    pub skin: &'a str,
    /// Instrument or recording.
    pub instrument: &'a str,
    /// Number of electrodes.
    pub electrodes: usize,
    /// Number of frames in a reference.
    pub reference_frames: usize,
    /// Whether frames are live; events then carry the time of this computer's clock.
    pub is_live: bool,
}

/// Publishes the touches of each frame, and what happens between frames, to any number of sinks.
///
/// A line of JSON is encoded once, into a buffer that is reused, and leaves whole and at once: one write and one
/// flush, one datagram. After the longest line so far, a frame does not allocate.
///
/// ```
/// use eit_publish::Publisher;
///
/// // touches as JSON lines, one per frame, on a writer of your own
/// let publisher = Publisher::new().with_lines(std::io::sink())?;
/// assert!(!publisher.takes_images());
/// # Ok::<(), eit_publish::PublishError>(())
/// ```
#[derive(Default)]
pub struct Publisher {
    lines: Option<LineSink>,
    udp: Vec<UdpSink>,
    #[cfg(feature = "web")]
    web: Option<crate::web::WebServer>,
    #[cfg(feature = "zenoh")]
    zenoh: Vec<crate::ZenohSink>,
    #[cfg(feature = "foxglove")]
    foxglove: Option<crate::FoxgloveSink>,
    line: Vec<u8>,
    /// The first line, which datagrams repeat for receivers that start later, and when it was last sent.
    start_line: Vec<u8>,
    started: Option<Instant>,
    /// Frames published.
    frames: u64,
    is_live: bool,
    /// Epoch of the first connection: the time of the start, so that the touches of another program are others; 0 for lines of a
    /// recording, which are the same every time.
    first_epoch: u32,
    /// What was known of the skin in the last frame.
    #[cfg(feature = "web")]
    state: SkinState,
    /// Touches of the last frame that have not ended, and that frame's sequence, epoch and time.
    open: Vec<Touch>,
    last: (u64, u32, f64),
    /// A reference is being taken.
    is_waiting: bool,
}

impl std::fmt::Debug for Publisher {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Publisher")
            .field("has_lines", &self.lines.is_some())
            .field("udp", &self.udp)
            .field("frames", &self.frames)
            .field("is_live", &self.is_live)
            .finish_non_exhaustive()
    }
}

impl Publisher {
    /// A publisher without sinks.
    pub fn new() -> Self {
        Self::default()
    }

    /// Publishes the first line.
    ///
    /// # Errors
    ///
    /// A line that cannot be written.
    pub fn start(&mut self, start: &Start<'_>) -> Result<(), PublishError> {
        self.is_live = start.is_live;
        #[cfg(any(feature = "foxglove", feature = "zenoh"))]
        let is_networked = self.queued().next().is_some();
        #[cfg(not(any(feature = "foxglove", feature = "zenoh")))]
        let is_networked = false;
        self.first_epoch = if start.is_live || is_networked { clock_s() as u32 } else { 0 };
        if let Some(lines) = self.lines.as_ref().filter(|_| !start.is_live) {
            lines.worker.outbox.wait_for_room();
        }
        #[cfg(any(feature = "foxglove", feature = "zenoh"))]
        self.queued().for_each(|sink| sink.start(start));
        let line = StartLine {
            version: VERSION,
            skin: start.skin,
            instrument: start.instrument,
            electrodes: start.electrodes,
            reference_frames: start.reference_frames,
            epoch: self.first_epoch,
            host_time_s: self.now_s(),
        };
        self.say(&line)?;
        self.start_line.clone_from(&self.line);
        self.started = Some(Instant::now());
        Ok(())
    }

    /// Reports how many frames the reference still needs: only the first and the last report are published.
    ///
    /// # Errors
    ///
    /// A line that cannot be written.
    pub fn waiting(&mut self, left: usize) -> Result<(), PublishError> {
        // a heartbeat for those who join patches
        #[cfg(any(feature = "foxglove", feature = "zenoh"))]
        if left > 0 {
            let (epoch, host_time_s) = (self.first_epoch, Some(clock_s()));
            let state = SkinState::Reference;
            let nothing = TouchFrame { epoch, host_time_s, state, ..TouchFrame::default() };
            self.queued().for_each(|sink| sink.worker().outbox.frame(&nothing));
        }
        let was_waiting = std::mem::replace(&mut self.is_waiting, left > 0);
        let (event, text) = match (was_waiting, left) {
            (_, 0) => ("reference_taken", "the reference is taken: touches follow"),
            (false, _) => ("reference_started", "touch nothing while the reference is taken"),
            (true, _) => return Ok(()),
        };
        #[cfg(any(feature = "foxglove", feature = "zenoh"))]
        self.incident(Severity::Information, text);
        let frames = (left > 0).then_some(left as u64);
        self.say(&EventLine {
            event,
            text,
            frames,
            host_time_s: self.now_s(),
            ..Default::default()
        })
    }

    /// Publishes a notice, such as what a reference says about the scene.
    ///
    /// # Errors
    ///
    /// A line that cannot be written.
    pub fn notice(&mut self, text: &str) -> Result<(), PublishError> {
        #[cfg(any(feature = "foxglove", feature = "zenoh"))]
        self.incident(Severity::Warning, text);
        let host_time_s = self.now_s();
        self.say(&EventLine { event: "notice", text, host_time_s, ..Default::default() })
    }

    /// Publishes an event of the instrument; does nothing for a frame.
    ///
    /// # Errors
    ///
    /// A line that cannot be written.
    pub fn event(&mut self, event: &Event) -> Result<(), PublishError> {
        if matches!(
            event,
            Event::Silent { .. } | Event::Disconnected { .. } | Event::Reconnected { .. }
        ) {
            self.end_touches()?;
        }
        let Some(words) = event_text(event) else { return Ok(()) };
        #[cfg(any(feature = "foxglove", feature = "zenoh"))]
        self.incident(
            match event {
                Event::Disconnected { .. } | Event::Silent { .. } => Severity::Error,
                Event::Gap { .. } | Event::Skipped { .. } => Severity::Warning,
                _ => Severity::Information,
            },
            &words,
        );
        let mut line = EventLine { text: &words, host_time_s: self.now_s(), ..Default::default() };
        line.event = match *event {
            Event::Gap { frames } => {
                line.frames = Some(frames);
                "gap"
            }
            Event::Skipped { frames } => {
                line.frames = Some(frames);
                "skipped"
            }
            Event::Silent { for_s, .. } => {
                line.for_s = Some(for_s);
                "silent"
            }
            Event::Disconnected { .. } => "disconnected",
            Event::Reconnected { epoch } => {
                line.epoch = Some(self.first_epoch.wrapping_add(epoch));
                // a reference begun before the interruption is discarded
                self.is_waiting = false;
                "reconnected"
            }
            _ => "notice",
        };
        self.say(&line)
    }

    /// Publishes the touches of a frame.
    ///
    /// # Errors
    ///
    /// A line that cannot be written.
    pub fn touches(&mut self, frame: &TouchFrame<'_>) -> Result<(), PublishError> {
        self.last = (frame.sequence, frame.epoch, frame.time_s);
        self.open.clear();
        let open = frame.touches.iter().filter(|touch| touch.state != TouchState::End);
        self.open.extend(open);
        let frame = &TouchFrame { epoch: self.first_epoch.wrapping_add(frame.epoch), ..*frame };
        #[cfg(feature = "web")]
        let is_news = std::mem::replace(&mut self.state, frame.state) != frame.state;
        // a list that ends touches is of no frame
        self.frames += u64::from(frame.state != SkinState::NoData);
        #[cfg(any(feature = "foxglove", feature = "zenoh"))]
        self.queued().for_each(|sink| sink.worker().outbox.frame(frame));
        if !self.has_lines() {
            return Ok(());
        }
        self.encode(&FrameLine { frame })?;
        #[cfg(feature = "web")]
        if let Some(web) = &mut self.web {
            web.frame(&self.line, is_news);
        }
        self.write(true)
    }

    /// Ends the touches of the last frame, unless the program has published the list that does.
    fn end_touches(&mut self) -> Result<(), PublishError> {
        let mut touches = std::mem::take(&mut self.open);
        for touch in &mut touches {
            (touch.state, touch.valid) = (TouchState::End, false);
        }
        let ((sequence, epoch, time_s), host_time_s) = (self.last, self.now_s());
        match &*touches {
            [] => Ok(()),
            touches => self.touches(&TouchFrame {
                sequence,
                epoch,
                time_s,
                host_time_s,
                state: SkinState::NoData,
                touches,
                ..TouchFrame::default()
            }),
        }
    }

    /// Publishes the last line, and sends what sinks have queued, within three seconds each; lines of a recording wait for
    /// their reader.
    ///
    /// # Errors
    ///
    /// A line that cannot be written.
    pub fn end(&mut self) -> Result<(), PublishError> {
        self.end_touches()?;
        let said = self.say(&EventLine {
            event: "ended",
            text: "no frame follows",
            frames: Some(self.frames),
            host_time_s: self.now_s(),
            ..Default::default()
        });
        #[cfg(any(feature = "foxglove", feature = "zenoh"))]
        self.queued_mut().for_each(|sink| sink.worker_mut().finish());
        if let Some(lines) = &mut self.lines {
            lines.worker.finish();
        }
        said
    }

    /// Returns whether the reader of the lines has closed its pipe and there is no other sink. That is not an error, but a
    /// program that has no other output should end.
    pub fn is_closed(&self) -> bool {
        let is_only = self.udp.is_empty() && !self.takes_images();
        is_only && self.lines.as_ref().is_some_and(LineSink::is_closed)
    }

    /// Returns how many lines of frames were offered to their writer, and how many dropped because its reader was slow;
    /// `None` without a writer.
    pub fn line_statistics(&self) -> Option<SinkStatistics> {
        self.lines.as_ref().map(|lines| lines.worker.outbox.statistics())
    }

    /// Whether a sink takes lines.
    fn has_lines(&self) -> bool {
        #[cfg(feature = "web")]
        if self.web.is_some() {
            return true;
        }
        self.lines.is_some() || !self.udp.is_empty()
    }

    /// Passes an event to sinks that do not take lines.
    #[cfg(any(feature = "foxglove", feature = "zenoh"))]
    fn incident(&self, severity: Severity, text: &str) {
        self.queued().for_each(|sink| sink.worker().outbox.incident(severity, text));
    }

    /// Publishes a line that is not a frame.
    fn say(&mut self, line: &impl Serialize) -> Result<(), PublishError> {
        self.encode(line)?;
        #[cfg(feature = "web")]
        if let Some(web) = &self.web {
            web.event(&self.line);
        }
        self.write(false)
    }

    /// Encodes a line. It may end on a terminal and contains names given by others, so control characters and those
    /// that change the direction of text are escaped, beyond what JSON requires.
    fn encode(&mut self, line: &impl Serialize) -> Result<(), PublishError> {
        self.line.clear();
        serde_json::to_writer(&mut self.line, line)?;
        if let Ok(Cow::Owned(escaped)) = std::str::from_utf8(&self.line).map(printable_json) {
            self.line = escaped.into_bytes();
        }
        Ok(())
    }

    /// Writes the encoded line to pipes and sockets.
    fn write(&mut self, is_frame: bool) -> Result<(), PublishError> {
        let is_due = self.started.is_some_and(|started| started.elapsed() >= START_EVERY);
        if is_due && !self.udp.is_empty() {
            self.started = Some(Instant::now());
            self.udp.iter_mut().for_each(|sink| sink.send(&self.start_line));
        }
        self.udp.iter_mut().for_each(|sink| sink.send(&self.line));
        self.lines.as_ref().map_or(Ok(()), |lines| lines.line(&self.line, is_frame))
    }

    /// Time by this computer's clock, if frames are live.
    fn now_s(&self) -> Option<f64> {
        self.is_live.then(since_1970)?.map(|since| since.as_secs_f64())
    }
}

/// Time by this computer's clock; `None` before 1970.
fn since_1970() -> Option<Duration> {
    SystemTime::now().duration_since(UNIX_EPOCH).ok()
}

/// Seconds since 1970 by this computer's clock.
pub(crate) fn clock_s() -> f64 {
    since_1970().map_or(0.0, |since| since.as_secs_f64())
}

/// Nanoseconds since 1970 by this computer's clock.
#[cfg(feature = "zenoh")]
pub(crate) fn clock_ns() -> i64 {
    since_1970().map_or(0, |since| i64::try_from(since.as_nanos()).unwrap_or(i64::MAX))
}
