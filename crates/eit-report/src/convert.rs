//! Recordings to and from tables of numbers, and what is intact of a damaged recording.
//!
//! Recordings are read message by message: memory use does not grow with their length. Tables and recordings of
//! other formats are in memory.

mod recovered;

use crate::Answer;
use crate::error::ReportError;
use crate::output::{self, OutFile, ending, io, npy_header};
use crate::settings::ConvertSettings;
use eit_fem::Protocol;
use eit_hw::capture::{
    self, CaptureReader, CaptureSettings, CaptureWriter, Damage, Entry, MessageTimes, PartFile,
    SameSetUp, SessionRecord,
};
use eit_hw::{Frame, FrameMap, HwError, Layout, Quadruple, Recording};
use eit_skin::recording::{session_of, times_of};
use eit_skin::scene::Scene;
use eit_skin::text::counted;
use serde_json::json;
use std::cell::OnceCell;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Reads any recording and writes it in the format of the file name extension: mcap, csv or npy.
///
/// # Errors
///
/// A file that cannot be read or is not what the scene says, and one that cannot be written.
pub fn run(settings: &ConvertSettings) -> Result<Answer, ReportError> {
    let format = ending(&settings.out);
    let is_recording = format == "mcap";
    if is_recording {
        capture::check_new(&settings.out)?;
        output::remember(PartFile::part_of(&settings.out));
    }
    if settings.recover {
        return recovered::run(settings);
    }
    let [one, other] = [&settings.input, &settings.out].map(|path| path.canonicalize());
    if matches!((one, other), (Ok(one), Ok(other)) if one == other) {
        let message = "is the file to convert, and would be lost: name another file";
        return Err(ReportError::input(format!("{}: {message}", settings.out.display())));
    }
    let source = Source::new(settings)?;
    let Counts { frames, columns, is_complex, not_finite, flagged } = source.counts;
    let mut notes = source.notes.clone();
    let lost = if is_recording { 0 } else { not_finite };
    if is_recording {
        source.write_recording(&settings.out)?;
    } else {
        source.write_table(&settings.out, &format)?;
        // what a table cannot hold
        if flagged > 0 {
            let values = counted(flagged, "flagged value", "flagged values");
            notes.push(format!("{values}: a table has no flags"));
        }
        if lost > 0 {
            let frames = counted(lost, "frame", "frames");
            notes.push(format!("{frames} skipped: a value is not finite"));
        }
        if is_complex {
            let note = "rows of real and imaginary parts alternate: read it with [recording] complex = true";
            notes.push(note.to_owned());
        }
    }
    let (written, out) = (frames - lost, settings.out.display());
    let mut text = format!("{} of {columns} values in {out}", counted(written, "frame", "frames"));
    for note in &notes {
        text += &format!("\nnote: {note}");
    }
    let json = json!({
        "file": out.to_string(),
        "frames": written,
        "values": columns,
        "complex": is_complex,
        "flagged_values": flagged,
        "skipped_frames": source.cut + lost,
        "notes": notes,
    });
    Ok(Answer { text, json })
}

/// Frames of a recording or table, in their own order or in that of a scene's protocol.
#[derive(Default)]
struct Source {
    path: PathBuf,
    /// A table, or a recording of another format; `None` for a recording that is read message by message.
    stored: Option<(Recording, SessionRecord)>,
    /// Measurements of the scene, and where they are in the file once that is known.
    quadruples: Option<Vec<Quadruple>>,
    map: OnceCell<FrameMap>,
    counts: Counts,
    /// Frames per second of a table without times, if the scene states it.
    rate_hz: Option<f64>,
    /// Number of incomplete frames that the reader skipped.
    cut: usize,
    notes: Vec<String>,
}

/// What the first pass over the frames found.
#[derive(Clone, Copy, Default)]
struct Counts {
    frames: usize,
    /// Number of values per frame as written.
    columns: usize,
    is_complex: bool,
    /// Number of frames with a value that is not finite.
    not_finite: usize,
    /// Number of values that are not good.
    flagged: usize,
}

impl Counts {
    fn add(&mut self, entry: &Entry) {
        let Entry::Frame(frame) = entry else { return };
        self.frames += 1;
        (self.columns, self.is_complex) = (frame.values.len(), frame.imaginary.is_some());
        self.not_finite += usize::from(!is_finite(frame));
        self.flagged += frame.quality.iter().filter(|quality| !quality.is_good()).count();
    }
}

impl Source {
    /// Reads everything once, to count the frames and check that they can be converted.
    fn new(settings: &ConvertSettings) -> Result<Self, ReportError> {
        let scene = settings.scene.as_deref().map(Scene::load).transpose()?;
        let of_scene = |scene: &Scene| scene.protocol(scene.electrode_count()?);
        let protocol = scene.as_ref().map(of_scene).transpose()?;
        let quadruples = protocol.as_ref().and_then(|protocol| protocol.quadruples());
        let mut source = Self {
            path: settings.input.clone(),
            quadruples: quadruples.map(<[_]>::to_vec),
            ..Self::default()
        };
        if settings.input.is_dir() || !capture::is_recording(&settings.input)? {
            source.read_table(settings, scene.as_ref(), protocol.as_ref())?;
        } else if settings.complex {
            let message = "--complex is for tables, but this is a recording; leave it out";
            return Err(ReportError::input(format!("{}: {message}", settings.input.display())));
        } else if protocol.is_some() && quadruples.is_none() {
            let message =
                "[protocol] has general current patterns, which recordings do not support";
            return Err(ReportError::input(message));
        }
        let mut counts = Counts::default();
        let damage = source.each(|entry, _| {
            counts.add(&entry);
            Ok::<_, ReportError>(())
        })?;
        source.counts = counts;
        source.notes.extend(damage.note().map(|note| note.to_string()));
        Ok(source)
    }

    /// Reads a table or a recording of another format. The scene says how tables are arranged, as for
    /// `eit reconstruct`.
    fn read_table(
        &mut self,
        settings: &ConvertSettings,
        scene: Option<&Scene>,
        protocol: Option<&Protocol>,
    ) -> Result<(), ReportError> {
        let stated = scene.map(|scene| scene.stage_settings().recording.reading()).transpose()?;
        let (format, mut options) = stated.unwrap_or_default();
        let settings_of = scene.map(|scene| scene.stage_settings().recording);
        self.rate_hz = settings_of.and_then(|keys| keys.frame_rate_hz);
        options.complex |= settings.complex;
        let layout = scene.zip(protocol).map(|(scene, protocol)| scene.frame_layout(protocol));
        let count = layout.as_ref().and_then(Layout::value_count);
        options.measurements = count.or(protocol.map(Protocol::measurements));
        let mut table = eit_hw::read_recording(&settings.input, format, &options)?;
        if let (Some(layout), Some(protocol)) = (&layout, protocol) {
            table = table.arranged_for(layout, protocol.quadruples(), protocol.measurements());
        }
        if let (None, Layout::Potentials { .. }) = (protocol, &table.layout) {
            return Err(ReportError::input(format!(
                "{}: contains electrode potentials: give --scene, whose protocol defines the differences",
                settings.input.display()
            )));
        }
        if let (Some(scene), Some(protocol), Layout::ProtocolOrder) =
            (scene, protocol, &table.layout)
            && table.value_count() == protocol.measurements()
        {
            // once converted, its values have the names of the scene's electrodes
            let mean = table.real.columns().into_iter().map(|column| {
                let known = || column.iter().filter(|value| value.is_finite());
                // 0 / 0 where none is known
                known().sum::<f64>() / known().count() as f64
            });
            self.notes.extend(scene.check_order(protocol, &mean.collect::<Vec<_>>())?);
        }
        if let Some(protocol) = protocol {
            let map = table.map_for(protocol.quadruples(), protocol.measurements())?;
            self.map = OnceCell::from(map);
        }
        self.notes.extend(table.notes.iter().map(ToString::to_string));
        self.cut = table.skipped.frames;
        if self.cut > 0 {
            self.notes.push(table.skipped.to_string());
        }
        let session = session_of(&table);
        self.stored = Some((table, session));
        Ok(())
    }

    /// Passes every message to `take`, for the scene's protocol, with its times if it has some. Returns the damage of a
    /// recording.
    fn each<E: From<HwError>>(
        &self,
        mut take: impl FnMut(Entry, Option<MessageTimes>) -> Result<(), E>,
    ) -> Result<Damage, E> {
        let mut same = SameSetUp::new(&self.path);
        let Some((table, session)) = &self.stored else {
            let mut reader = CaptureReader::open(&self.path)?;
            while let Some(entry) = reader.next_entry()? {
                same.take(&entry)?;
                take(self.converted(entry, &same)?, reader.times())?;
            }
            same.check(reader.damage())?;
            return Ok(reader.damage());
        };
        take(self.converted(Entry::Session(session.clone()), &same)?, Some(MessageTimes::at(0)))?;
        for frame in table.frames() {
            let times = times_of(&frame, self.rate_hz);
            take(self.converted(Entry::Frame(frame), &same)?, Some(times))?;
        }
        Ok(Damage::default())
    }

    /// A message for the scene's protocol, after those that `same` has seen.
    fn converted(&self, entry: Entry, same: &SameSetUp) -> Result<Entry, HwError> {
        let (frame, wanted) = match (entry, &self.quadruples) {
            (Entry::Session(session), Some(quadruples)) => {
                return Ok(Entry::Session(SessionRecord {
                    quadruples: quadruples.clone(),
                    ..session
                }));
            }
            (Entry::Frame(frame), wanted) => (frame, wanted),
            (other, _) => return Ok(other),
        };
        if let (None, Some(wanted)) = (self.map.get(), wanted) {
            let layout = match same.session().map(|session| &session.quadruples) {
                Some(own) if !own.is_empty() => Layout::Quadruples(own.clone()),
                _ => Layout::ProtocolOrder,
            };
            let count = frame.values.len();
            let map = FrameMap::new(&layout, count, Some(wanted), wanted.len(), &self.path)?;
            self.map.get_or_init(|| map);
        }
        Ok(Entry::Frame(match self.map.get() {
            Some(map) => map.mapped(&frame)?,
            None => frame,
        }))
    }

    /// Writes every message with its times to a new recording. If writing fails, none has its name.
    fn write_recording(&self, out: &Path) -> Result<(), ReportError> {
        let Counts { columns, is_complex, .. } = self.counts;
        CaptureWriter::check_frame(if is_complex { 2 * columns } else { columns })
            .map_err(|error| ReportError::input(format!("{}: {error}", self.path.display())))?;
        let mut writer: Option<CaptureWriter> = None;
        let create = |session: &SessionRecord, times| {
            CaptureWriter::create_copy(out, session, CaptureSettings::default(), times)
                .map_err(|error| ReportError::input(error.to_string()))
        };
        self.each(|entry, times| {
            let writer = match (&mut writer, &entry) {
                (Some(writer), _) => writer,
                (none, Entry::Session(session)) => {
                    *none = Some(create(session, times)?);
                    return Ok(());
                }
                // its session was lost
                (none, _) => {
                    let quadruples = self.quadruples.clone().unwrap_or_default();
                    let session = SessionRecord { quadruples, ..SessionRecord::default() };
                    none.insert(create(&session, times)?)
                }
            };
            match times {
                Some(times) => writer.write_at(&entry, times)?,
                None => writer.write(&entry)?,
            }
            Ok::<_, ReportError>(())
        })?;
        Ok(writer.map_or(Ok(()), CaptureWriter::finish)?)
    }

    /// Writes every frame whose values are all finite as a row of a table, or as two if complex.
    fn write_table(&self, out: &Path, format: &str) -> Result<(), ReportError> {
        let Counts { frames, columns, is_complex, not_finite, .. } = self.counts;
        let rows = (frames - not_finite) * if is_complex { 2 } else { 1 };
        OutFile::new(out)?.write(|out| {
            if format == "npy" {
                out.write_all(&npy_header(&[rows, columns])).map_err(io)?;
            }
            self.each(|entry, _| match entry {
                Entry::Frame(frame) if is_finite(&frame) => {
                    let mut rows = std::iter::once(&frame.values).chain(&frame.imaginary);
                    rows.try_for_each(|row| write_row(row, out, format).map_err(io))
                }
                _ => Ok::<_, ReportError>(()),
            })
            .map(|_damage| ())
        })?;
        Ok(())
    }
}

fn is_finite(frame: &Frame) -> bool {
    let parts = frame.imaginary.iter().flatten();
    frame.values.iter().chain(parts).all(|value| value.is_finite())
}

/// Writes a row of numbers as text, in the shortest form that reads back exactly, or as an array has them.
fn write_row(row: &[f64], out: &mut dyn Write, format: &str) -> std::io::Result<()> {
    for (index, value) in row.iter().enumerate() {
        match (format, index) {
            ("npy", _) => out.write_all(&value.to_le_bytes())?,
            (_, 0) => write!(out, "{value:e}")?,
            _ => write!(out, ",{value:e}")?,
        }
    }
    if format == "npy" { Ok(()) } else { writeln!(out) }
}
