//! What `eit live` and `eit replay` show and keep.

use super::view::{Picture, Terminal};
use crate::cli::WatchArgs;
use crate::error::CliError;
use crate::interrupt;
use eit_hw::capture::CaptureWriter;
use eit_hw::driver::Event;
use eit_report::watched::{Kept, record_of};
use eit_skin::StopFlag;
use eit_skin::live::{LiveFrame, LiveModel, LiveObserver, Summary};
use eit_skin::words::event_words;
use std::time::{Duration, Instant};

/// Shows, records and keeps.
pub(super) struct Viewer<'a> {
    model: &'a LiveModel,
    frames: u64,
    start: Instant,
    limit: Option<Duration>,
    interrupt: StopFlag,
    terminal: Terminal,
    picture: Option<Picture>,
    writer: Option<CaptureWriter>,
    kept: Option<Kept>,
}

impl<'a> Viewer<'a> {
    /// Reserves what will be written.
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
            terminal: Terminal::new(is_shown),
            picture: args.picture.as_deref().map(Picture::new).transpose()?,
            writer: None,
            kept,
        })
    }

    /// Records what comes from now on.
    pub fn record(&mut self, writer: CaptureWriter) {
        self.writer = Some(writer);
    }

    /// Ends recording and writes what was kept; the names of the files.
    pub fn finish(self) -> Result<Vec<&'static str>, CliError> {
        if let Some(writer) = self.writer {
            writer.finish()?;
        }
        Ok(self.kept.map_or(Ok(Vec::new()), Kept::finish)?)
    }
}

impl LiveObserver for Viewer<'_> {
    type Error = CliError;

    fn event(&mut self, event: &Event) -> Result<(), CliError> {
        let Some(writer) = &mut self.writer else { return Ok(()) };
        match (event, event_words(event)) {
            (Event::Frame(frame), _) => writer.frame(frame)?,
            (_, Some(words)) => writer.note(&words)?,
            _ => {}
        }
        Ok(())
    }

    fn idle(&mut self) -> Result<(), CliError> {
        match &mut self.writer {
            Some(writer) => Ok(writer.tick()?),
            None => Ok(()),
        }
    }

    fn waiting(&mut self, left: usize) -> Result<(), CliError> {
        self.terminal.waiting(left);
        Ok(())
    }

    fn frame(&mut self, shown: &LiveFrame<'_>) -> Result<(), CliError> {
        self.terminal.show(shown)?;
        if let Some(picture) = &mut self.picture {
            picture.show(self.model, shown)?;
        }
        if let Some(writer) = &mut self.writer
            && !shown.touches.is_empty()
        {
            writer.touches(&record_of(shown))?;
        }
        if let Some(kept) = &mut self.kept {
            kept.take(shown)?;
        }
        Ok(())
    }

    fn goes_on(&mut self, summary: &Summary) -> bool {
        summary.frames < self.frames
            && !self.interrupt.is_set()
            && self.limit.is_none_or(|limit| self.start.elapsed() < limit)
    }
}
