//! `eit record`: records a live instrument to a crash-safe file.

use super::check_frames;
use super::electrode_watch::ElectrodeWatch;
use super::frame_rate::FrameRate;
use super::silence::{NoData, Silence};
use crate::cli::{RecordArgs, SplitArgs};
use crate::commands::prelude::*;
use eit_hw::capture::{self, CaptureReader, CaptureSettings, CaptureWriter, Entry, SessionRecord};
use eit_hw::driver::{Event, Session};
use eit_skin::Steps;
use eit_skin::connect::{self, Backlog};
use eit_skin::text::event_text;

/// Records until enough frames arrived, the time is over, or Ctrl-C.
pub(super) fn run(args: &RecordArgs) -> Result<Ended, CliError> {
    let mut until = Until::new(args.seconds)?;
    let settings = CaptureSettings { sync: args.sync, ..args.split.settings()? };
    check_frames(args.frames)?;
    let path = &args.out;
    check_ending(path, &["mcap"])?;
    if !args.append {
        capture::check_new(path)
            .map_err(|error| CliError::input(format!("{error} with --append")))?;
    }
    let files = capture::files(path);
    let scene = Scene::load(&args.scene)?;
    let instrument = scene.instrument()?;
    let mut progress = progress::terminal();
    let session = progress
        .stage("connect", || connect::open(&instrument, args.port.as_deref(), Backlog::Recorded))?;
    let record = connect::session_record(&scene.to_toml()?, &instrument, &session);
    let bytes_before = bytes(&files);
    let is_continued = args.append && files.iter().any(|file| file.exists());
    let mut writer = open(path, &record, settings, is_continued)?;
    let cut = writer.cut_tail().cloned();
    if let Some(cut) = &cut {
        let (path, bytes, kept) = (path.display(), cut.bytes, cut.path.display());
        progress.note(&format!(
            "{path}: {bytes} bytes at the end were an incomplete record and are kept in {kept}"
        ));
    }
    args.note.iter().try_for_each(|note| writer.note(note))?;
    let mut recorder = Recorder {
        args,
        session,
        frames: 0,
        notes: 0,
        rate: FrameRate::default(),
        silence: Silence::new(),
        electrodes: ElectrodeWatch::new(&instrument),
    };
    until.restart();
    let ended = progress
        .steps("recording; Ctrl-C stops it", 0, |bar| recorder.record(&mut writer, bar, &until));
    recorder.session.stop();
    let interrupted = until.stop.is_set();
    // with the events that arrived before the end
    let ended = ended.and_then(|()| {
        while recorder.wants_more()
            && recorder.next(&mut writer, Duration::ZERO, &mut |words| progress.note(words))?
        {
        }
        Ok(writer.finish()?)
    });
    ended.map_err(|error| stopped(&error, path, recorder.frames))?;
    let mut answer = recorder.answer(bytes_before, interrupted);
    answer.json["cut_tail"] =
        json!(cut.map(|cut| json!({ "bytes": cut.bytes, "file": cut.path.display().to_string() })));
    let exit = if recorder.silence.is_silent() { Exit::Silent } else { Exit::Done };
    Ok(Ended { answer, exit })
}

/// Opens the recording as was decided before: never appends to a file that another recorder creates meanwhile.
pub(super) fn open(
    path: &Path,
    record: &SessionRecord,
    settings: CaptureSettings,
    is_continued: bool,
) -> Result<CaptureWriter, CliError> {
    match is_continued {
        true => Ok(CaptureWriter::append(path, record, settings)?),
        // a place that cannot be written to is invalid input, unlike a full disk
        false => CaptureWriter::create(path, record, settings)
            .map_err(|error| CliError::input(error.to_string())),
    }
}

impl SplitArgs {
    /// Returns the settings of a recording that is split like this.
    pub(super) fn settings(self) -> Result<CaptureSettings, CliError> {
        let Self { split_mb, split_s } = self;
        if let Some(mb) = split_mb {
            check_option("--split-mb", mb, (0.1..=1e9).contains(&mb), "0.1 to 1e9")?;
        }
        if let Some(seconds) = split_s {
            check_option("--split-s", seconds, (1.0..=1e9).contains(&seconds), "1 to 1e9")?;
        }
        let part_bytes = split_mb.map(|mb| (1e6 * mb) as u64);
        Ok(CaptureSettings { part_bytes, part_s: split_s, ..CaptureSettings::default() })
    }
}

/// An instrument, and what was recorded of it so far.
struct Recorder<'a> {
    args: &'a RecordArgs,
    session: Session,
    frames: u64,
    notes: u64,
    rate: FrameRate,
    silence: Silence,
    electrodes: ElectrodeWatch,
}

impl Recorder<'_> {
    fn wants_more(&self) -> bool {
        self.frames < self.args.frames.unwrap_or(u64::MAX)
    }

    /// Records until the end, and shows how it goes.
    fn record(
        &mut self,
        writer: &mut CaptureWriter,
        bar: &Steps<'_>,
        until: &Until,
    ) -> Result<(), CliError> {
        while self.wants_more() && !until.is_over() && !self.session.is_over() {
            self.next(writer, SHUTDOWN_WAIT, &mut |words| bar.note(words))?;
            if let Some(silence) = self.silence.shown() {
                let silent_s = silence.as_secs_f64();
                bar.set_message(&format!("NO FRAME for {silent_s:.0} s; Ctrl-C stops it"));
            } else if self.frames.is_multiple_of(16) {
                bar.set_message(&self.progress());
            }
        }
        Ok(())
    }

    /// Status shown during a recording.
    fn progress(&self) -> String {
        let (lost, stated_hz) =
            (self.session.statistics().lost, self.session.setup().frame_rate_hz);
        let rate = match (self.rate.recent_hz(), stated_hz) {
            (Some(hz), Some(stated_hz)) if self.rate.is_slow() => {
                format!(", ONLY {hz:.1} of {stated_hz} per second")
            }
            (Some(hz), _) => format!(", {hz:.1} per second"),
            _ => String::new(),
        };
        format!("{} frames{rate}, {lost} lost; Ctrl-C stops it", self.frames)
    }

    /// Waits for an event and records it; returns false if there was none.
    fn next(
        &mut self,
        writer: &mut CaptureWriter,
        wait: Duration,
        warn: &mut dyn FnMut(&str),
    ) -> Result<bool, CliError> {
        let Some(event) = self.session.next_event(wait)? else {
            writer.tick()?;
            return Ok(false);
        };
        self.silence.follow(&event);
        match &event {
            Event::Reconnected { .. } => self.electrodes.restart(),
            Event::Silent { .. } | Event::Disconnected { .. } => self.rate.interrupt(),
            _ => {}
        }
        if is_news(&event) {
            event_text(&event).iter().for_each(|words| warn(words));
        }
        let Event::Frame(frame) = event else {
            event_text(&event).map_or(Ok(()), |words| writer.note(&words))?;
            self.notes += 1;
            return Ok(true);
        };
        writer.frame(&frame)?;
        self.frames += 1;
        self.rate.frame(Instant::now());
        if let Some(words) = self.rate.change(self.session.setup().frame_rate_hz) {
            writer.note(&words)?;
            self.notes += 1;
        }
        let notes = &mut self.notes;
        self.electrodes.push(&frame, |words| {
            warn(words);
            *notes += 1;
            writer.note(words)
        })?;
        self.session.recycle(frame);
        Ok(true)
    }

    fn answer(&self, bytes_before: u64, interrupted: bool) -> Answer {
        let Self { session, frames, notes, rate, electrodes, .. } = self;
        let (setup, statistics) = (session.setup(), session.statistics());
        let files = capture::files(&self.args.out);
        let bytes = bytes(&files);
        let new_kb = 1e-3 * bytes.saturating_sub(bytes_before) as f64;
        let (without_s, is_silent) =
            ([statistics.silent_s, statistics.disconnected_s], self.silence.is_silent());
        let no_data = NoData::new(without_s, setup.frame_rate_hz, rate.mean_hz(), is_silent);
        let parts = match files.len() {
            1 => String::new(),
            count => format!(" ({count} parts)"),
        };
        let path = self.args.out.display();
        let text = format!(
            "{frames} frames of {} in {path}{parts}{}, {:.1} kB per frame; {} lost, {} with flagged values, {} \
             damaged bytes, {} reconnections{}{}",
            setup.identity,
            rate.description(),
            new_kb / (*frames).max(1) as f64,
            statistics.lost,
            statistics.flagged,
            statistics.damaged_bytes,
            statistics.reconnections,
            no_data.description(),
            electrodes.lines()
        );
        let json = json!({
            "file": path.to_string(),
            "files": files.iter().map(|file| file.display().to_string()).collect::<Vec<_>>(),
            "bytes": bytes,
            "instrument": setup.identity.to_string(),
            "frames": frames,
            "notes": notes,
            "frame_rate_hz": rate.mean_hz(),
            "longest_wait_s": rate.longest_wait_s(),
            "lost": statistics.lost,
            "flagged": statistics.flagged,
            "damaged_bytes": statistics.damaged_bytes,
            "reconnections": statistics.reconnections,
            "interrupted": interrupted,
            "faulty_electrodes": electrodes.json(),
        });
        Answer { text, json: joined(json, no_data) }
    }
}

/// Whether to tell the user at once.
pub(super) fn is_news(event: &Event) -> bool {
    matches!(event, Event::Silent { .. } | Event::Disconnected { .. } | Event::Reconnected { .. })
}

/// Describes what went wrong, and what the recording contains.
fn stopped(error: &CliError, path: &Path, frames: u64) -> CliError {
    let left = match CaptureReader::open(path) {
        Ok(mut reader) => {
            let entries = std::iter::from_fn(|| reader.next_entry().ok().flatten());
            let whole = entries.filter(|entry| matches!(entry, Entry::Frame(_))).count();
            format!("{} contains {whole} frames; {frames} arrived in this run", path.display())
        }
        Err(_) => format!("{} is not readable", path.display()),
    };
    CliError::failure(format!("the recording has stopped: {error}; {left}"))
}

/// Total length of the files of a recording.
fn bytes(files: &[PathBuf]) -> u64 {
    files.iter().map(|file| file.metadata().map_or(0, |data| data.len())).sum()
}
