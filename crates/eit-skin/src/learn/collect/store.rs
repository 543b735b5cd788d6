//! Stores presses as they are made: a crash-safe recording of all frames, and the table of presses.

use super::collector::CollectedPress;
use super::watch::{good_values, mean};
use crate::error::SkinError;
use crate::learn::{Press, PressTable};
use crate::scene::read_file_of;
use eit_hw::Frame;
use eit_hw::capture::{CaptureReader, CaptureSettings, CaptureWriter, Entry, SessionRecord};
use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

/// Columns of the table.
const HEADER: &str = "x_m,y_m,z_m,force_n,first_frame,last_frame,before_first,before_last";
/// Maximum size of the table.
const MOST_BYTES: u64 = 64 << 20;

/// Presses that were stored earlier.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredPresses {
    /// Presses in the order in which they were collected.
    pub presses: Vec<CollectedPress>,
    /// Number of frames of the recording.
    pub frames: usize,
    /// What was repaired, for the user.
    pub notes: Vec<String>,
}

/// Writes frames and presses to two files. A line of the table is written only after its frames, and both are forced
/// to the disk, so that a program that is killed, or a power cut, loses at most the press being made.
pub struct PressStore {
    writer: CaptureWriter,
    table: File,
    place: PathBuf,
}

impl PressStore {
    /// Creates both files.
    ///
    /// # Errors
    /// A file that exists already or cannot be created.
    pub fn create(
        recording: &Path,
        table: &Path,
        session: &SessionRecord,
    ) -> Result<Self, SkinError> {
        let mut options = OpenOptions::new();
        let file = options.write(true).create_new(true).open(table);
        let mut file = file.map_err(|e| failed(table, &e))?;
        let writer = CaptureWriter::create(recording, session, settings());
        let writer = writer.inspect_err(|_| {
            // without its recording the empty table would be in the way of the next attempt
            let _ = std::fs::remove_file(table);
        })?;
        let written = file.write_all(format!("{HEADER}\n").as_bytes());
        written.and_then(|()| file.sync_all()).map_err(|e| failed(table, &e))?;
        Ok(Self { writer, table: file, place: table.to_path_buf() })
    }

    /// Continues both files, and returns the presses that they contain. An incomplete frame or line at the end, left
    /// by a program that was killed, is removed.
    ///
    /// # Errors
    /// A file that cannot be read or written; a recording of another instrument or protocol; a table with other
    /// columns, or of frames that the recording does not have.
    pub fn append(
        recording: &Path,
        table: &Path,
        session: &SessionRecord,
    ) -> Result<(Self, StoredPresses), SkinError> {
        let mut notes = Vec::new();
        let presses = read_table(table, &mut notes)?;
        let writer = CaptureWriter::append(recording, session, settings())?;
        if let Some(cut) = writer.cut_tail() {
            notes.push(format!(
                "{}: {} bytes at the end were an incomplete record and are kept in {}",
                recording.display(),
                cut.bytes,
                cut.path.display()
            ));
        }
        let (presses, frames) = read_presses(recording, table, presses)?;
        let file = OpenOptions::new().append(true).open(table).map_err(|e| failed(table, &e))?;
        let store = Self { writer, table: file, place: table.to_path_buf() };
        Ok((store, StoredPresses { presses, frames, notes }))
    }

    /// Writes a frame.
    ///
    /// # Errors
    /// A file that cannot be written, as on a full disk.
    pub fn frame(&mut self, frame: &Frame) -> Result<(), SkinError> {
        Ok(self.writer.frame(frame)?)
    }

    /// Writes a note, for example that the instrument was lost.
    ///
    /// # Errors
    /// Those of [`PressStore::frame`].
    pub fn note(&mut self, text: &str) -> Result<(), SkinError> {
        Ok(self.writer.note(text)?)
    }

    /// Writes data that has been buffered for long; call it when no frame arrives.
    ///
    /// # Errors
    /// Those of [`PressStore::frame`].
    pub fn tick(&mut self) -> Result<(), SkinError> {
        Ok(self.writer.tick()?)
    }

    /// Writes a press, after its frames.
    ///
    /// # Errors
    /// Those of [`PressStore::frame`].
    pub fn press(&mut self, press: &Press) -> Result<(), SkinError> {
        self.writer.flush()?;
        let number = |value: Option<f64>| value.map_or_else(String::new, |v| v.to_string());
        let frame = |value: Option<usize>| value.map_or_else(String::new, |v| v.to_string());
        let line = [
            press.x_m.to_string(),
            press.y_m.to_string(),
            number(press.z_m),
            number(press.force_n),
            frame(press.first_frame),
            frame(press.last_frame),
            frame(press.before_first),
            frame(press.before_last),
        ];
        let written = self.table.write_all(format!("{}\n", line.join(",")).as_bytes());
        written.and_then(|()| self.table.sync_data()).map_err(|e| failed(&self.place, &e))
    }

    /// Ends the recording with its index.
    ///
    /// # Errors
    /// Those of [`PressStore::frame`].
    pub fn finish(self) -> Result<(), SkinError> {
        Ok(self.writer.finish()?)
    }
}

fn settings() -> CaptureSettings {
    CaptureSettings { sync: true, ..CaptureSettings::default() }
}

fn failed(place: &Path, error: &std::io::Error) -> SkinError {
    SkinError::input(error.to_string()).within(&place.display().to_string())
}

/// Reads the table, without an incomplete last line, which is removed from the file.
fn read_table(table: &Path, notes: &mut Vec<String>) -> Result<Vec<Press>, SkinError> {
    let place = table.display().to_string();
    let mut bytes = read_file_of(table, MOST_BYTES)?;
    let whole = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1);
    if whole < bytes.len() {
        notes.push(format!(
            "{place}: an incomplete last line of {} bytes is removed",
            bytes.len() - whole
        ));
        bytes.truncate(whole);
        let file = OpenOptions::new().write(true).open(table);
        let cut = file.and_then(|file| file.set_len(whole as u64));
        cut.map_err(|e| failed(table, &e))?;
    }
    let mut lines = bytes.split(|byte| *byte == b'\n');
    if lines.next().map(<[u8]>::trim_ascii) != Some(HEADER.as_bytes()) {
        let message = format!("its first line must be {HEADER} for presses to be added");
        return Err(SkinError::input(message).within(&place));
    }
    match lines.any(|line| !line.trim_ascii().is_empty()) {
        true => Ok(PressTable::read(table)?.presses),
        false => Ok(Vec::new()),
    }
}

/// Averages the frames of each press in one pass over the recording; also returns the number of frames.
fn read_presses(
    recording: &Path,
    table: &Path,
    presses: Vec<Press>,
) -> Result<(Vec<CollectedPress>, usize), SkinError> {
    let missing = |what: &str, press: usize| {
        let place = format!("{}, line {}", table.display(), press + 2);
        SkinError::input(format!("{what}: it was not collected with {}", recording.display()))
            .within(&place)
    };
    let ranges = presses.iter().enumerate().map(|(k, press)| {
        let range = |first: Option<usize>, last: Option<usize>| Some(first?..=last?);
        let pressed = range(press.first_frame, press.last_frame);
        let both = pressed.zip(range(press.before_first, press.before_last));
        both.ok_or_else(|| missing("a frame number is missing", k))
    });
    let ranges: Vec<(RangeInclusive<usize>, RangeInclusive<usize>)> =
        ranges.collect::<Result<_, _>>()?;
    let mut taken: Vec<[Vec<Vec<f64>>; 2]> = vec![Default::default(); presses.len()];
    let (mut reader, mut frames) = (CaptureReader::open(recording)?, 0_usize);
    while let Some(entry) = reader.next_entry()? {
        let Entry::Frame(frame) = entry else { continue };
        for ((pressed, before), [of_press, of_before]) in ranges.iter().zip(&mut taken) {
            for (range, values) in [(pressed, of_press), (before, of_before)] {
                if range.contains(&frames) {
                    values.push(good_values(&frame));
                }
            }
        }
        frames += 1;
    }
    if let Some(k) = ranges.iter().position(|(pressed, _)| *pressed.end() >= frames) {
        return Err(missing(&format!("the recording has {frames} frames"), k));
    }
    let all = presses.into_iter().zip(&taken);
    let collected = all.map(|(press, [pressed, before])| CollectedPress {
        press,
        values: mean(pressed.iter()),
        reference: mean(before.iter()),
    });
    Ok((collected.collect(), frames))
}
