//! Messages of a recording and their topics.

use super::json::FrameRecord;
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

/// One message of a recording, in their order.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Entry {
    /// What the following frames are.
    Session(SessionRecord),
    /// A frame.
    Frame(Frame),
    /// A reference.
    Reference(ReferenceRecord),
    /// Touches.
    Touches(TouchesRecord),
    /// A note.
    Note(String),
}

impl Entry {
    pub(super) fn from_json(topic: Topic, json: &[u8]) -> Option<Self> {
        match topic {
            Topic::Session => serde_json::from_slice(json).ok().map(Self::Session),
            Topic::Frame => serde_json::from_slice::<FrameRecord>(json)
                .ok()
                .and_then(FrameRecord::into_frame)
                .map(Self::Frame),
            Topic::Reference => serde_json::from_slice(json).ok().map(Self::Reference),
            Topic::Touches => serde_json::from_slice(json).ok().map(Self::Touches),
            Topic::Note => serde_json::from_slice::<NoteRecord>(json)
                .ok()
                .map(|record| Self::Note(record.text)),
        }
    }
}
