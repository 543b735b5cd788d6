//! Recordings that are started and stopped on the page.

use super::server::Line;
use crate::outbox::lock;
use serde::Serialize;
use std::sync::Mutex;

/// State of a recording, as the page shows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(tag = "state", rename_all = "snake_case")]
pub enum Recording<'a> {
    /// Nothing is recorded.
    Off {
        /// Last recording, if there was one.
        file: Option<&'a str>,
    },
    /// Frames are being written.
    On {
        /// Name of the file.
        file: &'a str,
        /// Whether the page may stop it.
        can_stop: bool,
    },
    /// A recording could not be started or was cut short.
    Failed {
        /// What went wrong.
        error: &'a str,
    },
}

/// The line that tells the page.
#[derive(Serialize)]
#[serde(tag = "type", rename = "recording")]
pub(super) struct RecordingEvent<'a> {
    #[serde(flatten)]
    pub(crate) recording: Recording<'a>,
}

/// Passes requests of the page to the program, and remembers the state for pages that open later.
#[derive(Debug)]
pub(super) struct Recorder {
    /// Requests must carry it.
    pub(crate) token: String,
    request: Mutex<Option<bool>>,
    state: Mutex<Option<Line>>,
}

impl Recorder {
    pub(super) fn new(token: String) -> Self {
        Self { token, request: Mutex::default(), state: Mutex::default() }
    }

    /// Stores a request: true to start, false to stop. A later request replaces an earlier one.
    pub(super) fn ask(&self, start: bool) {
        *lock(&self.request) = Some(start);
    }

    /// Takes the stored request.
    pub(super) fn take(&self) -> Option<bool> {
        lock(&self.request).take()
    }

    /// Returns the line about recording that a newly opened page gets.
    pub(super) fn state(&self) -> Option<Line> {
        lock(&self.state).clone()
    }

    pub(super) fn set(&self, line: Line) {
        *lock(&self.state) = Some(line);
    }
}
