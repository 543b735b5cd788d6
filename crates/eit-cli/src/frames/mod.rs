//! Recorded frames and their reference, in the order of a scene's protocol.

mod fit;
mod order;
mod reference;

pub(crate) use fit::ModelFit;

use crate::error::CliError;
use crate::scene::{Component, DifferenceKind, FramesAre, OneOrManyFiles, Reference, Scene};
use eit_fem::Protocol;
use eit_hw::{Layout, Quality, ReadOptions, Unit};
use ndarray::{Array2, Axis, concatenate};
use std::path::{Path, PathBuf};

/// Frames ready for reconstruction.
pub(crate) struct Frames {
    /// [frame, measurement], volt (or the instrument's unit where it states none).
    pub values: Array2<f64>,
    /// The frame to subtract.
    pub reference: Vec<f64>,
    /// Where the reference came from, in words.
    pub reference_source: String,
    /// Measurements that every frame and the reference have good values for.
    pub used: Vec<bool>,
    /// Frames a second, where known.
    pub rate_hz: Option<f64>,
    /// Reciprocity error of the mean frame, where there are reciprocal pairs.
    pub reciprocity_error: Option<f64>,
    /// What the user should know.
    pub notes: Vec<String>,
}

/// Frames of files in protocol order.
struct Loaded {
    values: Array2<f64>,
    quality: Array2<Quality>,
    marked_reference: Option<usize>,
    time_s: Option<Vec<f64>>,
    ordered_by_file: bool,
    notes: Vec<String>,
}

/// Reads the frames of a scene: `files` and `reference` of the command line come first.
pub(crate) fn load(
    scene: &Scene,
    protocol: &Protocol,
    files: &[PathBuf],
    reference: Option<&Reference>,
) -> Result<Frames, CliError> {
    let files = match (files, &scene.recording.file) {
        ([], Some(OneOrManyFiles::One(file))) => vec![scene.resolve(file)],
        ([], Some(OneOrManyFiles::Many(files))) => files.iter().map(|f| scene.resolve(f)).collect(),
        ([], None) => {
            let message = "no frames: give --frames F, or [recording] file in the scene";
            return Err(CliError::input(message));
        }
        (given, _) => given.to_vec(),
    };
    let loaded = read(scene, protocol, &files)?;
    let (reference, reference_source, reference_quality) =
        reference::take(scene, protocol, &loaded, reference)?;
    let good = |column: usize| {
        loaded.quality.column(column).iter().all(|q| q.is_good())
            && reference_quality.as_ref().is_none_or(|q| q[column].is_good())
    };
    let mut used: Vec<bool> = (0..protocol.measurements()).map(good).collect();
    let mut notes = loaded.notes.clone();
    let mut leave_out = |used: &mut Vec<bool>, unwanted: &dyn Fn(usize) -> bool, why: &str| {
        let before = used.iter().filter(|u| **u).count();
        used.iter_mut().enumerate().for_each(|(i, u)| *u &= !unwanted(i));
        let dropped = before - used.iter().filter(|u| **u).count();
        if dropped > 0 {
            notes.push(format!("{dropped} measurements left out: {why}"));
        }
    };
    let flagged = protocol.measurements() - used.iter().filter(|u| **u).count();
    let driven = on_driven_electrodes(protocol);
    if !scene.reconstruction.use_driven_electrodes {
        leave_out(&mut used, &|i| driven[i], "on current-carrying electrodes");
    }
    if scene.difference_kind(protocol) == DifferenceKind::Normalised {
        leave_out(&mut used, &|i| reference[i] == 0.0, "zero in the reference frame");
    }
    if flagged > 0 {
        notes.push(format!("{flagged} measurements left out: flagged bad in some frame"));
    }
    if !used.contains(&true) {
        return Err(CliError::input(format!("no measurement is usable: {}", notes.join("; "))));
    }
    let mean = mean_over(&loaded.values, 0..loaded.values.nrows());
    let reciprocity_error = order::check(scene, protocol, &loaded, &mean, &mut notes)?;
    let rate_hz = scene.recording.frame_rate_hz.or_else(|| rate(loaded.time_s.as_deref()));
    let first = scene.recording.first_frame.unwrap_or(0);
    if first >= loaded.values.nrows() {
        let count = loaded.values.nrows();
        let message = format!("recording.first_frame is {first}, but there are {count} frames");
        return Err(CliError::input(message));
    }
    let values = loaded.values.slice_axis(Axis(0), (first..).into()).to_owned();
    Ok(Frames { values, reference, reference_source, used, rate_hz, reciprocity_error, notes })
}

fn read(scene: &Scene, protocol: &Protocol, files: &[PathBuf]) -> Result<Loaded, CliError> {
    let keys = &scene.recording;
    let mut options = ReadOptions::default();
    options.csv.complex = keys.complex;
    if keys.frames_are == Some(FramesAre::Columns) {
        options.csv.orientation = eit_hw::csv::FrameOrientation::Columns;
    }
    options.npy.matrix = keys.frames_are == Some(FramesAre::Matrix);
    if let Some(row) = keys.frequency_row {
        options.sciospec.frequency_row = row;
    }
    let scale = keys.scale.unwrap_or(1.0);
    if !scale.is_finite() || scale == 0.0 {
        let message = format!("recording.scale is {scale}: it must be finite and not zero");
        return Err(CliError::input(message));
    }
    let format = keys.format.as_deref().map(str::parse).transpose()?;
    let component = match keys.component {
        Component::Real => eit_hw::Component::Real,
        Component::Imaginary => eit_hw::Component::Imaginary,
        Component::Magnitude => eit_hw::Component::Magnitude,
        Component::Phased => eit_hw::Component::Phased,
    };
    let mut parts = Vec::new();
    let mut notes = Vec::new();
    let (mut marked_reference, mut time_s, mut ordered_by_file) = (None, None, true);
    for file in files {
        let recording = eit_hw::read_recording(file, format, &options)?;
        let count = protocol.measurements();
        let mut frames = recording.frames_for(protocol.quadruples(), count, component)?;
        if frames.unit == Unit::Ohm {
            frames.values *= drive_current_a(protocol);
        }
        frames.values *= scale;
        notes.extend(recording.notes.iter().map(|n| format!("{}: {n}", name_of(file))));
        if recording.skipped.frames > 0 {
            let first = recording.skipped.first.first().map(|s| format!(" (first: {s})"));
            let first = first.unwrap_or_default();
            let count = recording.skipped.frames;
            notes.push(format!("{}: {count} cut frames skipped{first}", name_of(file)));
        }
        if parts.is_empty() {
            marked_reference = recording.reference_frame;
            time_s = frames.device_time_s.take();
        }
        ordered_by_file &= !matches!(recording.layout, Layout::AsScene);
        parts.push(frames);
    }
    if files.len() > 1 {
        time_s = None;
    }
    let join = |e: ndarray::ShapeError| CliError::Failure(format!("joining files: {e}"));
    let values: Vec<_> = parts.iter().map(|p| p.values.view()).collect();
    let quality: Vec<_> = parts.iter().map(|p| p.quality.view()).collect();
    Ok(Loaded {
        values: concatenate(Axis(0), &values).map_err(join)?,
        quality: concatenate(Axis(0), &quality).map_err(join)?,
        marked_reference,
        time_s,
        ordered_by_file,
        notes,
    })
}

/// Whether a measurement touches an electrode that carries current, where two electrodes do.
/// Patterns that drive many electrodes at once have no other measurements.
fn on_driven_electrodes(protocol: &Protocol) -> Vec<bool> {
    let (stimulations, senses) = (protocol.stimulations_a(), protocol.measurement_patterns());
    let touches = |&[s, m]: &[u32; 2]| {
        let drive = stimulations.row(s as usize);
        let driven = drive.iter().filter(|i| **i != 0.0).count();
        driven == 2 && drive.iter().zip(senses.row(m as usize)).any(|(i, w)| *i != 0.0 && *w != 0.0)
    };
    protocol.data().iter().map(touches).collect()
}

fn name_of(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned())
}

/// Largest current of the first stimulation: what a measured impedance is multiplied by.
fn drive_current_a(protocol: &Protocol) -> f64 {
    protocol.stimulations_a().row(0).iter().fold(0.0, |m: f64, i| m.max(i.abs()))
}

fn rate(time_s: Option<&[f64]>) -> Option<f64> {
    let time_s = time_s?;
    let span = time_s.last()? - time_s.first()?;
    (span > 0.0).then(|| (time_s.len() - 1) as f64 / span)
}

/// Mean over some frames; NaN in a flagged value stays NaN and is left out by its flag.
fn mean_over(values: &Array2<f64>, frames: std::ops::Range<usize>) -> Vec<f64> {
    let count = frames.len() as f64;
    let part = values.slice_axis(Axis(0), frames.into());
    (part.sum_axis(Axis(0)) / count).to_vec()
}
