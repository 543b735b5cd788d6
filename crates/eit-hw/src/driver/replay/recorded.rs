//! Events of a recording.

use std::path::Path;

use super::{Events, Pace, Replay};
use crate::capture::{CaptureReader, Entry, SessionRecord};
use crate::driver::setup::{Identity, Limits, Setup};
use crate::driver::source::Event;
use crate::error::{HwError, Place};
use crate::frame::Quadruple;
use crate::recording::{Layout, Unit};

impl Replay {
    /// Plays the recording at `path`, with the memory of one chunk and, at the start of each epoch, of 8 MB
    /// that are read ahead for its reference.
    ///
    /// `quadruples` are the measurements of the scene's protocol and define the order of the
    /// values; with `None`, frames are delivered as recorded.
    ///
    /// # Errors
    /// [`HwError::Setting`] for a pace that is not above 0; those of
    /// [`capture::read`](crate::capture::read) if the recording cannot be read; those of
    /// [`FrameMap::new`](crate::recording::FrameMap::new) if it lacks measurements of the protocol.
    pub fn open(
        path: impl AsRef<Path>,
        quadruples: Option<&[Quadruple]>,
        pace: Pace,
    ) -> Result<Self, HwError> {
        let path = path.as_ref();
        let (session, setup) = recorded_setup(path)?;
        let events = recorded_events(path, session)?;
        let replay = Self::of_events(setup, events, quadruples, pace, path)?;
        Ok(Self { has_references: true, ..replay })
    }
}

/// Events of a recording, whose sessions must have the measurements of the first.
fn recorded_events(path: &Path, session: SessionRecord) -> Result<Events, HwError> {
    let place = path.to_path_buf();
    let mut reader = CaptureReader::open(path)?;
    // each run of an appended recording begins at epoch 0
    let (mut first_epoch, mut epoch, mut is_begun) = (0_u32, 0_u32, false);
    let mut is_read = false;
    Ok(Box::new(std::iter::from_fn(move || {
        loop {
            let event = match reader.next_entry() {
                Err(error) => return Some(Err(error)),
                // what is missing or damaged is known at the end only
                Ok(None) if std::mem::replace(&mut is_read, true) => return None,
                Ok(None) => match reader.damage().note() {
                    Some(note) => Event::Notice(note.to_string()),
                    None => return None,
                },
                Ok(Some(Entry::Frame(mut frame))) => {
                    frame.epoch = first_epoch.saturating_add(frame.epoch);
                    (epoch, is_begun) = (frame.epoch, true);
                    Event::Frame(frame)
                }
                Ok(Some(Entry::Note(text))) => Event::Notice(text),
                Ok(Some(Entry::Session(other))) if other.quadruples != session.quadruples => {
                    return Some(Err(HwError::Container {
                        place: Place::file(&place),
                        what: format!(
                            "sessions of {} and {} measurements do not match",
                            session.quadruples.len(),
                            other.quadruples.len()
                        ),
                        mend: "record each set-up in its own file",
                    }));
                }
                Ok(Some(Entry::Session(other))) if is_begun && !other.continues => {
                    first_epoch = epoch.saturating_add(1);
                    continue;
                }
                Ok(Some(Entry::Reference(taken))) if !taken.sequences.is_empty() => {
                    let epoch = first_epoch.saturating_add(taken.epoch);
                    Event::Reference { epoch, sequences: taken.sequences, until: taken.until }
                }
                // touches, and references whose frames are not known, are computed again
                Ok(Some(_)) => continue,
            };
            return Some(Ok(event));
        }
    })))
}

/// Reads up to the first frame, for the session and the number of values.
fn recorded_setup(path: &Path) -> Result<(SessionRecord, Setup), HwError> {
    let mut reader = CaptureReader::open(path)?;
    let mut session = SessionRecord::default();
    let first = loop {
        match reader.next_entry()? {
            Some(Entry::Frame(frame)) => break frame,
            Some(Entry::Session(found)) => session = found,
            Some(_) => {}
            None => return Err(HwError::NoFrames { place: Place::file(path), skipped: 0 }),
        }
    };
    let layout = match session.quadruples.is_empty() {
        true => Layout::ProtocolOrder,
        false => Layout::Quadruples(session.quadruples.clone()),
    };
    let setup = Setup {
        identity: Identity::one_line("replay", &session.instrument, &session.serial),
        layout,
        value_count: first.values.len(),
        complex: first.imaginary.is_some(),
        unit: Unit::from(session.unit),
        frame_rate_hz: session.frame_rate_hz,
        limits: Limits::default(),
    };
    Ok((session, setup))
}
