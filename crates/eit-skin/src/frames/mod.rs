//! Recorded frames and their reference, in the order of a scene's protocol.

mod fit;
mod load;
mod order;
mod quiet;
mod reference;
pub(crate) mod steady;
mod unused;

pub use fit::ModelFit;
pub(crate) use fit::{ALIKE, are_magnitudes};
pub(crate) use load::of_frames;
pub use quiet::QuietFrames;
pub(crate) use reference::left_out;

use load::{Loaded, drive_current_a, of_recording, of_values, read};
use unused::Unused;

use crate::error::SkinError;
use crate::faults::ElectrodeFault;
use crate::scene::{DifferenceKind, Reference, Scene};
use crate::skin::Skin;
use eit_fem::Protocol;
use eit_hw::{MeasuredFrames, Quality, Recording};
use ndarray::{Array2, ArrayView2, Axis, Slice};
use std::path::PathBuf;

/// Frames that are ready for reconstruction.
#[derive(Debug, Clone)]
pub struct Frames {
    /// [frame, measurement], volt (or the instrument's unit if it states none).
    pub values: Array2<f64>,
    /// The reference frame, which is subtracted.
    pub reference: Vec<f64>,
    /// Source of the reference, in words.
    pub reference_source: String,
    /// Number of frames averaged into the reference.
    pub reference_frames: usize,
    /// Frames of the untouched skin for measuring the noise, if there are any.
    pub quiet: Option<QuietFrames>,
    /// Whether each value is good, [frame, measurement].
    pub good: Array2<bool>,
    /// Electrodes that float while the reference is taken; their measurements are not used.
    pub faults: Vec<ElectrodeFault>,
    /// Measurements used for the reconstruction; those that are bad in a frame are excluded from that frame.
    pub used: Vec<bool>,
    /// Frames per second, if known.
    pub rate_hz: Option<f64>,
    /// Reciprocity error of the mean frame, if there are reciprocal pairs.
    pub reciprocity_error: Option<f64>,
    /// Notes for the user.
    pub notes: Vec<String>,
}

/// Where frames come from.
#[derive(Debug, Clone, Copy)]
pub enum FramesInput<'a> {
    /// Files; those of the settings if there are none.
    Files(&'a [PathBuf]),
    /// A recording in memory.
    Recording(&'a Recording),
    /// Values [frame, measurement], volt, in protocol order.
    Values(ArrayView2<'a, f64>),
}

/// The reference of frames.
#[derive(Debug, Clone, Copy)]
pub enum ReferenceInput<'a> {
    /// That of the settings, else the one that the recording marks.
    Settings,
    /// Frames of the recording, or a file.
    Named(&'a Reference),
    /// Frames of the untouched skin [frame, measurement], volt, in protocol order.
    Values(ArrayView2<'a, f64>),
}

impl Frames {
    /// Returns the frames whose used measurements are all good.
    pub(crate) fn clean(&self) -> Vec<usize> {
        let is_clean = |frame: &usize| {
            self.good.row(*frame).iter().zip(&self.used).all(|(good, used)| *good || !*used)
        };
        (0..self.values.nrows()).filter(is_clean).collect()
    }

    /// Gives a reference whose used values are magnitudes the signs of the model's voltages; returns whether that changed it.
    pub fn with_signs_of(&mut self, model_voltages: &[f64]) -> bool {
        let used = || {
            self.used
                .iter()
                .zip(self.reference.iter().zip(model_voltages))
                .filter(|(used, _)| **used)
        };
        let is_other = are_magnitudes(used().map(|(_, (value, _))| value))
            && !are_magnitudes(used().map(|(_, (_, model))| model));
        if is_other {
            let both = self.reference.iter_mut().zip(model_voltages);
            both.for_each(|(value, model)| *value = value.copysign(*model));
        }
        is_other
    }

    /// Returns difference data [frame, measurement], zero where a value is not used: in volt, or relative to
    /// the reference.
    pub fn differences(&self, kind: DifferenceKind) -> Array2<f64> {
        let mut differences = self.values.clone();
        for ((frame, i), value) in differences.indexed_iter_mut() {
            *value = match self.used[i] && self.good[[frame, i]] {
                true => kind.difference(*value, self.reference[i]),
                false => 0.0,
            };
        }
        differences
    }
}

impl Scene {
    /// Checks whether values of a file are in the order of this scene's protocol, by the reciprocity and levels of their mean over
    /// frames; returns notes. The skin is only built if reciprocity leaves doubt, and a scene without a real model is not checked.
    ///
    /// # Errors
    ///
    /// Another order.
    pub fn check_order(&self, protocol: &Protocol, mean: &[f64]) -> Result<Vec<String>, SkinError> {
        let kind = self.recording.values;
        let voltages: Vec<f64> = mean.iter().map(|value| kind.voltage(*value)).collect();
        let mut notes = Vec::new();
        let is_clear = |q: &[_]| order::is_consistent(q, &voltages);
        if !protocol.quadruples().is_some_and(is_clear)
            && let Ok(skin) = Skin::from_scene(self.clone())
        {
            order::check(&skin, false, &voltages, &mut notes)?;
        }
        Ok(notes)
    }
}

impl Skin {
    /// Reads the frames of the settings; `files` and `reference` of the caller take precedence.
    ///
    /// # Errors
    ///
    /// Files that cannot be read; a wrong number or order of measurements; no reference.
    pub fn read_frames(
        &self,
        files: &[PathBuf],
        reference: Option<&Reference>,
    ) -> Result<Frames, SkinError> {
        let reference = reference.map_or(ReferenceInput::Settings, ReferenceInput::Named);
        self.frames(FramesInput::Files(files), reference)
    }

    /// Takes values [frame, measurement], volt, in protocol order, as if read from a recording.
    ///
    /// # Errors
    ///
    /// Another number of measurements; no reference, or one beyond the values.
    pub fn frames_of_values(&self, values: &Array2<f64>) -> Result<Frames, SkinError> {
        self.frames(FramesInput::Values(values.view()), ReferenceInput::Settings)
    }

    /// Takes frames from files or from memory, and their reference.
    ///
    /// ```
    /// use eit_skin::frames::{FramesInput, ReferenceInput};
    /// use eit_skin::{Scene, Skin};
    ///
    /// let skin = Skin::from_scene(Scene::load("paper-disc")?)?;
    /// let rest = skin.model.forward(&skin.background_s())?.insert_axis(ndarray::Axis(0));
    /// let values = FramesInput::Values(rest.view());
    /// let frames = skin.frames(values, ReferenceInput::Values(rest.view()))?;
    /// assert_eq!(frames.reference, rest.row(0).to_vec());
    /// # Ok::<(), eit_skin::SkinError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// The errors of [`Skin::read_frames`] and [`Skin::frames_of_values`].
    pub fn frames(
        &self,
        from: FramesInput<'_>,
        reference: ReferenceInput<'_>,
    ) -> Result<Frames, SkinError> {
        let loaded = match from {
            FramesInput::Files(files) => read(self, &self.files(files)?)?,
            FramesInput::Recording(recording) => of_recording(self, recording)?,
            FramesInput::Values(values) => Loaded {
                frames: self.measured(values)?,
                marked_reference: None,
                ordered_by_file: false,
                notes: Vec::new(),
            },
        };
        let found = match reference {
            ReferenceInput::Settings => reference::choose(self, &loaded, None)?,
            ReferenceInput::Named(reference) => reference::choose(self, &loaded, Some(reference))?,
            ReferenceInput::Values(values) => {
                reference::of_others(self.measured(values)?, "the given reference")
            }
        };
        assemble(self, loaded, found)
    }

    /// Values of the caller with their flags.
    fn measured(&self, values: ArrayView2<'_, f64>) -> Result<MeasuredFrames, SkinError> {
        let measurements = self.protocol.measurements();
        SkinError::check_measurements("a frame", values.ncols(), measurements)?;
        if values.is_empty() {
            return Err(SkinError::argument("frames", "there are none"));
        }
        let quality = values.mapv(|value| match value.is_finite() {
            true => Quality::GOOD,
            false => Quality::NON_FINITE,
        });
        Ok(of_values(values.to_owned(), quality, eit_hw::Unit::Arbitrary))
    }

    /// Takes an instrument's frames of the untouched skin; their mean is the reference.
    ///
    /// # Errors
    ///
    /// No usable measurement; data in another order than the protocol's.
    pub(crate) fn frames_of_quiet(&self, mut frames: MeasuredFrames) -> Result<Frames, SkinError> {
        frames.to_volts(drive_current_a(&self.protocol));
        self.settings.recording.convert(&mut frames);
        let found = reference::of_quiet(&frames);
        let (marked_reference, ordered_by_file, notes) = (None, false, Vec::new());
        assemble(self, Loaded { frames, marked_reference, ordered_by_file, notes }, found)
    }

    /// Returns the factor that converts a live instrument's values to those of [`Skin::frames_of_quiet`].
    pub(crate) fn live_factor(&self, unit: eit_hw::Unit) -> f64 {
        let volts = match unit {
            eit_hw::Unit::Ohm => drive_current_a(&self.protocol),
            eit_hw::Unit::Volt | eit_hw::Unit::Arbitrary => 1.0,
        };
        volts * self.settings.recording.factor()
    }

    /// The caller's files, else those of the settings.
    fn files(&self, given: &[PathBuf]) -> Result<Vec<PathBuf>, SkinError> {
        match (given, self.settings.recording.files()) {
            ([], Some([])) => {
                Err(SkinError::input("recording.file is an empty list").within(&self.place))
            }
            ([], Some(files)) => Ok(files.to_vec()),
            ([], None) => {
                let problem = "no frames: give their files, or set [recording] file in the scene";
                Err(SkinError::argument("frames", problem))
            }
            (given, _) => Ok(given.to_vec()),
        }
    }
}

/// Puts frames and their reference together: which measurements are used, and what is odd about them.
fn assemble(
    skin: &Skin,
    mut loaded: Loaded,
    found: reference::ReferenceFrame,
) -> Result<Frames, SkinError> {
    let mut notes = std::mem::take(&mut loaded.notes);
    let count = loaded.frames.values.nrows();
    let mean = loaded.frames.mean_frame();
    let reciprocity_error = order::check(skin, loaded.ordered_by_file, &mean, &mut notes)?;
    let reasons = unused::reasons(skin, &loaded, &found);
    let mut used: Vec<bool> = reasons.iter().map(Option::is_none).collect();
    notes.extend(Unused::notes(&reasons));
    notes.extend(doubts(&loaded.frames, &found, &used));
    let quiet = quiet::find(skin, &loaded.frames, &found, &used, &mut notes)?;
    let mut faults = unused::leave_out_lost(skin, &reasons, &found.values, &mut used);
    faults.extend(unused::leave_out_floating(skin, &found.values, quiet.as_ref(), &mut used)?);
    let note = |ElectrodeFault { electrode, kind, .. }: &ElectrodeFault| {
        format!("electrode {} {}", electrode + 1, kind.description())
    };
    notes.extend(faults.iter().map(note));
    unused::check_any(&reasons, &used, &notes)?;
    let keys = &skin.settings.recording;
    let first = keys.first_frame.unwrap_or(0);
    if first >= count {
        let message = format!("recording.first_frame is {first}, but there are {count} frames");
        return Err(SkinError::input(message));
    }
    let rate_hz = keys.frame_rate_hz.or_else(|| rate(loaded.frames.device_time_s.as_deref()));
    let good = loaded.frames.quality.mapv(|q| q.is_good());
    let from_first = Slice::from(first..);
    Ok(Frames {
        values: loaded.frames.values.slice_axis(Axis(0), from_first).to_owned(),
        good: good.slice_axis(Axis(0), from_first).to_owned(),
        reference_frames: found.frames.values.nrows(),
        reference: found.values,
        reference_source: found.source,
        quiet,
        faults,
        used,
        rate_hz,
        reciprocity_error,
        notes,
    })
}

/// What is odd about frames and their reference, in words.
fn doubts(
    frames: &MeasuredFrames,
    found: &reference::ReferenceFrame,
    used: &[bool],
) -> impl Iterator<Item = String> {
    let equal = frames.are_equal().then(|| {
        format!(
            "all {} frames are equal to the last digit: the instrument repeats an old frame, or its converter is \
             too coarse to show its noise",
            frames.values.nrows()
        )
    });
    let left_out = (found.left_out > 0).then(|| reference::left_out(found.left_out));
    let reference::FlaggedValues { values, quality } = &found.frames;
    let is_good = |f: usize, i: usize| used[i] && quality[(f, i)].is_good();
    let unrest = (!found.touched).then(|| steady::unrest(values.view(), is_good)).flatten();
    equal.into_iter().chain(left_out).chain(unrest.map(steady::description))
}

/// Whether each measurement involves a current-carrying electrode, for patterns that drive two. With patterns
/// that drive many electrodes at once there are no other measurements.
pub(crate) fn on_driven_electrodes(protocol: &Protocol) -> Vec<bool> {
    let (stimulations, senses) = (protocol.stimulations_a(), protocol.measurement_patterns());
    let touches = |&[s, m]: &[u32; 2]| {
        let drive = stimulations.row(s as usize);
        let driven = drive.iter().filter(|i| **i != 0.0).count();
        driven == 2 && drive.iter().zip(senses.row(m as usize)).any(|(i, w)| *i != 0.0 && *w != 0.0)
    };
    protocol.data().iter().map(touches).collect()
}

/// Whether a protocol has measurements on current-carrying electrodes that could also be left out
/// (`reconstruction.use_driven_electrodes`).
pub fn has_driven_electrodes(protocol: &Protocol) -> bool {
    on_driven_electrodes(protocol).contains(&true)
}

fn rate(time_s: Option<&[f64]>) -> Option<f64> {
    let time_s = time_s?;
    let span = time_s.last()? - time_s.first()?;
    (span > 0.0).then(|| (time_s.len() - 1) as f64 / span)
}
