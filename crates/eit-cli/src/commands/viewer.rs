//! What `eit live` and `eit replay` show and store.

use super::publish;
use super::record::{self, is_news};
use super::recorder::PageRecorder;
use super::view::{Picture, Terminal};
use crate::cli::WatchArgs;
use crate::error::CliError;
use crate::interrupt;
use eit_hw::capture::CaptureWriter;
use eit_hw::driver::Event;
use eit_publish::{Publisher, Start};
use eit_report::watched::{Kept, record_of};
use eit_skin::StopFlag;
use eit_skin::live::{LiveModel, LiveObserver, Summary, TouchFrame};
use eit_skin::words::event_words;
use std::time::{Duration, Instant};

/// Shows, records and stores frames.
pub(super) struct Viewer<'a> {
    model: &'a LiveModel,
    frames: u64,
    start: Instant,
    limit: Option<Duration>,
    interrupt: StopFlag,
    /// Time since when no frame has arrived, once reported; also set before the first frame.
    silent_since: Option<Instant>,
    /// Whether the session has reported that nothing arrives.
    is_told_silent: bool,
    terminal: Terminal,
    picture: Option<Picture>,
    writer: Option<CaptureWriter>,
    kept: Option<Kept>,
    publisher: Option<Publisher>,
    /// Recordings that the page starts.
    recorder: Option<PageRecorder>,
}

impl<'a> Viewer<'a> {
    /// Reserves the output files.
    pub fn new(
        model: &'a LiveModel,
        args: &WatchArgs,
        limit: Option<Duration>,
        is_shown: bool,
    ) -> Result<Self, CliError> {
        let kept = args.out.as_deref().map(Kept::new).transpose()?;
        Ok(Self {
            model,
            frames: args.frames.unwrap_or(u64::MAX),
            start: Instant::now(),
            limit,
            interrupt: interrupt::listen()?,
            silent_since: Some(Instant::now()),
            is_told_silent: false,
            // stdout is reserved for lines, and the view would overwrite the printed addresses
            terminal: Terminal::new(
                is_shown
                    && !args.publish.json_lines
                    && args.publish.page.web.is_none()
                    && args.publish.network.foxglove.is_none(),
            ),
            picture: args.picture.as_deref().map(Picture::new).transpose()?,
            writer: None,
            kept,
            publisher: None,
            recorder: None,
        })
    }

    /// Starts recording.
    pub fn record(&mut self, writer: CaptureWriter) {
        self.writer = Some(writer);
    }

    /// Allows the page to record.
    pub fn let_record(&mut self, recorder: PageRecorder) -> Result<(), CliError> {
        if let Some(publisher) = &self.publisher {
            recorder.tell(publisher)?;
        }
        self.recorder = Some(recorder);
        Ok(())
    }

    /// Starts publishing the touches of this instrument or recording.
    pub fn publish(
        &mut self,
        publisher: Option<Publisher>,
        instrument: &str,
        is_live: bool,
    ) -> Result<(), CliError> {
        self.publisher = publisher;
        let Some(publisher) = &mut self.publisher else { return Ok(()) };
        if publisher.takes_images() {
            publisher.skin(&publish::shape(self.model)?)?;
        }
        let skin = self.model.skin();
        Ok(publisher.start(&Start {
            skin: &skin.name,
            instrument,
            electrodes: skin.mesh.electrodes().len(),
            reference_frames: self.model.reference_frames,
            is_live,
        })?)
    }

    /// Returns whether the instrument is silent or unplugged.
    pub fn is_silent(&self) -> bool {
        record::is_silent(self.silent_since, self.is_told_silent, Instant::now())
    }

    /// Returns whether images are needed by anything but the publisher; without any other output,
    /// the summary reports on them.
    fn is_seen(&self) -> bool {
        let is_kept = self.picture.is_some() || self.kept.is_some();
        self.terminal.is_on() || is_kept || self.publisher.is_none()
    }

    /// Finishes the recording and writes what was stored; returns the names of the files, and the notes that were printed.
    pub fn finish(self) -> Result<(Vec<&'static str>, Vec<String>), CliError> {
        let told = self.terminal.told().to_vec();
        if let (Some(mut recorder), Some(publisher)) = (self.recorder, &self.publisher) {
            recorder.stop(publisher)?;
        }
        if let Some(publisher) = self.publisher {
            publish::end(publisher)?;
        }
        if let Some(writer) = self.writer {
            writer.finish()?;
        }
        Ok((self.kept.map_or(Ok(Vec::new()), Kept::finish)?, told))
    }
}

impl LiveObserver for Viewer<'_> {
    type Error = CliError;

    fn event(&mut self, event: &Event) -> Result<(), CliError> {
        if let Some(publisher) = &mut self.publisher {
            publisher.event(event)?;
        }
        match event {
            Event::Frame(_) => (self.silent_since, self.is_told_silent) = (None, false),
            Event::Gap { frames } | Event::Skipped { frames } => self.terminal.lose(*frames),
            Event::Silent { .. } | Event::Disconnected { .. } => {
                self.silent_since.get_or_insert_with(Instant::now);
                self.is_told_silent = true;
            }
            _ => {}
        }
        if is_news(event)
            && let Some(words) = event_words(event)
        {
            self.terminal.news(&words);
        }
        if let (Some(recorder), Some(publisher)) = (&mut self.recorder, &self.publisher) {
            recorder.event(event, publisher)?;
        }
        match &mut self.writer {
            Some(writer) => Ok(record::write_event(writer, event)?),
            None => Ok(()),
        }
    }

    fn idle(&mut self) -> Result<(), CliError> {
        if let Some(since) = self.silent_since {
            self.terminal.silent(since.elapsed());
        }
        if let (Some(recorder), Some(publisher)) = (&mut self.recorder, &self.publisher) {
            recorder.idle(publisher)?;
        }
        match &mut self.writer {
            Some(writer) => Ok(writer.tick()?),
            None => Ok(()),
        }
    }

    fn waiting(&mut self, left: usize) -> Result<(), CliError> {
        self.terminal.waiting(left);
        match &mut self.publisher {
            Some(publisher) => Ok(publisher.waiting(left)?),
            None => Ok(()),
        }
    }

    fn reference(&mut self, notes: &[String]) -> Result<(), CliError> {
        for note in notes {
            self.terminal.news(note);
            if let Some(publisher) = &mut self.publisher {
                publisher.notice(note)?;
            }
        }
        Ok(())
    }

    fn touches(&mut self, shown: &TouchFrame<'_>) -> Result<(), CliError> {
        if let Some(publisher) = &mut self.publisher {
            publisher.touches(shown)?;
            if let Some(recorder) = &mut self.recorder {
                recorder.touches(shown, publisher)?;
            }
        }
        if let Some(writer) = &mut self.writer
            && !shown.touches.is_empty()
        {
            writer.touches(&record_of(shown))?;
        }
        Ok(())
    }

    fn frame(&mut self, shown: &TouchFrame<'_>) -> Result<(), CliError> {
        self.terminal.show(shown)?;
        if let Some(publisher) = &mut self.publisher {
            publish::image(publisher, shown)?;
        }
        if let Some(picture) = &mut self.picture {
            picture.show(self.model, shown)?;
        }
        if let Some(kept) = &mut self.kept {
            kept.take(shown)?;
        }
        Ok(())
    }

    fn wants_images(&self) -> bool {
        self.is_seen() || self.publisher.as_ref().is_some_and(Publisher::takes_images)
    }

    fn wants_image(&self) -> bool {
        self.is_seen() || self.publisher.as_ref().is_some_and(Publisher::has_viewer)
    }

    /// Returns true if images are stored, because every frame is then needed.
    fn wants_every_image(&self) -> bool {
        self.kept.is_some()
    }

    fn goes_on(&mut self, summary: &Summary) -> bool {
        summary.frames < self.frames
            && !self.interrupt.is_set()
            && !self.publisher.as_ref().is_some_and(Publisher::is_closed)
            && self.limit.is_none_or(|limit| self.start.elapsed() < limit)
    }
}
