//! Recordings that are started and stopped on the live page.

use crate::commands::prelude::*;
use eit_hw::capture::{CaptureSettings, CaptureWriter, SessionRecord};
use eit_hw::driver::Waiting;
use eit_hw::{Frame, HwError};
use eit_publish::{Publisher, Recording};
use eit_skin::connect::{RECORDER_FRAMES, write_reference};
use std::time::{SystemTime, UNIX_EPOCH};

/// Writes recordings beside the scene while the page wants them. A recording that fails, for example because the disk
/// is full, ends; the view goes on, and the page says why.
pub(super) struct PageRecorder {
    /// Folder and first part of the file names.
    folder: PathBuf,
    stem: String,
    session: SessionRecord,
    writer: Option<(PathBuf, CaptureWriter)>,
    /// Frames of the current reference.
    pub(super) reference: Vec<Frame>,
    /// Recording of `--record`, which the page cannot stop.
    fixed: Option<PathBuf>,
    waiting: Waiting,
    /// How many frames may wait for the view alone, and how many had been skipped when the recording began.
    before: Option<(usize, u64)>,
}

impl PageRecorder {
    /// For a scene file, or a built-in scene, whose recordings go to the working directory. `fixed` is the file of
    /// `--record`. `waiting` is that of the session: while a recording runs, frames wait for it as they do for
    /// `--record`, and are not skipped for the view.
    pub(super) fn new(
        scene: &str,
        session: SessionRecord,
        fixed: Option<PathBuf>,
        waiting: Waiting,
    ) -> Self {
        let path = Path::new(scene);
        let stem = path.file_stem().map_or_else(|| "skin".into(), |stem| stem.to_string_lossy());
        let folder = path.parent().map(Path::to_path_buf).unwrap_or_default();
        let stem = stem.into_owned();
        let (writer, reference, before) = (None, Vec::new(), None);
        Self { folder, stem, session, writer, reference, fixed, waiting, before }
    }

    /// Tells the page what is recorded.
    pub(super) fn tell(&self, publisher: &Publisher) -> Result<(), CliError> {
        let (file, can_stop) = match (&self.writer, &self.fixed) {
            (Some((file, _)), _) => (file, true),
            (None, Some(file)) => (file, false),
            (None, None) => return Ok(publisher.recording(Recording::Off { file: None })?),
        };
        Ok(publisher.recording(Recording::On { file: &file.display().to_string(), can_stop })?)
    }

    /// Does what the page asked for, and writes to the recording, if there is one.
    pub(super) fn write(
        &mut self,
        publisher: &Publisher,
        what: impl FnOnce(&mut CaptureWriter) -> Result<(), HwError>,
    ) -> Result<(), CliError> {
        match publisher.recording_request() {
            Some(true) if self.writer.is_none() && self.fixed.is_none() => self.start(publisher)?,
            Some(false) if self.writer.is_some() => self.stop(publisher)?,
            // pages that asked twice, or for what is already so, get the state again
            Some(_) => self.tell(publisher)?,
            None => {}
        }
        let Some((file, writer)) = &mut self.writer else { return Ok(()) };
        let Err(error) = what(writer) else { return Ok(()) };
        let file = std::mem::take(file);
        self.writer = None;
        self.skip_again();
        fail(&file, &error, publisher)
    }

    /// Ends the recording, if there is one.
    pub(super) fn stop(&mut self, publisher: &Publisher) -> Result<(), CliError> {
        let Some((file, mut writer)) = self.writer.take() else { return Ok(()) };
        let name = file.display().to_string();
        let noted = match self.skip_again() {
            0 => Ok(()),
            skipped => {
                let words =
                    format!("{skipped} frames are missing: this computer could not keep up");
                eprintln!("eit: note: {name}: {words}");
                writer.note(&words)
            }
        };
        if let Err(error) = noted.and_then(|()| writer.finish()) {
            return fail(&file, &error, publisher);
        }
        eprintln!("eit: recorded: {name}");
        Ok(publisher.recording(Recording::Off { file: Some(&name) })?)
    }

    /// Lets frames be skipped for the view again; returns how many were skipped while recording.
    fn skip_again(&mut self) -> u64 {
        let Some((capacity, dropped)) = self.before.take() else { return 0 };
        self.waiting.set_capacity(capacity);
        self.waiting.dropped().saturating_sub(dropped)
    }

    fn start(&mut self, publisher: &Publisher) -> Result<(), CliError> {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let file = self.folder.join(format!("{}-{}.mcap", self.stem, time_text(since.as_secs())));
        let begun = CaptureWriter::create(&file, &self.session, CaptureSettings::default());
        let begun = begun.and_then(|mut writer| {
            write_reference(&mut writer, &self.reference)?;
            writer.note("started on the live page")?;
            Ok(writer)
        });
        match begun {
            Ok(writer) => {
                let capacity = self.waiting.set_capacity(RECORDER_FRAMES);
                self.before = Some((capacity, self.waiting.dropped()));
                self.writer = Some((file, writer));
                self.tell(publisher)
            }
            Err(error) => fail(&file, &error, publisher),
        }
    }
}

/// Tells page and terminal that a recording has failed.
fn fail(file: &Path, error: &HwError, publisher: &Publisher) -> Result<(), CliError> {
    let error = format!("{}: {error}", file.display());
    eprintln!("eit: note: the recording of the live page has failed: {error}");
    Ok(publisher.recording(Recording::Failed { error: &error })?)
}

/// UTC date and time of a number of seconds since 1970, fit for a file name: 2026-11-23T130503Z.
fn time_text(seconds: u64) -> String {
    let (days, of_day) = (seconds / 86_400, seconds % 86_400);
    // years from March, so that leap days come last (H. Hinnant, "chrono-compatible low-level date algorithms")
    let from_march = days + 719_468;
    let (era, of_era) = (from_march / 146_097, from_march % 146_097);
    let year = (of_era - of_era / 1_460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year + year / 4 - year / 100);
    let month = (5 * of_year + 2) / 153;
    let day = of_year - (153 * month + 2) / 5 + 1;
    let (month, next) = if month < 10 { (month + 3, 0) } else { (month - 9, 1) };
    let year = 400 * era + year + next;
    let [hour, minute, second] = [of_day / 3_600, of_day / 60 % 60, of_day % 60];
    format!("{year:04}-{month:02}-{day:02}T{hour:02}{minute:02}{second:02}Z")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_of_leap_years_and_ends_of_years() {
        // from `date -u -d @N`
        for (seconds, wanted) in [
            (0, "1970-01-01T000000Z"),
            (951_782_399, "2000-02-28T235959Z"),
            (951_825_661, "2000-02-29T120101Z"),
            (1_709_251_199, "2024-02-29T235959Z"),
            (1_709_251_200, "2024-03-01T000000Z"),
            (1_798_761_599, "2026-12-31T235959Z"),
            (4_107_542_400, "2100-03-01T000000Z"),
        ] {
            assert_eq!(time_text(seconds), wanted);
        }
    }
}
