//! Pictures of the report as files.

use crate::error::ReportError;
use eit_picture::Canvas;

/// A picture of the report.
pub(super) struct Picture {
    /// File name.
    pub file: String,
    /// Content in PNG format.
    pub bytes: Vec<u8>,
}

impl Picture {
    pub(crate) fn new(name: impl std::fmt::Display, canvas: &Canvas) -> Result<Self, ReportError> {
        Ok(Self { file: format!("{name}.png"), bytes: crate::output::png(canvas)? })
    }
}
