//! Splitting of a recording into parts while it is written.

use std::path::{Path, PathBuf};
use std::thread::{Builder, JoinHandle};
use std::time::Instant;

use super::storage::Folder;
use super::{CaptureSettings, CaptureWriter, storage};
use crate::capture::parts::Part;
use crate::capture::record::SessionRecord;
use crate::error::HwError;

/// The parts of a recording that is being written.
pub(super) struct Parts {
    /// Name of the whole recording.
    recording: PathBuf,
    folder: Box<dyn Folder>,
    /// Number of the current part.
    number: u32,
    /// When the current part began, or creating the next one failed, and its length then.
    since: Instant,
    from_bytes: u64,
    /// Session of the frames.
    session: SessionRecord,
    /// Threads that write the indices of previous parts and force them to the disk, which may take
    /// longer than the session's queue of frames lasts.
    ending: Vec<JoinHandle<Result<(), HwError>>>,
}

impl Parts {
    pub(super) fn new(
        recording: &Path,
        folder: Box<dyn Folder>,
        number: u32,
        session: &SessionRecord,
    ) -> Self {
        Self {
            recording: recording.to_path_buf(),
            folder,
            number,
            since: Instant::now(),
            from_bytes: 0,
            session: session.clone(),
            ending: Vec::new(),
        }
    }

    pub(super) fn set_session(&mut self, session: &SessionRecord) {
        self.session = session.clone();
    }

    fn is_due(&self, settings: CaptureSettings, bytes: u64) -> bool {
        let bytes = bytes.saturating_sub(self.from_bytes);
        settings.part_bytes.is_some_and(|most| bytes >= most)
            || settings.part_s.is_some_and(|most| self.since.elapsed().as_secs_f64() >= most)
    }

    /// Waits for the ends of previous parts, or takes only those that are there; returns the first
    /// failure.
    pub(super) fn ended(&mut self, wait: bool) -> Result<(), HwError> {
        let mut first = Ok(());
        for thread in std::mem::take(&mut self.ending) {
            if !wait && !thread.is_finished() {
                self.ending.push(thread);
            } else if let Ok(ended) = thread.join() {
                first = first.and(ended);
            }
        }
        first
    }
}

impl CaptureWriter {
    /// Begins the next part if the current one is long enough. If that fails, for example because
    /// the folder was renamed, the recording goes on in the current part, with a note.
    pub(super) fn split_if_due(&mut self) -> Result<(), HwError> {
        let Some(parts) = &mut self.parts else { return Ok(()) };
        if !parts.is_due(self.settings, self.whole_bytes) {
            return Ok(());
        }
        parts.ended(false)?;
        let (number, session) = (parts.number.saturating_add(1), parts.session.clone());
        let Part { path, .. } = Part::of(&parts.recording, number);
        self.flush()?;
        let Some(parts) = &mut self.parts else { return Ok(()) };
        let file = match storage::create(&mut *parts.folder, &path, self.settings.sync) {
            Ok(file) => file,
            Err(error) => {
                (parts.since, parts.from_bytes) = (Instant::now(), self.whole_bytes);
                return self.note(&format!("the recording goes on in this file: {error}"));
            }
        };
        let begun = Self::on(file, &path, self.settings, 0).and_then(|mut next| {
            (next.counts, next.log_time_ns) = (self.counts, self.log_time_ns);
            next.session(&SessionRecord { continues: true, ..session })?;
            next.flush()?;
            Ok(next)
        });
        let mut next = begun.inspect_err(|_| {
            // created above, without any content
            let _ = parts.folder.remove(&path);
        })?;
        next.cut = self.cut.take();
        next.json = std::mem::take(&mut self.json);
        let mut parts = self.parts.take();
        if let Some(parts) = &mut parts {
            (parts.number, parts.since, parts.from_bytes) = (number, Instant::now(), 0);
        }
        next.parts = parts;
        let ended = std::mem::replace(self, next);
        // without a thread it is dropped, which finishes it without forcing it to the disk
        if let Ok(thread) = Builder::new().name("recording".into()).spawn(move || ended.finish())
            && let Some(parts) = &mut self.parts
        {
            parts.ending.push(thread);
        }
        Ok(())
    }
}
