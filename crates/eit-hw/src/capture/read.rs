//! Recordings read as a whole.

use std::io::Read;
use std::path::Path;

use ndarray::Array2;

use super::entry::Entry;
use super::record::SessionRecord;
use super::stream::{CaptureReader, Damage};
use crate::error::{HwError, Place};
use crate::frame::{Frame, Quality};
use crate::recording::{Format, Layout, Note, Recording, Unit};

/// A recording that was read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Capture {
    /// Every message, in the order of the file.
    pub entries: Vec<Entry>,
    /// What is missing.
    pub damage: Damage,
}

impl Capture {
    /// The frames.
    pub fn frames(&self) -> impl Iterator<Item = &Frame> {
        self.entries.iter().filter_map(|entry| match entry {
            Entry::Frame(frame) => Some(frame),
            _ => None,
        })
    }

    /// The sessions, of which each holds for the frames after it.
    pub fn sessions(&self) -> impl Iterator<Item = &SessionRecord> {
        self.entries.iter().filter_map(|entry| match entry {
            Entry::Session(session) => Some(session),
            _ => None,
        })
    }

    /// The frames as any other recorded file. The instrument's clock is kept where it goes on
    /// through all frames, which it does not over several epochs.
    ///
    /// # Errors
    /// [`HwError::NoFrames`]; [`HwError::Container`] where frames of different sizes or sessions of
    /// different measurements follow each other.
    pub fn recording(&self, path: &Path) -> Result<Recording, HwError> {
        let place = || Place::file(path);
        let differ = |what: String| HwError::Container {
            place: place(),
            what,
            mend: "record each set-up in a file of its own",
        };
        let mut frames = self.frames().peekable();
        let Some(&first) = frames.peek() else {
            return Err(HwError::NoFrames { place: place(), skipped: 0 });
        };
        let (count, complex) = (first.values.len(), first.imaginary.is_some());
        let (mut real, mut imaginary) = (Vec::new(), Vec::new());
        let (mut quality, mut times): (Vec<Quality>, _) = (Vec::new(), Vec::new());
        for frame in frames {
            if frame.values.len() != count || frame.imaginary.is_some() != complex {
                let found = frame.values.len();
                let number = frame.sequence;
                return Err(differ(format!(
                    "frame {number} has {found} values, but those before have {count}"
                )));
            }
            real.extend(&frame.values);
            imaginary.extend(frame.imaginary.iter().flatten());
            quality.extend(&frame.quality);
            times.extend(frame.device_time_s);
        }
        let mut sessions = self.sessions();
        let session = sessions.next().cloned().unwrap_or_default();
        if let Some(other) = sessions.find(|other| other.quadruples != session.quadruples) {
            let (one, other) = (session.quadruples.len(), other.quadruples.len());
            let what = format!("sessions of {one} and {other} measurements differ in them");
            return Err(differ(what));
        }
        let named = session.quadruples.len();
        if named != 0 && named != count {
            let what = format!("frames have {count} values, but the session names {named}");
            return Err(differ(what));
        }
        let rows = real.len() / count.max(1);
        let none = |_| HwError::NoFrames { place: place(), skipped: 0 };
        let table = |values| Array2::from_shape_vec((rows, count), values).map_err(none);
        let layout = match named {
            0 => Layout::ProtocolOrder,
            _ => Layout::Quadruples(session.quadruples),
        };
        let parts = if complex { Some(table(imaginary)?) } else { None };
        let unit = Unit::from(session.unit);
        let mut recording = Recording::new(table(real)?, parts, layout, unit, Format::Mcap, path);
        recording.quality = Array2::from_shape_vec((rows, count), quality).map_err(none)?;
        let steady = times.len() == rows && times.is_sorted();
        recording.device_time_s = steady.then_some(times);
        let Damage { bad_chunks: chunks, bad_messages: messages, truncated_bytes, .. } =
            self.damage;
        if chunks + messages + truncated_bytes > 0 {
            recording.notes.push(Note::Damaged { chunks, messages, truncated_bytes });
        }
        recording.current_a = session.current_a;
        recording.frequency_hz = session.frequency_hz;
        Ok(recording)
    }
}

/// Reads a recording, whole or cut.
///
/// # Errors
/// [`HwError::Read`], and as [`parse`].
pub fn read(path: &Path) -> Result<Capture, HwError> {
    whole(CaptureReader::open(path)?)
}

/// The recording of these bytes; `path` is for messages. Chunks that are whole and right are read,
/// whatever became of the rest.
///
/// # Errors
/// [`HwError::Empty`], and [`HwError::Container`] for what does not start as MCAP.
pub fn parse(bytes: &[u8], path: &Path) -> Result<Capture, HwError> {
    whole(CaptureReader::new(bytes, path)?)
}

/// Every message of a recording.
fn whole<R: Read>(mut reader: CaptureReader<R>) -> Result<Capture, HwError> {
    let mut entries = Vec::new();
    while let Some(entry) = reader.next_entry()? {
        entries.push(entry);
    }
    Ok(Capture { entries, damage: reader.damage() })
}
