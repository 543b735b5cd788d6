//! Messages of a recording, and their topics.

use mcap::records::Channel;

use super::json::{FrameJson, FrameRecord};
use super::record::{NoteRecord, ReferenceRecord, SessionRecord, TouchesRecord};
use crate::frame::Frame;

/// The topics of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Topic {
    Session,
    Frame,
    Reference,
    Touches,
    Note,
}

impl Topic {
    pub(super) const ALL: [Self; 5] =
        [Self::Session, Self::Frame, Self::Reference, Self::Touches, Self::Note];

    /// Returns the topic of a channel, or `None` if another program wrote it.
    pub(super) fn of(channel: &Channel) -> Option<Self> {
        let topic = Self::ALL.into_iter().find(|topic| topic.name() == channel.topic);
        topic.filter(|_| channel.message_encoding == "json")
    }

    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Session => "/eit/session",
            Self::Frame => "/eit/frame",
            Self::Reference => "/eit/reference",
            Self::Touches => "/eit/touches",
            Self::Note => "/eit/note",
        }
    }

    pub(super) const fn schema(self) -> (&'static str, &'static str) {
        match self {
            Self::Session => ("eit.Session", include_str!("session.schema.json")),
            Self::Frame => ("eit.Frame", include_str!("frame.schema.json")),
            Self::Reference => ("eit.Reference", include_str!("reference.schema.json")),
            Self::Touches => ("eit.Touches", include_str!("touches.schema.json")),
            Self::Note => ("eit.Note", include_str!("note.schema.json")),
        }
    }
}

/// A message to write.
#[derive(Clone, Copy)]
pub(super) enum Message<'a> {
    Session(&'a SessionRecord),
    Frame(&'a Frame),
    Reference(&'a ReferenceRecord),
    Touches(&'a TouchesRecord),
    Note(&'a str),
}

impl Message<'_> {
    pub(super) fn topic(self) -> Topic {
        match self {
            Self::Session(_) => Topic::Session,
            Self::Frame(_) => Topic::Frame,
            Self::Reference(_) => Topic::Reference,
            Self::Touches(_) => Topic::Touches,
            Self::Note(_) => Topic::Note,
        }
    }

    pub(super) fn write(self, json: &mut Vec<u8>) -> serde_json::Result<()> {
        match self {
            Self::Session(session) => serde_json::to_writer(json, session),
            Self::Frame(frame) => serde_json::to_writer(json, &FrameJson(frame)),
            Self::Reference(reference) => serde_json::to_writer(json, reference),
            Self::Touches(touches) => {
                json.extend_from_slice(touches.json().as_bytes());
                Ok(())
            }
            Self::Note(text) => serde_json::to_writer(json, &NoteRecord { text: text.into() }),
        }
    }
}

impl<'a> From<&'a Entry> for Message<'a> {
    fn from(entry: &'a Entry) -> Self {
        match entry {
            Entry::Session(session) => Self::Session(session),
            Entry::Frame(frame) => Self::Frame(frame),
            Entry::Reference(reference) => Self::Reference(reference),
            Entry::Touches(touches) => Self::Touches(touches),
            Entry::Note(text) => Self::Note(text),
        }
    }
}

/// One message of a recording.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Entry {
    /// Describes the frames that follow.
    Session(SessionRecord),
    /// A measured frame.
    Frame(Frame),
    /// A new reference frame.
    Reference(ReferenceRecord),
    /// The touches found in one frame.
    Touches(TouchesRecord),
    /// A text note.
    Note(String),
}

impl Entry {
    /// Returns the approximate memory the entry takes.
    pub(super) fn memory_bytes(&self) -> u64 {
        let values = match self {
            Self::Frame(frame) => {
                let parts = frame.values.len() + frame.imaginary.as_ref().map_or(0, Vec::len);
                8 * parts + 2 * frame.quality.len()
            }
            Self::Session(session) => 16 * session.quadruples.len() + session.scene_toml.len(),
            Self::Reference(reference) => {
                16 * reference.values.len() + 8 * reference.sequences.len()
            }
            Self::Touches(touches) => touches.json().len(),
            Self::Note(text) => text.len(),
        };
        (size_of::<Self>() + values) as u64
    }

    pub(super) fn from_json(topic: Topic, json: &[u8]) -> Option<Self> {
        match topic {
            Topic::Session => serde_json::from_slice(json).ok().map(Self::Session),
            Topic::Frame => serde_json::from_slice::<FrameRecord>(json)
                .ok()
                .and_then(FrameRecord::into_frame)
                .map(Self::Frame),
            Topic::Reference => serde_json::from_slice(json).ok().map(Self::Reference),
            Topic::Touches => {
                let json = String::from_utf8(json.to_vec()).ok()?;
                TouchesRecord::new(json).map(Self::Touches)
            }
            Topic::Note => serde_json::from_slice::<NoteRecord<'_>>(json)
                .ok()
                .map(|record| Self::Note(record.text.into_owned())),
        }
    }
}
