//! Pictures of the report as files.

use crate::error::ReportError;
use eit_picture::Canvas;

/// A picture of the report.
pub(super) struct Picture {
    /// Name of its file.
    pub file: &'static str,
    /// PNG.
    pub bytes: Vec<u8>,
}

impl Picture {
    pub fn new(file: &'static str, canvas: &Canvas) -> Result<Self, ReportError> {
        let mut bytes = Vec::new();
        canvas.write_png(&mut bytes)?;
        Ok(Self { file, bytes })
    }
}
