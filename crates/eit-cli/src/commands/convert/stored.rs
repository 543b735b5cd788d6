//! Converts tables and recordings of other formats, which are in memory as they were read: their
//! numbers are unpacked one at a time or frame by frame.

use super::streamed::{failed, write_npy_head};
use super::whole_or_none;
use crate::error::CliError;
use eit_hw::Recording;
use eit_hw::capture::{CaptureSettings, CaptureWriter, SessionRecord};
use eit_hw::{Frame, FrameMap, HwError, Layout, Projection, Quadruple, Quality, RecordedFrame};
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

/// What a pass over the frames found.
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
        mut take: impl FnMut(&RecordedFrame) -> Result<(), E>,
    ) -> Result<(), E> {
        let (mut frames, count) = (self.recording.frames(), self.columns());
        let is_complex = self.recording.is_complex();
        let mut mapped = RecordedFrame {
            real: vec![0.0; if self.map.is_some() { count } else { 0 }],
            imaginary: is_complex.then(|| vec![0.0; if self.map.is_some() { count } else { 0 }]),
            quality: vec![Quality::GOOD; if self.map.is_some() { count } else { 0 }],
        };
        while let Some(frame) = frames.next_frame() {
            let Some(map) = &self.map else {
                take(frame)?;
                continue;
            };
            let (real, parts) = (&frame.real, frame.imaginary.as_deref());
            let RecordedFrame { real: values, imaginary, quality } = &mut mapped;
            map.apply_into(real, parts, &frame.quality, Projection::Real, values, quality)?;
            if let Some(imaginary) = imaginary {
                let part = Projection::Imaginary;
                map.apply_into(real, parts, &frame.quality, part, imaginary, quality)?;
            }
            take(&mapped)?;
        }
        Ok(())
    }

    /// Goes through all frames once.
    pub fn look(&self) -> Result<Found, HwError> {
        let mut found = Found { is_finite: Vec::new(), flagged: 0 };
        if self.map.is_none() {
            found.flagged = self.recording.flagged_count();
            let mut is_finite = vec![true; self.recording.frame_count()];
            self.each_value(|frame, value| {
                if !value.is_finite() {
                    is_finite[frame] = false;
                }
            });
            return Ok(Found { is_finite, ..found });
        }
        self.each(|frame| {
            let mut values = frame.real.iter().chain(frame.imaginary.iter().flatten());
            found.is_finite.push(values.all(|value| value.is_finite()));
            found.flagged += frame.quality.iter().filter(|quality| !quality.is_good()).count();
            Ok::<_, HwError>(())
        })?;
        Ok(found)
    }

    /// Passes each value with the number of its frame to `take`: a frame may be longer than memory
    /// allows to unpack.
    fn each_value(&self, mut take: impl FnMut(usize, f64)) {
        let count = self.recording.value_count();
        let mut pass = |values: &mut dyn Iterator<Item = f64>| {
            values.enumerate().for_each(|(index, value)| take(index / count, value));
        };
        pass(&mut self.recording.real_values());
        if let Some(mut imaginary) = self.recording.imaginary_values() {
            pass(&mut imaginary);
        }
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
        let parts = if recording.is_complex() { 2 } else { 1 };
        CaptureWriter::check_frame(parts * self.columns())
            .map_err(|error| CliError::input(format!("{}: {error}", recording.path.display())))?;
        let mut writer =
            CaptureWriter::create_copy(out, &session, CaptureSettings::default(), None)
                .map_err(|error| CliError::input(error.to_string()))?;
        let mut sequence = 0;
        let written = self.each(|frame| {
            let index = usize::try_from(sequence).ok();
            let time = || recording.device_time_s.as_ref()?.get(index?).copied();
            writer.frame(&Frame {
                values: frame.real.clone(),
                imaginary: frame.imaginary.clone(),
                quality: frame.quality.clone(),
                sequence,
                epoch: 0,
                device_time_s: time(),
                host_time_s: None,
            })?;
            sequence += 1;
            Ok::<_, CliError>(())
        });
        whole_or_none(writer, written)
    }

    /// Writes every frame whose values are all finite as a row of a table, or as two if complex.
    pub fn write_table(&self, found: &Found, out: &Path, format: &str) -> Result<(), CliError> {
        let parts = if self.recording.is_complex() { 2 } else { 1 };
        OutFile::new(out)?.write(|out| {
            if format == "npy" {
                write_npy_head(parts * found.finite(), self.columns(), out)?;
            }
            if self.map.is_none() {
                return self.write_values(found, out, format);
            }
            let mut kept = found.is_finite.iter();
            self.each(|frame| {
                if kept.next() == Some(&true) {
                    for row in std::iter::once(&frame.real).chain(&frame.imaginary) {
                        write_row(row.iter().copied(), out, format)?;
                    }
                }
                Ok::<_, ReportError>(())
            })
        })?;
        Ok(())
    }

    fn write_values(
        &self,
        found: &Found,
        out: &mut dyn Write,
        format: &str,
    ) -> Result<(), ReportError> {
        let (mut real, mut imaginary) =
            (self.recording.real_values(), self.recording.imaginary_values());
        let count = self.recording.value_count();
        for is_finite in &found.is_finite {
            let (real, imaginary) =
                (real.by_ref().take(count), imaginary.as_mut().map(|part| part.take(count)));
            if *is_finite {
                write_row(real, out, format)?;
                imaginary.map_or(Ok(()), |part| write_row(part, out, format))?;
            } else {
                real.for_each(drop);
                imaginary.into_iter().flatten().for_each(drop);
            }
        }
        Ok(())
    }
}

/// Writes a row of numbers as text or as an array has them.
fn write_row(
    row: impl Iterator<Item = f64>,
    out: &mut dyn Write,
    format: &str,
) -> Result<(), ReportError> {
    for (index, value) in row.enumerate() {
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
