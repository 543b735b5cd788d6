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
    /// Whether a value is good, [frame, measurement].
    pub good: Array2<bool>,
    /// Measurements of the reconstruction; a frame's bad ones among them are left out of it.
    pub used: Vec<bool>,
    /// Frames a second, where known.
    pub rate_hz: Option<f64>,
    /// Reciprocity error of the mean frame, where there are reciprocal pairs.
    pub reciprocity_error: Option<f64>,
    /// What the user should know.
    pub notes: Vec<String>,
}

impl Frames {
    /// Frames whose used measurements are all good.
    pub fn clean(&self) -> Vec<usize> {
        let is_clean = |frame: &usize| {
            self.good.row(*frame).iter().zip(&self.used).all(|(good, used)| *good || !*used)
        };
        (0..self.values.nrows()).filter(is_clean).collect()
    }
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
    let loaded = read(scene, protocol, &files_of(scene, files)?)?;
    let (reference, reference_source, reference_good) =
        reference::take(scene, protocol, &loaded, reference)?;
    let mut notes = loaded.notes.clone();
    let mean = mean_over(&loaded.values, 0..loaded.values.nrows());
    let reciprocity_error = order::check(scene, protocol, &loaded, &mean, &mut notes)?;
    let reasons = reasons_to_leave_out(scene, protocol, &loaded, &reference, &reference_good);
    let used: Vec<bool> = reasons.iter().map(Option::is_none).collect();
    for why in [DRIVEN, ZERO, BAD_REFERENCE, MOSTLY_BAD] {
        let count = reasons.iter().flatten().filter(|reason| **reason == why).count();
        if count > 0 {
            notes.push(format!("{count} measurements left out: {why}"));
        }
    }
    if !used.contains(&true) {
        return Err(CliError::input(format!("no measurement is usable: {}", notes.join("; "))));
    }
    let first = scene.recording.first_frame.unwrap_or(0);
    let count = loaded.values.nrows();
    if first >= count {
        let message = format!("recording.first_frame is {first}, but there are {count} frames");
        return Err(CliError::input(message));
    }
    let rate_hz = scene.recording.frame_rate_hz.or_else(|| rate(loaded.time_s.as_deref()));
    let good = loaded.quality.mapv(|q| q.is_good());
    let from_first = |array: &Array2<f64>| array.slice_axis(Axis(0), (first..).into()).to_owned();
    Ok(Frames {
        values: from_first(&loaded.values),
        good: good.slice_axis(Axis(0), (first..).into()).to_owned(),
        reference,
        reference_source,
        used,
        rate_hz,
        reciprocity_error,
        notes,
    })
}

/// The files of the command line, else the scene's.
fn files_of(scene: &Scene, given: &[PathBuf]) -> Result<Vec<PathBuf>, CliError> {
    match (given, &scene.recording.file) {
        ([], Some(OneOrManyFiles::One(file))) => Ok(vec![scene.resolve(file)]),
        ([], Some(OneOrManyFiles::Many(files))) if files.is_empty() => {
            Err(CliError::input("recording.file is an empty list").within(&scene.place))
        }
        ([], Some(OneOrManyFiles::Many(files))) => {
            Ok(files.iter().map(|f| scene.resolve(f)).collect())
        }
        ([], None) => {
            let message = "no frames: give --frames F, or [recording] file in the scene";
            Err(CliError::input(message))
        }
        (given, _) => Ok(given.to_vec()),
    }
}

const DRIVEN: &str = "on current-carrying electrodes";
const ZERO: &str = "zero, or almost, in the reference frame";
/// What counts as almost zero, relative to the largest value of the reference frame: changes
/// divided by less are noise of any instrument (120 dB).
const ALMOST_ZERO: f64 = 1e-6;
const BAD_REFERENCE: &str = "flagged bad in the reference";
const MOSTLY_BAD: &str = "flagged bad in more than half of the frames";

/// Why each measurement is left out of all frames; `None`: it is used. One that is bad in some
/// frames only is left out of those frames.
fn reasons_to_leave_out(
    scene: &Scene,
    protocol: &Protocol,
    loaded: &Loaded,
    reference: &[f64],
    reference_good: &[bool],
) -> Vec<Option<&'static str>> {
    let driven = on_driven_electrodes(protocol);
    let normalised = scene.difference_kind(protocol) == DifferenceKind::Normalised;
    let finite = reference.iter().filter(|v| v.is_finite());
    let largest = finite.fold(0.0_f64, |m, v| m.max(v.abs()));
    let frames = loaded.quality.nrows();
    let bad = |i: usize| loaded.quality.column(i).iter().filter(|q| !q.is_good()).count();
    (0..protocol.measurements())
        .map(|i| match i {
            _ if driven[i] && !scene.reconstruction.use_driven_electrodes => Some(DRIVEN),
            _ if !reference_good[i] || !reference[i].is_finite() => Some(BAD_REFERENCE),
            _ if 2 * bad(i) > frames => Some(MOSTLY_BAD),
            _ if normalised && reference[i].abs() <= ALMOST_ZERO * largest => Some(ZERO),
            _ => None,
        })
        .collect()
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
