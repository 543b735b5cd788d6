//! Reads the files of a recording, in the order of the protocol.

use crate::error::SkinError;
use crate::skin::Skin;
use eit_fem::Protocol;
use eit_hw::{Frame, HwError, Layout, MeasuredFrames, Quality, Recording, Unit};
use ndarray::{Array2, Axis, concatenate};
use std::path::{Path, PathBuf};

/// Frames read from files, in protocol order.
pub(super) struct Loaded {
    pub frames: MeasuredFrames,
    pub marked_reference: Option<usize>,
    pub ordered_by_file: bool,
    pub notes: Vec<String>,
}

pub(super) fn read(skin: &Skin, files: &[PathBuf]) -> Result<Loaded, SkinError> {
    let count = skin.protocol.measurements();
    let (format, options) = skin.settings.recording.reading()?;
    let options = eit_hw::ReadOptions {
        measurements: Some(skin.layout.value_count().unwrap_or(count)),
        ..options
    };
    load(skin, files.iter().map(|file| eit_hw::read_recording(file, format, &options)))
}

pub(super) fn of_recording(skin: &Skin, recording: &Recording) -> Result<Loaded, SkinError> {
    load(skin, std::iter::once(Ok(recording.clone())))
}

/// Converts an instrument's frames to those of a recording.
pub(crate) fn of_frames(frames: &[Frame], unit: Unit) -> MeasuredFrames {
    let shape = (frames.len(), frames.first().map_or(0, |frame| frame.values.len()));
    let values = Array2::from_shape_fn(shape, |(row, column)| frames[row].values[column]);
    let quality = Array2::from_shape_fn(shape, |(row, column)| frames[row].quality[column]);
    of_values(values, quality, unit)
}

/// Values and their flags, without times and what only files state.
pub(super) fn of_values(
    values: Array2<f64>,
    quality: Array2<Quality>,
    unit: Unit,
) -> MeasuredFrames {
    let (device_time_s, frequency_hz, current_a, phase_rad) = (None, None, None, None);
    MeasuredFrames { values, quality, unit, device_time_s, frequency_hz, current_a, phase_rad }
}

fn load(
    skin: &Skin,
    recordings: impl Iterator<Item = Result<Recording, HwError>>,
) -> Result<Loaded, SkinError> {
    let keys = &skin.settings.recording;
    let protocol = &skin.protocol;
    let count = protocol.measurements();
    let mut parts = Vec::new();
    let mut notes = Vec::new();
    let (mut marked_reference, mut ordered_by_file) = (None, true);
    let mut kinds = Vec::new();
    for recording in recordings {
        let recording = recording?.arranged_for(&skin.layout, protocol.quadruples(), count);
        let frames = recording.frames_for(protocol.quadruples(), count, keys.component);
        let mut frames = frames.map_err(|error| advised(error, skin, &recording))?;
        frames.to_volts(drive_current_a(protocol));
        keys.convert(&mut frames);
        kinds.extend(notes_of(&recording));
        if parts.is_empty() {
            marked_reference = recording.reference_frame;
        }
        ordered_by_file &= !matches!(recording.layout, Layout::ProtocolOrder);
        parts.push(frames);
    }
    while let Some((kind, note)) = kinds.first().cloned() {
        let before = kinds.len();
        kinds.retain(|other| other.0 != kind);
        let others = before - kinds.len() - 1;
        let more = if others > 0 {
            format!(" ({others} more files have such a note)")
        } else {
            String::new()
        };
        notes.push(format!("{note}{more}"));
    }
    let frames = joined(parts)?;
    Ok(Loaded { frames, marked_reference, ordered_by_file, notes })
}

/// Adds to the error of another number of values what explains them, by the model.
#[cfg(feature = "first-scene")]
fn advised(error: HwError, skin: &Skin, recording: &Recording) -> SkinError {
    use eit_hw::CountHint;
    let HwError::CountMismatch { place, found, frames, wanted, hint } = &error else {
        return error.into();
    };
    let is_of_protocol = matches!(
        hint,
        CountHint::DrivenKept { .. } | CountHint::DrivenDropped { .. } | CountHint::Unknown
    );
    let judge = is_of_protocol.then(|| crate::arrangement::Judge::new(skin)).flatten();
    match judge.and_then(|judge| judge.advice(recording)) {
        Some(advice) => SkinError::input(format!(
            "{place}: {found} values per line in {frames} line(s), but the scene's protocol has {wanted} measurements a frame: \
             {advice}"
        )),
        None => error.into(),
    }
}

#[cfg(not(feature = "first-scene"))]
fn advised(error: HwError, _: &Skin, _: &Recording) -> SkinError {
    error.into()
}

/// Kind of a note about a file; `None` for frames that were skipped.
type Kind = Option<std::mem::Discriminant<eit_hw::Note>>;

/// Notes for the user about one file, with their kinds.
fn notes_of(recording: &Recording) -> Vec<(Kind, String)> {
    let name = name_of(&recording.path);
    let kind = |note| Some(std::mem::discriminant(note));
    let of_file = recording.notes.iter().map(|note| (kind(note), format!("{name}: {note}")));
    let skipped = &recording.skipped;
    let skipped = (skipped.frames > 0).then(|| (None, format!("{name}: {skipped}")));
    of_file.chain(skipped).collect()
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
