//! `eit record`: records a live instrument to a crash-safe file.

use super::electrode_watch::ElectrodeWatch;
use super::frame_rate::FrameRate;
use super::no_data::NoData;
use super::{Answer, Ended, SILENT};
use crate::cli::{RecordArgs, SplitArgs};
use crate::error::CliError;
use crate::interrupt;
use crate::progress;
use eit_hw::capture::{self, CaptureSettings, CaptureWriter};
use eit_hw::driver::{Event, Session};
use eit_skin::connect::{self, Backlog};
use eit_skin::scene::Scene;
use eit_skin::words::event_words;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// How often to check for shutdown.
const WAIT: Duration = Duration::from_millis(50);
/// Silence at the start after which it is shown; later silences are reported by the session.
const TOLD_SILENCE: Duration = Duration::from_millis(500);

/// Records until enough frames arrived, the time is over, or Ctrl-C.
pub(crate) fn run(args: &RecordArgs) -> Result<Ended, CliError> {
    let limit = duration(args.seconds)?;
    let settings = CaptureSettings { sync: args.sync, ..args.split.settings()? };
    super::check_frames(args.frames)?;
    let place = &args.out;
    super::check_ending(place, &["mcap"])?;
    if !args.append {
        capture::check_new(place)
            .map_err(|error| CliError::input(format!("{error} with --append")))?;
    }
    let files = capture::files(place);
    let scene = Scene::load(&args.scene)?;
    let instrument = scene.instrument()?;
    let interrupt = interrupt::listen()?;
    let mut progress = progress::terminal();
    let mut session = progress
        .stage("connect", || connect::open(&instrument, args.port.as_deref(), Backlog::Recorded))?;
    let record = connect::session_record(&scene.to_toml()?, &instrument, &session);
    let bytes_before = bytes(&files);
    // decide once: never append to a file that another recorder creates meanwhile
    let mut writer = match args.append && files.iter().any(|file| file.exists()) {
        true => CaptureWriter::append(place, &record, settings)?,
        false => CaptureWriter::create(place, &record, settings).map_err(unwritable)?,
    };
    if let Some(cut) = writer.cut_tail() {
        progress.note(&format!(
            "{}: {} bytes at the end were an incomplete record and are kept in {}",
            place.display(),
            cut.bytes,
            cut.path.display()
        ));
    }
    if let Some(note) = &args.note {
        writer.note(note)?;
    }
    let cut = writer.cut_tail().cloned();
    let electrodes = ElectrodeWatch::new(&instrument);
    let mut taken = Taken {
        frames: 0,
        notes: 0,
        rate: FrameRate::default(),
        silent_since: Some(Instant::now()),
        is_told: false,
        electrodes,
    };
    let ended = progress.steps("recording; Ctrl-C stops it", 0, |bar| {
        let start = Instant::now();
        while taken.frames < args.frames.unwrap_or(u64::MAX)
            && limit.is_none_or(|limit| start.elapsed() < limit)
            && !interrupt.is_set()
        {
            if session.is_over() {
                break;
            }
            taken.next(&session, &mut writer, WAIT, &mut |words| bar.note(words))?;
            if let Some(since) = taken.silent_since.filter(|since| since.elapsed() > TOLD_SILENCE) {
                let silent_s = since.elapsed().as_secs_f64();
                bar.set_message(&format!("NO FRAME for {silent_s:.0} s; Ctrl-C stops it"));
            } else if taken.frames.is_multiple_of(16) {
                let stated_hz = session.setup().frame_rate_hz;
                bar.set_message(&taken.progress(session.statistics().lost, stated_hz));
            }
        }
        Ok(interrupt.is_set())
    });
    session.stop();
    let interrupted = ended.map_err(|error| stopped(error, place, taken.frames))?;
    // events that arrived before the end
    while taken.frames < args.frames.unwrap_or(u64::MAX)
        && taken
            .next(&session, &mut writer, Duration::ZERO, &mut |words| progress.note(words))
            .map_err(|error| stopped(error, place, taken.frames))?
    {}
    writer.finish().map_err(|error| stopped(error.into(), place, taken.frames))?;
    let mut answer = answer(place, bytes_before, &session, &taken, interrupted);
    answer.json["cut_tail"] =
        json!(cut.map(|cut| json!({ "bytes": cut.bytes, "file": cut.path.display().to_string() })));
    let exit_code = if taken.is_silent() { SILENT } else { 0 };
    Ok(Ended { answer, exit_code })
}

/// Converts the error of a folder that cannot be written to, which is invalid input, unlike a full
/// disk.
fn unwritable(error: eit_hw::HwError) -> CliError {
    CliError::input(error.to_string())
}

impl SplitArgs {
    /// Returns the settings of a recording that is split like this.
    pub(super) fn settings(self) -> Result<CaptureSettings, CliError> {
        let Self { split_mb, split_s } = self;
        if let Some(mb) = split_mb.filter(|mb| !(0.1..=1e9).contains(mb)) {
            return Err(CliError::input(format!("--split-mb {mb}: it must be 0.1 to 1e9")));
        }
        if let Some(seconds) = split_s.filter(|seconds| !(1.0..=1e9).contains(seconds)) {
            return Err(CliError::input(format!("--split-s {seconds}: it must be 1 to 1e9")));
        }
        let part_bytes = split_mb.map(|mb| (1e6 * mb) as u64);
        Ok(CaptureSettings { part_bytes, part_s: split_s, ..CaptureSettings::default() })
    }
}

/// Converts `--seconds` to a duration.
pub(super) fn duration(seconds: Option<f64>) -> Result<Option<Duration>, CliError> {
    let time = |s: f64| Duration::try_from_secs_f64(s).ok().filter(|time| !time.is_zero());
    match seconds.map(time) {
        None => Ok(None),
        Some(Some(time)) => Ok(Some(time)),
        Some(None) => {
            let message = format!("--seconds {}: it must be above 0", seconds.unwrap_or_default());
            Err(CliError::input(message))
        }
    }
}

/// Counts of the recording so far.
struct Taken {
    frames: u64,
    notes: u64,
    rate: FrameRate,
    /// Time since when no frame has arrived, once reported; also set before the first frame.
    silent_since: Option<Instant>,
    /// Whether the session has reported that nothing arrives.
    is_told: bool,
    electrodes: ElectrodeWatch,
}

impl Taken {
    fn is_silent(&self) -> bool {
        is_silent(self.silent_since, self.is_told, Instant::now())
    }

    /// Status shown during a recording.
    fn progress(&self, lost: u64, stated_hz: Option<f64>) -> String {
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
        session: &Session,
        writer: &mut CaptureWriter,
        wait: Duration,
        warn: &mut dyn FnMut(&str),
    ) -> Result<bool, CliError> {
        match session.next_event(wait)? {
            Some(Event::Frame(frame)) => {
                writer.frame(&frame)?;
                self.frames += 1;
                self.rate.frame(Instant::now());
                if let Some(words) = self.rate.change(session.setup().frame_rate_hz) {
                    writer.note(&words)?;
                    self.notes += 1;
                }
                (self.silent_since, self.is_told) = (None, false);
                let Self { electrodes, notes, .. } = self;
                electrodes.push(&frame, |words| {
                    warn(words);
                    *notes += 1;
                    writer.note(words)
                })?;
                session.recycle(frame);
            }
            Some(other) => {
                if matches!(other, Event::Reconnected { .. }) {
                    self.electrodes.restart();
                }
                if matches!(other, Event::Silent { .. } | Event::Disconnected { .. }) {
                    self.rate.interrupt();
                    self.silent_since.get_or_insert_with(Instant::now);
                    self.is_told = true;
                }
                if let Some(words) = event_words(&other) {
                    if is_news(&other) {
                        warn(&words);
                    }
                    writer.note(&words)?;
                    self.notes += 1;
                }
            }
            None => {
                writer.tick()?;
                return Ok(false);
            }
        }
        Ok(true)
    }
}

/// Records a frame, or a note about any other event.
pub(super) fn write_event(
    writer: &mut CaptureWriter,
    event: &Event,
) -> Result<(), eit_hw::HwError> {
    match (event, event_words(event)) {
        (Event::Frame(frame), _) => writer.frame(frame),
        (_, Some(words)) => writer.note(&words),
        _ => Ok(()),
    }
}

/// Whether an instrument without a frame `since` some time is silent or unplugged: the session has reported it, or
/// it had time to send its first frame.
pub(super) fn is_silent(since: Option<Instant>, is_told: bool, now: Instant) -> bool {
    since.is_some_and(|since| is_told || now.saturating_duration_since(since) > TOLD_SILENCE)
}

/// Whether to show an event to the user at once.
pub(super) fn is_news(event: &Event) -> bool {
    matches!(event, Event::Silent { .. } | Event::Disconnected { .. } | Event::Reconnected { .. })
}

/// Describes what went wrong, and what the recording contains.
fn stopped(error: CliError, place: &Path, frames: u64) -> CliError {
    let left = match eit_hw::capture::CaptureReader::open(place) {
        Ok(mut reader) => {
            let mut whole = 0_u64;
            while let Ok(Some(entry)) = reader.next_entry() {
                whole += u64::from(matches!(entry, eit_hw::capture::Entry::Frame(_)));
            }
            format!("{} contains {whole} frames; {frames} arrived in this run", place.display())
        }
        Err(_) => format!("{} is not readable", place.display()),
    };
    CliError::Failure(format!("the recording has stopped: {error}; {left}"))
}

/// Total length of the files of a recording.
fn bytes(files: &[PathBuf]) -> u64 {
    files.iter().map(|file| file.metadata().map_or(0, |data| data.len())).sum()
}

fn answer(
    place: &Path,
    bytes_before: u64,
    session: &Session,
    taken: &Taken,
    interrupted: bool,
) -> Answer {
    let statistics = session.statistics();
    let files = capture::files(place);
    let bytes = bytes(&files);
    let new_bytes = bytes.saturating_sub(bytes_before);
    let is_silent = taken.is_silent();
    let no_data = NoData::of(session.setup(), &statistics, taken.rate.mean_hz(), is_silent);
    let parts = match files.len() {
        1 => String::new(),
        count => format!(" ({count} parts)"),
    };
    let text = format!(
        "{} frames of {} in {}{parts}{}, {:.1} kB per frame; {} lost, {} with flagged values, {} damaged \
         bytes, {} reconnections",
        taken.frames,
        session.setup().identity,
        place.display(),
        taken.rate.words(),
        1e-3 * new_bytes as f64 / taken.frames.max(1) as f64,
        statistics.lost,
        statistics.flagged,
        statistics.damaged_bytes,
        statistics.reconnections
    ) + &no_data.words()
        + &taken.electrodes.lines();
    let mut json: Value = json!({
        "file": place.display().to_string(),
        "files": files.iter().map(|file| file.display().to_string()).collect::<Vec<_>>(),
        "bytes": bytes,
        "instrument": session.setup().identity.to_string(),
        "frames": taken.frames,
        "notes": taken.notes,
        "frame_rate_hz": taken.rate.mean_hz(),
        "longest_wait_s": taken.rate.longest_wait_s(),
        "lost": statistics.lost,
        "flagged": statistics.flagged,
        "damaged_bytes": statistics.damaged_bytes,
        "reconnections": statistics.reconnections,
        "interrupted": interrupted,
        "faulty_electrodes": taken.electrodes.json(),
    });
    no_data.add_to(&mut json);
    Answer { text, json }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ended right after its start, an instrument is not told to be without power.
    #[test]
    fn the_first_half_second_is_no_silence() {
        let (start, after) = (Instant::now(), |s| Instant::now() + Duration::from_secs_f64(s));
        assert!(!is_silent(None, false, after(9.0)) && !is_silent(None, true, after(9.0)));
        assert!(
            !is_silent(Some(start), false, start)
                && !is_silent(Some(start), false, start + TOLD_SILENCE)
        );
        assert!(is_silent(Some(start), false, after(0.6)) && is_silent(Some(start), true, start));
    }
}
