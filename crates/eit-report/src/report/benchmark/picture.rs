//! Pictures of the report as files.

use crate::error::ReportError;
use eit_picture::Canvas;

/// A picture of the report.
pub(super) struct Picture {
    /// File name.
    pub file: &'static str,
    /// Content in PNG format.
    pub bytes: Vec<u8>,
}

impl Picture {
    pub fn new(file: &'static str, canvas: &Canvas) -> Result<Self, ReportError> {
        let mut bytes = Vec::new();
        canvas.write_png(&mut bytes)?;
        Ok(Self { file, bytes })
    }
}
