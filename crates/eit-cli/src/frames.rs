//! Recorded frames and their reference, in the order of a scene's protocol.

use crate::error::CliError;
use crate::scene::{Component, DifferenceKind, FramesAre, OneOrManyFiles, Reference, Scene};
use eit_fem::{DrivenElectrodes, Order, PairPattern, PairProtocol, Protocol};
use eit_hw::{Layout, OrderVerdict, Quality, ReadOptions, Unit};
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

/// How the homogeneous model explains a reference frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ModelFit {
    /// Factor `g` of the best `v_ref = g v0`.
    pub gain: f64,
    /// Cosine between the two.
    pub correlation: f64,
}

impl Frames {
    /// Compares the reference with the model's voltages. A wrong sign inverts plain differences,
    /// and reciprocity cannot see it.
    pub fn fit_model(
        &mut self,
        model_voltages: &[f64],
        kind: DifferenceKind,
        conductivity_s: f64,
    ) -> Result<ModelFit, CliError> {
        let usable = |values: &[f64]| -> Vec<f64> {
            values.iter().zip(&self.used).filter(|(_, used)| **used).map(|(v, _)| *v).collect()
        };
        let (model, reference) = (usable(model_voltages), usable(&self.reference));
        let Some(correlation) = eit_hw::model_correlation(&reference, &model) else {
            return Err(CliError::input("the reference frame is zero in every used measurement"));
        };
        let product: f64 = model.iter().zip(&reference).map(|(m, r)| m * r).sum();
        let gain = product / model.iter().map(|m| m * m).sum::<f64>();
        let plain = kind == DifferenceKind::Plain;
        if plain && correlation < -0.5 {
            return Err(CliError::input(format!(
                "the reference frame has the opposite sign of the model (correlation \
                 {correlation:.3}): images would be inverted; set [recording] scale = -1"
            )));
        }
        if correlation.abs() < 0.9 {
            self.notes.push(format!(
                "the homogeneous model explains the reference badly (correlation \
                 {correlation:.3}): check the protocol and the number and order of electrodes"
            ));
        }
        if plain && !(0.5..=2.0).contains(&gain) {
            self.notes.push(format!(
                "voltages are {gain:.3} times the model's, so image values are off: set \
                 [skin] conductivity_s = {:.3e}, or [recording] scale",
                conductivity_s / gain
            ));
        }
        Ok(ModelFit { gain, correlation })
    }
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
        take_reference(scene, protocol, &loaded, reference)?;
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
    if crate::pipeline::difference_kind(scene, protocol) == DifferenceKind::Normalised {
        leave_out(&mut used, &|i| reference[i] == 0.0, "zero in the reference frame");
    }
    if flagged > 0 {
        notes.push(format!("{flagged} measurements left out: flagged bad in some frame"));
    }
    if !used.contains(&true) {
        return Err(CliError::input(format!("no measurement is usable: {}", notes.join("; "))));
    }
    let mean = mean_over(&loaded.values, 0..loaded.values.nrows());
    let reciprocity_error = check_order(scene, protocol, &loaded, &mean, &mut notes)?;
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

type ReferenceFrame = (Vec<f64>, String, Option<Vec<Quality>>);

fn take_reference(
    scene: &Scene,
    protocol: &Protocol,
    loaded: &Loaded,
    reference: Option<&Reference>,
) -> Result<ReferenceFrame, CliError> {
    let count = loaded.values.nrows();
    let marked = loaded.marked_reference.map(Reference::Frame);
    let Some(reference) = reference.or(scene.recording.reference.as_ref()).or(marked.as_ref())
    else {
        return Err(CliError::input(
            "no reference frame: give --reference with a frame number, \"mean\", \"N..M\" or a \
             file, or [recording] reference in the scene",
        ));
    };
    let range = match reference {
        Reference::Frame(n) => Some((*n..n.saturating_add(1), format!("frame {n}"))),
        Reference::Text(t) if t == "mean" => Some((0..count, format!("mean of {count} frames"))),
        Reference::Text(t) => match range_of(t) {
            Some(range) => Some((range, format!("mean of frames {t}"))),
            None => t.parse().ok().map(|n: usize| (n..n.saturating_add(1), format!("frame {n}"))),
        },
    };
    if let Some((range, words)) = range {
        if range.end > count || range.is_empty() {
            let message = format!("reference {words}: the recording has frames 0 to {}", count - 1);
            return Err(CliError::input(message));
        }
        return Ok((mean_over(&loaded.values, range), words, None));
    }
    let Reference::Text(file) = reference else { return Err(CliError::input("no reference")) };
    let path = scene.resolve(Path::new(file));
    let path = if path.exists() { path } else { PathBuf::from(file) };
    let other = read(scene, protocol, std::slice::from_ref(&path))?;
    let quality = other.quality.columns().into_iter();
    let quality = quality.map(|c| c.iter().fold(Quality::GOOD, |all, q| all | *q)).collect();
    let words = format!("{} ({} frames)", name_of(&path), other.values.nrows());
    Ok((mean_over(&other.values, 0..other.values.nrows()), words, Some(quality)))
}

fn range_of(text: &str) -> Option<std::ops::Range<usize>> {
    let (from, to) = text.split_once("..")?;
    Some(from.parse().ok()?..to.parse().ok()?)
}

/// Mean over some frames; NaN in a flagged value stays NaN and is left out by its flag.
fn mean_over(values: &Array2<f64>, frames: std::ops::Range<usize>) -> Vec<f64> {
    let count = frames.len() as f64;
    let part = values.slice_axis(Axis(0), frames.into());
    (part.sum_axis(Axis(0)) / count).to_vec()
}

/// Compares the order of the data with others by reciprocity; never reorders anything.
fn check_order(
    scene: &Scene,
    protocol: &Protocol,
    loaded: &Loaded,
    mean: &[f64],
    notes: &mut Vec<String>,
) -> Result<Option<f64>, CliError> {
    let Some(quadruples) = protocol.quadruples() else { return Ok(None) };
    let own = eit_hw::reciprocity_error(quadruples, mean);
    if loaded.ordered_by_file || scene.protocol.quadruples_file.is_some() {
        return Ok(own);
    }
    let alternatives = alternatives(&scene.pair_protocol(protocol.electrodes())?, mean.len());
    let named: Vec<(&str, Vec<[u32; 4]>)> =
        alternatives.iter().map(|(name, q)| (name.as_str(), q.clone())).collect();
    match eit_hw::recognise_order(mean, quadruples, &named) {
        OrderVerdict::Other { better, ours } if scene.protocol.check_order != Some(false) => {
            let best = &better[0];
            Err(CliError::input(format!(
                "the data is not in the scene's order: reciprocity error {:.0} % as the scene has \
                 it, {:.1} % with {}; set that, or [protocol] check_order = false to go on",
                100.0 * ours,
                100.0 * best.error,
                best.setting
            )))
        }
        OrderVerdict::Unclear { ours: Some(error), .. } => {
            notes.push(format!(
                "reciprocity error {:.0} %: the order of the data may be wrong, or an electrode off",
                100.0 * error
            ));
            Ok(own)
        }
        _ => Ok(own),
    }
}

/// Other pair protocols with as many measurements, by the keys that choose them.
fn alternatives(scene: &PairProtocol, count: usize) -> Vec<(String, Vec<[u32; 4]>)> {
    let drives = [
        ("adjacent", PairPattern::Adjacent),
        ("opposite", PairPattern::Opposite),
        ("skip-1", PairPattern::Skip(1)),
        ("skip-2", PairPattern::Skip(2)),
        ("skip-3", PairPattern::Skip(3)),
    ];
    let mut found = Vec::new();
    for (drive_name, drive) in &drives {
        for (order_name, order) in [("rotated", Order::Rotated), ("ascending", Order::Ascending)] {
            for (driven_name, driven) in
                [("drop", DrivenElectrodes::Drop), ("keep", DrivenElectrodes::Keep)]
            {
                let other = PairProtocol {
                    drive: drive.clone(),
                    order,
                    driven_electrodes: driven,
                    ..scene.clone()
                };
                let mut keys = Vec::new();
                if other.drive != scene.drive {
                    keys.push(format!("drive = \"{drive_name}\""));
                }
                if other.order != scene.order {
                    keys.push(format!("order = \"{order_name}\""));
                }
                if other.driven_electrodes != scene.driven_electrodes {
                    keys.push(format!("driven_electrodes = \"{driven_name}\""));
                }
                if let (false, Ok(quadruples)) = (keys.is_empty(), other.quadruples())
                    && quadruples.len() == count
                {
                    found.push((format!("[protocol] {}", keys.join(", ")), quadruples));
                }
            }
        }
    }
    found
}
