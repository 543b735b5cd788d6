//! Converts tables and recordings of other formats, which are in memory as they were read.

use super::streamed::{failed, write_npy_head};
use super::whole_or_none;
use crate::error::CliError;
use eit_hw::Recording;
use eit_hw::capture::{CaptureSettings, CaptureWriter, SessionRecord};
use eit_hw::{Frame, FrameMap, HwError, Layout, Quadruple};
use eit_report::ReportError;
use eit_report::output::OutFile;
use eit_skin::scene::Scene;
use std::io::Write;
use std::path::Path;

/// Frames of a recording, in their own order or in that of a protocol.
pub(super) struct Stored<'a> {
    recording: &'a Recording,
    map: Option<FrameMap>,
    /// Electrodes of each value; empty if not named.
    quadruples: Vec<Quadruple>,
}

/// Result of a pass over the frames.
pub(super) struct Found {
    /// Whether all values of a frame are finite, for each frame.
    pub is_finite: Vec<bool>,
    /// Number of values that are not good.
    pub flagged: usize,
}

impl Found {
    /// Returns the number of frames that a table can hold.
    pub fn finite(&self) -> usize {
        self.is_finite.iter().filter(|is_finite| **is_finite).count()
    }
}

impl<'a> Stored<'a> {
    pub fn new(recording: &'a Recording, scene: Option<&Scene>) -> Result<Self, CliError> {
        let Some(scene) = scene else {
            let quadruples = match &recording.layout {
                Layout::Quadruples(quadruples) => quadruples.clone(),
                Layout::ProtocolOrder => Vec::new(),
                Layout::Potentials { .. } => {
                    return Err(CliError::input(format!(
                        "{}: contains electrode potentials: give --scene, whose protocol defines \
                         the differences",
                        recording.path.display()
                    )));
                }
            };
            return Ok(Self { recording, map: None, quadruples });
        };
        let protocol = scene.protocol(scene.electrode_count()?)?;
        let map = recording.map_for(protocol.quadruples(), protocol.measurements())?;
        let quadruples = protocol.quadruples().map_or_else(Vec::new, <[_]>::to_vec);
        Ok(Self { recording, map: Some(map), quadruples })
    }

    /// Number of values per frame as written.
    pub fn columns(&self) -> usize {
        self.map.as_ref().map_or(self.recording.value_count(), FrameMap::measurements)
    }

    /// Passes each frame to `take`, in the order of the protocol if there is one.
    fn each<E: From<HwError>>(
        &self,
        mut take: impl FnMut(&Frame) -> Result<(), E>,
    ) -> Result<(), E> {
        self.recording.frames().try_for_each(|frame| match &self.map {
            Some(map) => take(&map.mapped(&frame)?),
            None => take(&frame),
        })
    }

    /// Goes through all frames once.
    pub fn look(&self) -> Result<Found, HwError> {
        let mut found = Found { is_finite: Vec::new(), flagged: 0 };
        self.each(|frame| {
            let mut values = frame.values.iter().chain(frame.imaginary.iter().flatten());
            found.is_finite.push(values.all(|value| value.is_finite()));
            found.flagged += frame.quality.iter().filter(|quality| !quality.is_good()).count();
            Ok::<_, HwError>(())
        })?;
        Ok(found)
    }

    /// Writes every frame to a new recording.
    pub fn write_mcap(&self, out: &Path) -> Result<(), CliError> {
        let recording = self.recording;
        let session = SessionRecord {
            driver: "file".into(),
            instrument: recording.format.to_string(),
            unit: recording.unit.into(),
            quadruples: self.quadruples.clone(),
            current_a: recording.current_a,
            frequency_hz: recording.frequency_hz,
            recorder: concat!("eit ", env!("CARGO_PKG_VERSION")).to_owned(),
            ..SessionRecord::default()
        };
        let parts = if recording.imaginary.is_some() { 2 } else { 1 };
        CaptureWriter::check_frame(parts * self.columns())
            .map_err(|error| CliError::input(format!("{}: {error}", recording.path.display())))?;
        let mut writer =
            CaptureWriter::create_copy(out, &session, CaptureSettings::default(), None)
                .map_err(|error| CliError::input(error.to_string()))?;
        let written = self.each(|frame| Ok::<_, CliError>(writer.frame(frame)?));
        whole_or_none(writer, written)
    }

    /// Writes every frame whose values are all finite as a row of a table, or as two if complex.
    pub fn write_table(&self, found: &Found, out: &Path, format: &str) -> Result<(), CliError> {
        let parts = if self.recording.imaginary.is_some() { 2 } else { 1 };
        OutFile::new(out)?.write(|out| {
            if format == "npy" {
                write_npy_head(parts * found.finite(), self.columns(), out)?;
            }
            let mut kept = found.is_finite.iter();
            self.each(|frame| {
                if kept.next() == Some(&true) {
                    for row in std::iter::once(&frame.values).chain(&frame.imaginary) {
                        write_row(row, out, format)?;
                    }
                }
                Ok::<_, ReportError>(())
            })
        })?;
        Ok(())
    }
}

/// Writes a row of numbers as text or as an array has them.
fn write_row(row: &[f64], out: &mut dyn Write, format: &str) -> Result<(), ReportError> {
    for (index, value) in row.iter().enumerate() {
        match (format, index) {
            ("npy", _) => out.write_all(&value.to_le_bytes()),
            (_, 0) => write!(out, "{value:e}"),
            _ => write!(out, ",{value:e}"),
        }
        .map_err(failed)?;
    }
    match format {
        "npy" => Ok(()),
        _ => writeln!(out).map_err(failed),
    }
}
