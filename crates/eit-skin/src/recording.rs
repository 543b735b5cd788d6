//! Recordings from frames in memory: tables, and files of other formats.

use crate::error::SkinError;
use crate::touches::DEFAULT_RATE_HZ;
use eit_hw::capture::{
    CaptureSettings, CaptureWriter, Entry, MessageTimes, SessionRecord, check_new,
};
use eit_hw::{Frame, Layout, Recording};
use std::path::Path;

/// Writes a new recording with the frames and times of another one.
///
/// # Errors
///
/// Electrode potentials; frames that are too long; a file that exists or cannot be written.
pub fn write(recording: &Recording, path: impl AsRef<Path>) -> Result<(), SkinError> {
    let path = path.as_ref();
    check_new(path)?;
    let parts = 1 + usize::from(recording.imaginary.is_some());
    CaptureWriter::check_frame(parts * recording.value_count())?;
    if let Layout::Potentials { .. } = recording.layout {
        return Err(SkinError::input(format!(
            "{}: contains electrode potentials, whose differences a protocol defines: convert it for a scene",
            recording.path.display()
        )));
    }
    let (session, settings) = (session_of(recording), CaptureSettings::default());
    let start = MessageTimes::at(0);
    let mut writer = CaptureWriter::create_copy(path, &session, settings, Some(start))?;
    for frame in recording.frames() {
        let times = times_of(&frame, None);
        writer.write_at(&Entry::Frame(frame), times)?;
    }
    Ok(writer.finish()?)
}

/// Returns the metadata of a recording with these frames; without the electrodes of potentials.
pub fn session_of(recording: &Recording) -> SessionRecord {
    let quadruples = match &recording.layout {
        Layout::Quadruples(quadruples) => quadruples.clone(),
        _ => Vec::new(),
    };
    SessionRecord {
        driver: "file".into(),
        instrument: recording.format.to_string(),
        unit: recording.unit.into(),
        quadruples,
        current_a: recording.current_a,
        frequency_hz: recording.frequency_hz,
        recorder: concat!("eit ", env!("CARGO_PKG_VERSION")).to_owned(),
        ..SessionRecord::default()
    }
}

/// Returns when a frame was measured, by its clock or this rate, else 20 a second, from 1970 on: a table states no date.
pub fn times_of(frame: &Frame, rate_hz: Option<f64>) -> MessageTimes {
    let by_rate = || frame.sequence as f64 / rate_hz.unwrap_or(DEFAULT_RATE_HZ);
    let time_s = frame.device_time_s.unwrap_or_else(by_rate);
    MessageTimes::at((1e9 * time_s).round() as u64)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests")]
    use super::*;
    use ndarray::array;

    #[test]
    fn frames_in_memory_are_written_and_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("press.mcap");
        let values = array![[1e-3, 2e-3], [3e-3, f64::NAN]];
        let recording = Recording::of_values(values.view(), Some(4.0)).unwrap();
        assert_eq!(recording.quality.as_ref().map(|q| q[(1, 1)].is_good()), Some(false));
        write(&recording, &path).unwrap();
        let read = eit_hw::read_recording(&path, None, &Default::default()).unwrap();
        assert_eq!(read.real.row(0), recording.real.row(0));
        assert_eq!((read.real[(1, 0)], read.real[(1, 1)].is_nan()), (3e-3, true));
        assert_eq!(read.device_time_s, Some(vec![0.0, 0.25]));
        let said = write(&recording, &path).unwrap_err().to_string();
        assert!(said.contains("press.mcap"), "{said}");
    }
}
