//! Converts recordings message by message: memory use does not grow with their length.

use crate::error::CliError;
use eit_hw::capture::{
    CaptureReader, CaptureSettings, CaptureWriter, Damage, Entry, MessageTimes, SameSetUp,
    SessionRecord,
};
use eit_hw::{Frame, FrameMap, HwError, Layout, Quadruple};
use eit_report::ReportError;
use eit_report::output::{OutFile, write_csv};
use ndarray::ArrayView2;
use std::io::Write;
use std::path::Path;

/// What the first pass over a recording found.
#[derive(Default)]
pub(super) struct Streamed {
    /// Number of frames in the recording.
    pub frames: usize,
    /// Number of values per frame.
    pub count: usize,
    pub complex: bool,
    /// Number of frames with a value that is not finite.
    pub unfinished: usize,
    pub flagged: usize,
    pub damage: Damage,
}

/// Frames of a recording, in their own order or in that of a protocol.
pub(super) struct Source<'a> {
    path: &'a Path,
    quadruples: Option<&'a [Quadruple]>,
    map: Option<FrameMap>,
}

impl<'a> Source<'a> {
    /// Reads the whole recording once, to determine its size and check that it can be converted.
    pub fn new(
        path: &'a Path,
        quadruples: Option<&'a [Quadruple]>,
    ) -> Result<(Self, Streamed), CliError> {
        let mut source = Self { path, quadruples, map: None };
        let (mut found, mut same) = (Streamed::default(), SameSetUp::new(path));
        let mut reader = CaptureReader::open(path)?;
        while let Some(entry) = reader.next_entry()? {
            same.take(&entry)?;
            if let Entry::Frame(frame) = entry {
                source.count(&mut found, frame, same.session())?;
            }
        }
        found.damage = reader.damage();
        same.check(found.damage)?;
        Ok((source, found))
    }

    fn count(
        &mut self,
        found: &mut Streamed,
        frame: Frame,
        session: Option<&SessionRecord>,
    ) -> Result<(), CliError> {
        let (count, complex) = (frame.values.len(), frame.imaginary.is_some());
        if found.frames == 0 {
            let layout = match session.map(|session| &session.quadruples) {
                Some(quadruples) if !quadruples.is_empty() => {
                    Layout::Quadruples(quadruples.clone())
                }
                _ => Layout::ProtocolOrder,
            };
            if let Some(wanted) = self.quadruples {
                let map = FrameMap::new(&layout, count, Some(wanted), wanted.len(), self.path)?;
                self.map = Some(map);
            }
            (found.count, found.complex) = (count, complex);
        }
        let frame = self.mapped(frame)?;
        found.frames += 1;
        found.unfinished += usize::from(!is_finite(&frame));
        found.flagged += frame.quality.iter().filter(|quality| !quality.is_good()).count();
        Ok(())
    }

    /// Number of values per frame as written.
    pub fn columns(&self, found: &Streamed) -> usize {
        self.map.as_ref().map_or(found.count, FrameMap::measurements)
    }

    fn mapped(&self, frame: Frame) -> Result<Frame, HwError> {
        match &self.map {
            Some(map) => map.mapped(&frame),
            None => Ok(frame),
        }
    }

    fn each<E: From<HwError>>(
        &self,
        mut take: impl FnMut(Entry, MessageTimes) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut reader = CaptureReader::open(self.path)?;
        while let Some(entry) = reader.next_entry()? {
            let entry = match entry {
                Entry::Frame(frame) => Entry::Frame(self.mapped(frame)?),
                other => other,
            };
            // every message that was read has times
            let Some(times) = reader.times() else { continue };
            take(entry, times)?;
        }
        Ok(())
    }

    /// Writes every message with its times to a new recording, with frames in protocol order.
    pub fn write_mcap(&self, out: &Path) -> Result<(), CliError> {
        let mut writer: Option<CaptureWriter> = None;
        let settings = CaptureSettings::default;
        let create = |session: &SessionRecord, times| {
            CaptureWriter::create_copy(out, session, settings(), Some(times))
                .map_err(|error| CliError::input(error.to_string()))
        };
        let written = self.each(|entry, times| {
            let entry = match entry {
                Entry::Session(session) => {
                    let quadruples =
                        self.quadruples.map_or(session.quadruples, <[Quadruple]>::to_vec);
                    Entry::Session(SessionRecord { quadruples, ..session })
                }
                other => other,
            };
            match (&mut writer, &entry) {
                (Some(writer), entry) => writer.write_at(entry, times)?,
                (None, Entry::Session(session)) => writer = Some(create(session, times)?),
                // its session was lost
                (None, entry) => {
                    let quadruples = self.quadruples.map_or_else(Vec::new, <[_]>::to_vec);
                    let session = SessionRecord { quadruples, ..SessionRecord::default() };
                    writer.insert(create(&session, times)?).write_at(entry, times)?;
                }
            }
            Ok::<_, CliError>(())
        });
        match writer {
            Some(writer) => super::whole_or_none(writer, written),
            None => written,
        }
    }

    /// Writes every frame whose values are all finite as rows of a table.
    pub fn write_table(&self, found: &Streamed, out: &Path, format: &str) -> Result<(), CliError> {
        let (columns, parts) = (self.columns(found), if found.complex { 2 } else { 1 });
        let rows = parts * (found.frames - found.unfinished);
        OutFile::new(out)?.write(|out| {
            if format == "npy" {
                write_npy_head(rows, columns, out)?;
            }
            self.each(|entry, _| {
                let Entry::Frame(frame) = entry else { return Ok(()) };
                if !is_finite(&frame) {
                    return Ok(());
                }
                for row in std::iter::once(&frame.values).chain(&frame.imaginary) {
                    match format {
                        "npy" => {
                            let bytes: Vec<u8> = row.iter().flat_map(|v| v.to_le_bytes()).collect();
                            out.write_all(&bytes).map_err(failed)?;
                        }
                        _ => {
                            let row =
                                ArrayView2::from_shape((1, row.len()), row).map_err(failed)?;
                            write_csv(row, out)?;
                        }
                    }
                }
                Ok::<_, ReportError>(())
            })
        })?;
        Ok(())
    }
}

pub(super) fn failed(error: impl std::fmt::Display) -> ReportError {
    ReportError::Failure(format!("writing failed: {error}"))
}

fn is_finite(frame: &Frame) -> bool {
    let parts = frame.imaginary.iter().flatten();
    frame.values.iter().chain(parts).all(|value| value.is_finite())
}

/// Writes the header of an array [row, column] of numbers, version 1.0 (NumPy enhancement proposal 1).
pub(super) fn write_npy_head(
    rows: usize,
    columns: usize,
    out: &mut dyn Write,
) -> Result<(), ReportError> {
    const MARK_BYTES: usize = 10;
    let mut head =
        format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({rows}, {columns})}}");
    // the data start at a multiple of 64 bytes
    let length = (MARK_BYTES + head.len() + 1).next_multiple_of(64) - MARK_BYTES;
    head = format!("{head:<width$}\n", width = length - 1);
    let length = u16::try_from(head.len()).map_err(failed)?.to_le_bytes();
    for bytes in [b"\x93NUMPY\x01\x00", &length[..], head.as_bytes()] {
        out.write_all(bytes).map_err(failed)?;
    }
    Ok(())
}
