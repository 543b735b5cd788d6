//! Reads the files of a recording, in the order of the protocol.

use crate::error::SkinError;
use crate::skin::Skin;
use eit_fem::Protocol;
use eit_hw::{Layout, MeasuredFrames, Recording};
use ndarray::{Axis, concatenate};
use std::path::{Path, PathBuf};

/// Frames read from files, in protocol order.
pub(super) struct Loaded {
    pub frames: MeasuredFrames,
    pub marked_reference: Option<usize>,
    pub ordered_by_file: bool,
    pub notes: Vec<String>,
}

pub(super) fn read(skin: &Skin, files: &[PathBuf]) -> Result<Loaded, SkinError> {
    let keys = &skin.settings.recording;
    let protocol = &skin.protocol;
    let count = protocol.measurements();
    let (format, options) = keys.reading()?;
    let options = eit_hw::ReadOptions { measurements: Some(count), ..options };
    let mut parts = Vec::new();
    let mut notes = Vec::new();
    let (mut marked_reference, mut ordered_by_file) = (None, true);
    for file in files {
        let recording = eit_hw::read_recording(file, format, &options)?;
        let recording = recording.arranged_for(protocol.quadruples(), count);
        let mut frames = recording.frames_for(protocol.quadruples(), count, keys.component)?;
        frames.to_volts(drive_current_a(protocol));
        keys.convert(&mut frames);
        notes.extend(notes_of(&recording, file));
        if parts.is_empty() {
            marked_reference = recording.reference_frame;
        }
        ordered_by_file &= !matches!(recording.layout, Layout::ProtocolOrder);
        parts.push(frames);
    }
    let frames = joined(parts)?;
    Ok(Loaded { frames, marked_reference, ordered_by_file, notes })
}

/// Notes for the user about one file.
fn notes_of(recording: &Recording, file: &Path) -> Vec<String> {
    let name = name_of(file);
    let mut notes: Vec<String> = recording.notes.iter().map(|n| format!("{name}: {n}")).collect();
    if recording.skipped.frames > 0 {
        notes.push(format!("{name}: {}", recording.skipped));
    }
    notes
}

/// Concatenates the frames of several files; their clocks do not continue, so times are dropped.
fn joined(mut parts: Vec<MeasuredFrames>) -> Result<MeasuredFrames, SkinError> {
    if parts.len() == 1 {
        return Ok(parts.remove(0));
    }
    let failed = |e: ndarray::ShapeError| SkinError::Failure(format!("joining files: {e}"));
    let values: Vec<_> = parts.iter().map(|p| p.values.view()).collect();
    let quality: Vec<_> = parts.iter().map(|p| p.quality.view()).collect();
    let (values, quality) = (
        concatenate(Axis(0), &values).map_err(failed)?,
        concatenate(Axis(0), &quality).map_err(failed)?,
    );
    Ok(MeasuredFrames { values, quality, device_time_s: None, ..parts.remove(0) })
}

pub(super) fn name_of(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned())
}

/// Largest current of the first stimulation, which converts a measured impedance to a voltage.
pub(super) fn drive_current_a(protocol: &Protocol) -> f64 {
    protocol.stimulations_a().row(0).iter().fold(0.0, |m: f64, i| m.max(i.abs()))
}
