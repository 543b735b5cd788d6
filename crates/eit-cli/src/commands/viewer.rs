//! What `eit live` and `eit replay` show and store.

use super::record::is_news;
use super::recorder::Recordings;
use super::silence::Silence;
use super::view::{Picture, Terminal};
use super::{network, publish};
use crate::cli::WatchArgs;
use crate::commands::prelude::*;
use eit_hw::Frame;
use eit_hw::driver::{Event, Statistics};
use eit_publish::Publisher;
use eit_report::watched::{self, Kept, record_of};
use eit_skin::live::{LiveModel, LiveObserver, Summary, TouchFrame};
use eit_skin::text::event_text;

/// Shows, records and stores frames.
pub(super) struct Viewer<'a> {
    model: &'a LiveModel,
    args: &'a WatchArgs,
    until: Until,
    /// Whether each frame waits for a line of standard input.
    pub(super) waits_for_line: bool,
    pub(super) silence: Silence,
    terminal: Terminal,
    picture: Option<Picture>,
    kept: Option<Kept>,
    publisher: Option<Publisher>,
    /// Whether another publisher of the same topics was told.
    has_told_rival: bool,
    recordings: Option<Recordings>,
}

impl<'a> Viewer<'a> {
    /// Reserves the output files.
    pub(super) fn new(
        model: &'a LiveModel,
        args: &'a WatchArgs,
        mut until: Until,
    ) -> Result<Self, CliError> {
        until.restart();
        let published = &args.publish;
        // stdout is reserved for JSON, and the view would overwrite the printed addresses
        let is_shown = !terminal::flags().is_json
            && !published.json_lines
            && published.page.web.is_none()
            && published.network.foxglove.is_none();
        Ok(Self {
            model,
            args,
            until,
            waits_for_line: false,
            silence: Silence::new(),
            terminal: Terminal::new(is_shown),
            picture: args.picture.as_deref().map(Picture::new).transpose()?,
            kept: args.out.as_deref().map(Kept::new).transpose()?,
            publisher: None,
            has_told_rival: false,
            recordings: None,
        })
    }

    /// Publishes and records touches of this instrument, or publishes those of this recording, from now on.
    pub(super) fn publish(
        &mut self,
        publisher: Option<Publisher>,
        instrument: &str,
        recordings: Option<Recordings>,
        is_live: bool,
    ) -> Result<(), CliError> {
        (self.publisher, self.recordings) = (publisher, recordings);
        let Some(publisher) = &mut self.publisher else { return Ok(()) };
        publish::start(publisher, self.model, instrument, is_live)?;
        self.recordings.iter().try_for_each(|recordings| recordings.tell(publisher))
    }

    fn follow_recordings(&mut self) -> Result<(), CliError> {
        let publisher = self.publisher.as_ref();
        let told = &mut self.has_told_rival;
        if let Some(words) = publisher.and_then(|publisher| network::rival(publisher, told)) {
            self.terminal.news(&words);
        }
        self.recordings.as_mut().map_or(Ok(()), |recordings| recordings.follow(publisher))
    }

    /// Whether images are needed other than by the publisher; without any other output, the summary reports on
    /// them.
    fn shows_images(&self) -> bool {
        let is_stored = self.picture.is_some() || self.kept.is_some();
        self.terminal.is_on || is_stored || self.publisher.is_none()
    }

    /// Whether files are written, so that the run goes on without a reader of its lines.
    fn is_stored(&self) -> bool {
        let is_recorded = self.recordings.as_ref().is_some_and(Recordings::is_on);
        is_recorded || self.picture.is_some() || self.kept.is_some()
    }

    /// Writes what was stored, and summarises the run; a recording was completed before.
    pub(super) fn finish(
        mut self,
        instrument: &str,
        summary: Result<Summary, CliError>,
        statistics: &Statistics,
    ) -> Result<(Answer, Summary), CliError> {
        let recorded = self.follow_recordings();
        let Self { publisher, kept, terminal, .. } = self;
        let files = || {
            publisher.map_or(Ok(()), publish::end)?;
            recorded?;
            Ok::<_, CliError>(kept.map_or(Ok(Vec::new()), Kept::finish)?)
        };
        let files = files();
        // report first what stopped the view: a writer that failed fails again
        let summary = summary?;
        let answer = watched::answer(instrument, &summary, statistics, &files?, &terminal.printed);
        Ok((answer, summary))
    }
}

impl LiveObserver for Viewer<'_> {
    type Error = CliError;

    fn event(&mut self, event: &Event) -> Result<(), CliError> {
        if self.waits_for_line && matches!(event, Event::Frame(_)) {
            // treat a stdin that cannot be read as ended
            let _ = std::io::stdin().read_line(&mut String::new());
        }
        self.publisher.as_mut().map_or(Ok(()), |publisher| publisher.event(event))?;
        self.silence.follow(event);
        if let (Event::Reconnected { .. }, Some(recordings)) = (event, &mut self.recordings) {
            recordings.set_reference(&[], None);
        }
        if let Event::Gap { frames } | Event::Skipped { frames } = event {
            self.terminal.lost = self.terminal.lost.saturating_add(*frames);
        }
        if is_news(event) {
            event_text(event).iter().for_each(|words| self.terminal.news(words));
        }
        self.follow_recordings()
    }

    fn idle(&mut self) -> Result<(), CliError> {
        if let Some(silence) = self.silence.shown() {
            self.terminal.silent(silence);
        }
        self.follow_recordings()
    }

    fn waiting(&mut self, left: usize) -> Result<(), CliError> {
        self.terminal.waiting(left);
        Ok(self.publisher.as_mut().map_or(Ok(()), |publisher| publisher.waiting(left))?)
    }

    fn reference(
        &mut self,
        taken: &[Frame],
        notes: &[String],
        until: Option<u64>,
    ) -> Result<(), CliError> {
        self.recordings.iter_mut().for_each(|recordings| recordings.set_reference(taken, until));
        for note in notes {
            self.terminal.news(note);
            self.publisher.as_mut().map_or(Ok(()), |publisher| publisher.notice(note))?;
        }
        Ok(())
    }

    fn touches(&mut self, shown: &TouchFrame<'_>) -> Result<(), CliError> {
        if let Some(publisher) = &mut self.publisher {
            publisher.touches(shown)?;
        }
        if let Some(recordings) = self.recordings.as_ref().filter(|recordings| recordings.is_on()) {
            recordings.write(record_of(shown)?);
        }
        Ok(())
    }

    fn ended(&mut self, last: &TouchFrame<'_>) -> Result<(), CliError> {
        self.touches(last)?;
        Ok(self.kept.as_mut().map_or(Ok(()), |kept| kept.take(last))?)
    }

    fn frame(&mut self, shown: &TouchFrame<'_>) -> Result<(), CliError> {
        self.terminal.show(shown)?;
        if let Some(publisher) = &mut self.publisher {
            publish::image(publisher, shown)?;
        }
        if let Some(picture) = &mut self.picture {
            picture.show(self.model, shown)?;
        }
        Ok(self.kept.as_mut().map_or(Ok(()), |kept| kept.take(shown))?)
    }

    fn wants_images(&self) -> bool {
        self.shows_images() || self.publisher.as_ref().is_some_and(Publisher::takes_images)
    }

    fn wants_image(&self) -> bool {
        self.shows_images() || self.publisher.as_ref().is_some_and(Publisher::has_viewer)
    }

    /// Stored images are those of all frames.
    fn wants_every_image(&self) -> bool {
        self.kept.is_some()
    }

    fn goes_on(&mut self, summary: &Summary) -> bool {
        summary.frames < self.args.frames.unwrap_or(u64::MAX)
            && !self.until.is_over()
            && (self.is_stored() || !self.publisher.as_ref().is_some_and(Publisher::is_closed))
    }
}
