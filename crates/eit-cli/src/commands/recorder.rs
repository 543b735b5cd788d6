//! The recording of a live run: that of `--record`, or those that the live page starts and stops.

use crate::commands::prelude::*;
use eit_hw::capture::{CaptureSettings, CaptureWriter, Entry, SessionRecord, Tape};
use eit_hw::{Frame, HwError};
use eit_publish::{Publisher, Recording};
use eit_skin::connect::{reference_record, write_reference};
use std::time::{SystemTime, UNIX_EPOCH};

/// Records what the tape of the instrument receives. A recording of the page that fails, for example because the disk is
/// full, ends; the view goes on, and the page says why. That of `--record` ends the run.
pub(super) struct Recordings {
    tape: Tape,
    /// Folder and first part of the names of the page's files.
    folder: PathBuf,
    stem: String,
    session: SessionRecord,
    /// Frames of the current reference.
    reference: Vec<Frame>,
    /// The file that is being written.
    file: Option<PathBuf>,
    /// Whether it is that of `--record`, which the page cannot stop.
    is_fixed: bool,
}

impl Recordings {
    /// For a scene file, or a built-in scene, whose recordings go to the working directory.
    pub(super) fn new(scene: &str, session: SessionRecord, tape: Tape) -> Self {
        let path = Path::new(scene);
        let stem = path.file_stem().map_or_else(|| "skin".into(), |stem| stem.to_string_lossy());
        let folder = path.parent().map(Path::to_path_buf).unwrap_or_default();
        let stem = stem.into_owned();
        let reference = Vec::new();
        Self { tape, folder, stem, session, reference, file: None, is_fixed: false }
    }

    /// Takes the frames of a new reference, none after a lost connection, and the number of the last frame without a search.
    pub(super) fn set_reference(&mut self, taken: &[Frame], until: Option<u64>) {
        self.reference = taken.to_vec();
        if let Some(record) = reference_record(taken, until) {
            self.tape.write(|| Entry::Reference(record));
        }
    }

    /// Records to the file of `--record` until the end.
    pub(super) fn record(
        &mut self,
        path: &Path,
        settings: CaptureSettings,
    ) -> Result<(), CliError> {
        self.tape.begin(super::record::open(path, &self.session, settings, false)?);
        (self.file, self.is_fixed) = (Some(path.to_path_buf()), true);
        Ok(())
    }

    /// Whether a file is being written.
    pub(super) fn is_on(&self) -> bool {
        self.file.is_some()
    }

    /// Adds what was computed from a frame.
    pub(super) fn write(&self, entry: Entry) {
        self.tape.write(|| entry);
    }

    /// Does what the page asked for, and tells it what has become of a recording.
    pub(super) fn follow(&mut self, publisher: Option<&Publisher>) -> Result<(), CliError> {
        if let Some(ended) = self.tape.ended() {
            self.ended(ended, publisher)?;
        }
        let Some(publisher) = publisher else { return Ok(()) };
        match publisher.recording_request() {
            Some(true) if self.file.is_none() => self.start(publisher),
            Some(false) if self.file.is_some() && !self.is_fixed => {
                self.tape.end();
                Ok(())
            }
            // pages that asked twice, or for what is already so, get the state again
            Some(_) => self.tell(publisher),
            None => Ok(()),
        }
    }

    /// Tells the page what is recorded.
    pub(super) fn tell(&self, publisher: &Publisher) -> Result<(), CliError> {
        let file = self.file.as_ref().map(|file| file.display().to_string());
        Ok(publisher.recording(match &file {
            Some(file) => Recording::On { file, can_stop: !self.is_fixed },
            None => Recording::Off { file: None },
        })?)
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
                self.tape.begin(writer);
                self.file = Some(file);
                self.tell(publisher)
            }
            Err(error) => fail(&file, &error, Some(publisher)),
        }
    }

    /// A recording is complete, or has failed.
    fn ended(
        &mut self,
        ended: Result<(), HwError>,
        publisher: Option<&Publisher>,
    ) -> Result<(), CliError> {
        let Some(file) = self.file.take() else { return Ok(()) };
        if self.is_fixed {
            return Ok(ended?);
        }
        if let Err(error) = ended {
            return fail(&file, &error, publisher);
        }
        let name = file.display().to_string();
        eprintln!("eit: recorded: {name}");
        let off = Recording::Off { file: Some(&name) };
        Ok(publisher.map_or(Ok(()), |publisher| publisher.recording(off))?)
    }
}

/// Tells page and terminal that a recording has failed.
fn fail(file: &Path, error: &HwError, publisher: Option<&Publisher>) -> Result<(), CliError> {
    let error = format!("{}: {error}", file.display());
    eprintln!("eit: note: the recording of the live page has failed: {error}");
    let failed = Recording::Failed { error: &error };
    Ok(publisher.map_or(Ok(()), |publisher| publisher.recording(failed))?)
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
