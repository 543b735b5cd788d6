//! Settings of a recording.

use crate::error::HwError;

/// Settings of [`CaptureWriter`](super::CaptureWriter).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct CaptureSettings {
    /// Maximum age of an open chunk in seconds: what a killed program loses. Once its first message
    /// is this old, the next message or [`CaptureWriter::tick`](super::CaptureWriter::tick) writes the chunk.
    pub flush_s: f64,
    /// Whether to force each chunk to the disk, so that it survives a power cut; waits for the disk
    /// each time.
    pub sync: bool,
    /// Length in bytes at which a recording is split: the next frame begins a new part. At least
    /// 100 000; a part is longer by at most one chunk of 1 MB and its index.
    pub part_bytes: Option<u64>,
    /// Time in seconds after which a recording is split, at least 1.
    pub part_s: Option<f64>,
}

impl Default for CaptureSettings {
    /// One second, without forcing to the disk, in one file.
    fn default() -> Self {
        Self { flush_s: 1.0, sync: false, part_bytes: None, part_s: None }
    }
}

impl CaptureSettings {
    /// Returns whether the recording is split into parts.
    pub fn is_split(&self) -> bool {
        self.part_bytes.is_some() || self.part_s.is_some()
    }

    /// Rejects invalid settings.
    pub(super) fn check(self) -> Result<(), HwError> {
        HwError::require(self.flush_s > 0.0, "flush_s", self.flush_s, "more than 0")?;
        // shorter parts would be useless
        let bytes = self.part_bytes.unwrap_or(u64::MAX);
        HwError::require(bytes >= 100_000, "part_bytes", bytes, "at least 100000")?;
        let seconds = self.part_s.unwrap_or(1.0);
        let is_enough = seconds >= 1.0 && seconds.is_finite();
        HwError::require(is_enough, "part_s", seconds, "at least 1")
    }
}
