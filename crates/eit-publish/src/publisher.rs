//! Frames and events to lines, and lines to whoever wants them.

use crate::VERSION;
use crate::error::PublishError;
use crate::line::{EventLine, FrameLine, StartLine};
use crate::udp::UdpSink;
use eit_skin::TouchFrame;
use eit_skin::eit_hw::driver::Event;
use eit_skin::words::{event_words, printable_json};
use serde::Serialize;
use std::borrow::Cow;
use std::io::{ErrorKind, Write};
use std::time::{SystemTime, UNIX_EPOCH};

/// What the lines are about.
#[derive(Debug, Clone, Copy)]
pub struct Start<'a> {
    /// Name of the skin.
    pub skin: &'a str,
    /// Instrument or recording.
    pub instrument: &'a str,
    /// Electrodes of the skin.
    pub electrodes: usize,
    /// Frames of a reference.
    pub reference_frames: usize,
    /// Frames come now: events are stamped with this computer's clock.
    pub is_live: bool,
}

/// Writes touches frame by frame, and what happens between them, as lines of JSON.
///
/// A line is encoded once, into memory that is used again, and leaves at once and whole: one write and
/// one flush, one datagram. From the longest line on nothing is allocated for a frame.
#[derive(Default)]
pub struct Publisher {
    out: Option<Box<dyn Write + Send>>,
    udp: Vec<UdpSink>,
    #[cfg(feature = "web")]
    web: Option<crate::web::WebServer>,
    line: Vec<u8>,
    /// Frames that were published.
    frames: u64,
    is_live: bool,
    /// A reference is being taken.
    is_waiting: bool,
    is_closed: bool,
}

impl Publisher {
    /// Without anybody to write to.
    pub fn new() -> Self {
        Self::default()
    }

    /// Writes lines here, too. A reader that is slow makes its writer wait.
    pub fn with_lines(mut self, out: impl Write + Send + 'static) -> Self {
        self.out = Some(Box::new(out));
        self
    }

    /// Sends lines there, too.
    pub fn with_udp(mut self, sink: UdpSink) -> Self {
        self.udp.push(sink);
        self
    }

    /// Shows the page, too (feature `web`): frames as often as an eye sees them.
    #[cfg(feature = "web")]
    pub fn with_web(mut self, server: crate::web::WebServer) -> Self {
        self.web = Some(server);
        self
    }

    /// Whether there is a page (feature `web`).
    #[cfg(feature = "web")]
    pub fn has_web(&self) -> bool {
        self.web.is_some()
    }

    /// Whether a browser shows the page (feature `web`).
    #[cfg(feature = "web")]
    pub fn has_viewer(&self) -> bool {
        self.web.as_ref().is_some_and(crate::web::WebServer::has_browser)
    }

    /// The skin that the page draws (feature `web`).
    ///
    /// # Errors
    ///
    /// A shape that cannot be encoded.
    #[cfg(feature = "web")]
    pub fn skin(&self, shape: &crate::web::SkinShape) -> Result<(), PublishError> {
        self.web.as_ref().map_or(Ok(()), |web| web.skin(shape))
    }

    /// Whether the page could do with a new image: somebody looks, and the last one is old (feature
    /// `web`).
    #[cfg(feature = "web")]
    pub fn wants_image(&mut self) -> bool {
        self.web.as_mut().is_some_and(crate::web::WebServer::wants_image)
    }

    /// An image `[row, column]` for the page, siemens: row 0 at the top, NaN outside the skin (feature
    /// `web`).
    ///
    /// # Errors
    ///
    /// An image that cannot be encoded.
    #[cfg(feature = "web")]
    pub fn image(&self, image: eit_skin::ndarray::ArrayView2<'_, f64>) -> Result<(), PublishError> {
        let Some(web) = &self.web else { return Ok(()) };
        web.tell(&serde_json::to_vec(&crate::web::ImageEvent::new(image))?);
        Ok(())
    }

    /// The first line.
    ///
    /// # Errors
    ///
    /// A line that cannot be written.
    pub fn start(&mut self, start: &Start<'_>) -> Result<(), PublishError> {
        self.is_live = start.is_live;
        let line = StartLine {
            version: VERSION,
            skin: start.skin,
            instrument: start.instrument,
            electrodes: start.electrodes,
            reference_frames: start.reference_frames,
            host_time_s: self.now_s(),
        };
        self.say(&line)
    }

    /// Frames that the reference still wants: the first and the last are told.
    ///
    /// # Errors
    ///
    /// A line that cannot be written.
    pub fn waiting(&mut self, left: usize) -> Result<(), PublishError> {
        let was_waiting = std::mem::replace(&mut self.is_waiting, left > 0);
        let (event, text) = match (was_waiting, left) {
            (_, 0) => ("reference_taken", "the reference is taken: touches follow"),
            (false, _) => ("reference_started", "touch nothing while the reference is taken"),
            (true, _) => return Ok(()),
        };
        let frames = (left > 0).then_some(left as u64);
        self.say(&EventLine {
            event,
            text,
            frames,
            host_time_s: self.now_s(),
            ..Default::default()
        })
    }

    /// An event of the instrument; nothing for a frame.
    ///
    /// # Errors
    ///
    /// A line that cannot be written.
    pub fn event(&mut self, event: &Event) -> Result<(), PublishError> {
        let Some(words) = event_words(event) else { return Ok(()) };
        let mut line = EventLine { text: &words, host_time_s: self.now_s(), ..Default::default() };
        line.event = match *event {
            Event::Gap { frames } => {
                line.frames = Some(frames);
                "gap"
            }
            Event::Silent { for_s } => {
                line.for_s = Some(for_s);
                "silent"
            }
            Event::Disconnected { .. } => "disconnected",
            Event::Reconnected { epoch } => {
                line.epoch = Some(epoch);
                // a reference that was begun before is of no use
                self.is_waiting = false;
                "reconnected"
            }
            _ => "notice",
        };
        self.say(&line)
    }

    /// The touches of a frame.
    ///
    /// # Errors
    ///
    /// A line that cannot be written.
    pub fn touches(&mut self, frame: &TouchFrame<'_>) -> Result<(), PublishError> {
        self.frames += 1;
        self.encode(&FrameLine::from(frame))?;
        #[cfg(feature = "web")]
        if let Some(web) = &mut self.web {
            web.frame(&self.line);
        }
        self.write()
    }

    /// The last line.
    ///
    /// # Errors
    ///
    /// A line that cannot be written.
    pub fn end(&mut self) -> Result<(), PublishError> {
        self.say(&EventLine {
            event: "ended",
            text: "no frame follows",
            frames: Some(self.frames),
            host_time_s: self.now_s(),
            ..Default::default()
        })
    }

    /// Whether the reader of the lines has gone away: a closed pipe is no error, and ends a program that
    /// writes for it.
    pub fn is_closed(&self) -> bool {
        self.is_closed
    }

    /// Where datagrams go, and how many went.
    pub fn udp(&self) -> &[UdpSink] {
        &self.udp
    }

    /// Tells everybody what is no frame.
    fn say(&mut self, line: &impl Serialize) -> Result<(), PublishError> {
        self.encode(line)?;
        #[cfg(feature = "web")]
        if let Some(web) = &self.web {
            web.tell(&self.line);
        }
        self.write()
    }

    /// A line may end on a terminal, and names and words of others are in it: what moves a cursor or turns text
    /// around is escaped, beyond what JSON asks for.
    fn encode(&mut self, line: &impl Serialize) -> Result<(), PublishError> {
        self.line.clear();
        serde_json::to_writer(&mut self.line, line)?;
        if let Ok(Cow::Owned(escaped)) = std::str::from_utf8(&self.line).map(printable_json) {
            self.line = escaped.into_bytes();
        }
        Ok(())
    }

    /// Gives the line at hand to pipes and sockets.
    fn write(&mut self) -> Result<(), PublishError> {
        for sink in &mut self.udp {
            sink.send(&self.line);
        }
        let Some(out) = self.out.as_mut().filter(|_| !self.is_closed) else { return Ok(()) };
        self.line.push(b'\n');
        match out.write_all(&self.line).and_then(|()| out.flush()) {
            Err(error) if error.kind() == ErrorKind::BrokenPipe => {
                self.is_closed = true;
                Ok(())
            }
            written => Ok(written?),
        }
    }

    /// This computer's clock, for live frames.
    fn now_s(&self) -> Option<f64> {
        let since = || SystemTime::now().duration_since(UNIX_EPOCH).ok();
        self.is_live.then(since)?.map(|since| since.as_secs_f64())
    }
}
