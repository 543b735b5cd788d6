//! Sciospec `.eit` text frames: one file per frame, one folder per recording.
//!
//! The first line is the number of header lines, itself included. Then, for each drive, follow a
//! line `a b` (channels from 1) and, for each frequency, a line of real and imaginary parts of the
//! potentials of all channels of the device in volts. The header's `MeasurementChannels` says which
//! channels are electrodes; they are numbered in its order. Current enters at the channel named
//! first: in the vendor's recording its potential is positive and that of the other negative.

mod frame;
mod header;

use std::collections::HashSet;
use std::mem::take;
use std::path::Path;

use super::files::{file_bytes, file_names, missing_numbers};
use super::wrong_field;
use crate::error::{HwError, Place};
use crate::recording::{Contents, Format, Layout, Note, Recording, Unit};
use frame::EitFrame;

/// Reads a folder of `.eit` files, in the order of the numbers at the end of their names. A damaged file, such as the last one of a
/// program that was stopped, is left out, with a note, unless all are.
///
/// The layout is [`Layout::Potentials`], complex, in [`Unit::Volt`].
///
/// # Errors
/// Those of [`parse`] if no file can be read, and [`HwError`] if a file cannot be read, a name has no number, two
/// recordings share the folder, or a frame has other drives or channels than the first.
pub(super) fn read(path: &Path, frequency_row: usize) -> Result<Recording, HwError> {
    let files = numbered_files(path)?;
    let mut frames = Frames::default();
    let mut damaged = Vec::new();
    for (_, name) in &files {
        let path = path.join(name);
        let bytes = file_bytes(&path, Format::Sciospec.name())?;
        match EitFrame::parse(&bytes, &path, frequency_row) {
            Ok(frame) => frames.push(frame, &path)?,
            Err(error) => damaged.push(error),
        }
    }
    if frames.first.is_none()
        && let Some(error) = damaged.pop()
    {
        return Err(error);
    }
    let mut recording = frames.finish(path)?;
    if let Some(first) = damaged.first() {
        let (count, first) = (damaged.len(), first.to_string());
        recording.notes.push(Note::DamagedFiles { count, first });
    }
    recording.notes.extend(missing_numbers(files.iter().map(|(number, _)| *number)));
    Ok(recording)
}

/// Parses the content of one `.eit` file, which holds one frame; `path` is used in messages only.
///
/// # Errors
/// [`HwError`] for an empty or binary file, an `.eit` of another manufacturer, an invalid header, a
/// drive line without its channels, a line whose number of values differs from the first, a value
/// that is not a finite number, a frequency row that does not exist, and a file that ends within a
/// drive.
pub(super) fn parse(bytes: &[u8], path: &Path, frequency_row: usize) -> Result<Recording, HwError> {
    let mut frames = Frames::default();
    frames.push(EitFrame::parse(bytes, path, frequency_row)?, path)?;
    frames.finish(path)
}

/// Returns number and name of each `.eit` file of a recording, sorted by number.
fn numbered_files(folder: &Path) -> Result<Vec<(u64, String)>, HwError> {
    let mut files: Vec<(u64, String)> = Vec::new();
    let mut recording: Option<String> = None;
    for name in file_names(folder)? {
        let Some(stem) = name.to_lowercase().strip_suffix(".eit").map(str::to_owned) else {
            continue;
        };
        let base = stem.trim_end_matches(|character: char| character.is_ascii_digit());
        let Ok(number) = stem[base.len()..].parse() else {
            let (place, wanted) =
                (Place::file(&folder.join(&name)), "a frame number before `.eit`");
            return Err(wrong_field(
                place,
                "file name",
                &name,
                wanted,
                "rename or remove the file",
            ));
        };
        match &recording {
            Some(one) if one != base => {
                let (one, other) = (one.clone(), base.to_owned());
                return Err(HwError::TwoRecordings { place: Place::file(folder), one, other });
            }
            Some(_) => {}
            None => recording = Some(base.to_owned()),
        }
        files.push((number, name));
    }
    if files.is_empty() {
        let (place, format) = (Place::file(folder), Format::Sciospec.name());
        return Err(HwError::MissingFile { place, name: "NAME_00001.eit", format });
    }
    files.sort();
    Ok(files)
}

/// Frames of a recording, which must all have the drives and channels of the first.
#[derive(Default)]
struct Frames {
    first: Option<EitFrame>,
    real: Vec<f64>,
    imaginary: Vec<f64>,
    /// Times in the headers, in milliseconds, as long as every file has one.
    times_ms: Option<Vec<i64>>,
}

impl Frames {
    fn push(&mut self, mut frame: EitFrame, path: &Path) -> Result<(), HwError> {
        self.real.extend(take(&mut frame.real));
        self.imaginary.extend(take(&mut frame.imaginary));
        let Some(first) = &self.first else {
            self.times_ms = frame.time_ms.map(|time| vec![time]);
            self.first = Some(frame);
            return Ok(());
        };
        let differs = |what, found, wanted| {
            HwError::count(
                Place::file(path),
                what,
                [found, wanted],
                "every frame must match the first: remove this file",
            )
        };
        if frame.electrodes != first.electrodes {
            return Err(differs("electrodes", frame.electrodes, first.electrodes));
        }
        if frame.drives != first.drives {
            let same = frame.drives.iter().zip(&first.drives).filter(|(a, b)| a == b).count();
            return Err(differs("drives like those of the first frame", same, first.drives.len()));
        }
        self.times_ms = self.times_ms.take().zip(frame.time_ms).map(|(mut times, time)| {
            times.push(time);
            times
        });
        Ok(())
    }

    fn finish(self, path: &Path) -> Result<Recording, HwError> {
        let Some(EitFrame { drives, electrodes, frequency_hz, current_a, .. }) = self.first else {
            return Err(HwError::NoFrames { place: Place::file(path), skipped: 0 });
        };
        let values = drives.len() * electrodes;
        let repeated = repeated(&drives);
        let layout = Layout::Potentials { drives, electrodes, driven: true };
        let contents = Contents {
            real: self.real,
            imaginary: Some(self.imaginary),
            value_count: values,
            ..Contents::default()
        };
        let mut recording = Recording::new(contents, layout, Unit::Volt, Format::Sciospec, path)?;
        recording.device_time_s = self.times_ms.map(|times| {
            let start = times.first().copied().unwrap_or_default();
            times.iter().map(|time| (time - start) as f64 * 1e-3).collect()
        });
        recording.frequency_hz = Some(frequency_hz);
        recording.current_a = Some(current_a);
        recording.notes = repeated;
        Ok(recording)
    }
}

/// Returns a note for each repeated drive.
fn repeated(drives: &[[u32; 2]]) -> Vec<Note> {
    let mut seen = HashSet::with_capacity(drives.len());
    drives
        .iter()
        .filter(|&&drive| !seen.insert(drive))
        .map(|&[a, b]| Note::RepeatedDrive { a, b })
        .collect()
}
