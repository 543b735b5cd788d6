//! Opens the instrument of a scene.

use crate::error::SkinError;
use crate::scene::Instrument;
#[cfg(feature = "recording")]
use crate::text::event_text;
#[cfg(feature = "recording")]
use eit_hw::Frame;
use eit_hw::HwError;
#[cfg(feature = "recording")]
use eit_hw::capture::{CaptureWriter, Recorder, ReferenceRecord, SessionRecord};
#[cfg(feature = "recording")]
use eit_hw::driver::FrameSource;
use eit_hw::driver::{Overflow, Session, SessionSettings};

/// Frames that may queue while a recorder waits for the disk: 8 s at 1000 frames per second.
const RECORDER_FRAMES: usize = 8192;
/// Frames that may queue for a consumer that may skip them: a program that pauses for a quarter of a second loses none at 100 frames
/// per second, and one that is too slow for 1000 per second is 25 ms behind.
const LATEST_FRAMES: usize = 25;

/// How far the consumer of an instrument's frames may fall behind, and what happens then.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Backlog {
    /// For a robot's loop, which acts on the present: 25 frames; then the oldest are skipped.
    Latest,
    /// For recorders and measurements, which must not lose a frame: 8 192 frames; then the session ends with
    /// [`HwError::Overflow`].
    Recorded,
}

impl Backlog {
    fn overflow(self) -> Overflow {
        match self {
            Self::Latest => Overflow::KeepLatest,
            Self::Recorded => Overflow::Fail,
        }
    }

    fn frames(self) -> usize {
        match self {
            Self::Latest => LATEST_FRAMES,
            Self::Recorded => RECORDER_FRAMES,
        }
    }
}

/// Opens the scene's instrument for a recorder and a consumer that may be slower: as [`Backlog::Latest`], but frames that are skipped
/// are in the recording.
///
/// # Errors
///
/// Those of [`open`].
#[cfg(feature = "recording")]
pub fn open_recorder(instrument: &Instrument, port: Option<&str>) -> Result<Recorder, SkinError> {
    let session = open(instrument, port, Backlog::Recorded)?;
    Ok(Recorder::new(Box::new(session), Backlog::Latest.frames(), event_text))
}

/// Opens the scene's instrument. If it does not measure the scene's protocol, the error names both.
///
/// # Errors
///
/// No scene driver of that name, a port that cannot be opened, an instrument that does not answer or
/// rejects its settings, and one that measures another protocol.
pub fn open(
    instrument: &Instrument,
    port: Option<&str>,
    backlog: Backlog,
) -> Result<Session, SkinError> {
    let endpoint = instrument.endpoint(port)?;
    let settings = SessionSettings {
        quadruples: Some(instrument.quadruples.clone()),
        capacity: backlog.frames(),
        overflow: backlog.overflow(),
        ..SessionSettings::default()
    };
    Session::open(instrument.driver()?, &endpoint, settings).map_err(|error| match error {
        HwError::MissingDrive { .. }
        | HwError::MissingMeasurement { .. }
        | HwError::MissingElectrode { .. }
        | HwError::CountMismatch { .. } => SkinError::input(format!(
            "the protocol of {} does not match what the instrument \"{}\" measures: {error}",
            instrument.place,
            instrument.driver_name()
        )),
        other => other.into(),
    })
}

/// Returns the metadata of a recording: the source's set-up, current, frequency, scene and program version.
#[cfg(feature = "recording")]
pub fn session_record(
    scene_toml: &str,
    instrument: &Instrument,
    source: &dyn FrameSource,
) -> SessionRecord {
    SessionRecord {
        current_a: Some(instrument.current_a),
        frequency_hz: (instrument.frequency_hz > 0.0).then_some(instrument.frequency_hz),
        scene_toml: scene_toml.to_owned(),
        recorder: concat!("eit ", env!("CARGO_PKG_VERSION")).to_owned(),
        ..SessionRecord::of(source.setup(), &instrument.quadruples)
    }
}

/// Returns the record of a reference of these frames; `None` of none. Frames after `until` were searched for touches, else those after
/// the reference.
#[cfg(feature = "recording")]
pub fn reference_record(frames: &[Frame], until: Option<u64>) -> Option<ReferenceRecord> {
    let first = frames.first()?;
    let mean = |i: usize| {
        let values = frames.iter().map(|frame| frame.values.get(i).copied().unwrap_or(f64::NAN));
        Some(values.sum::<f64>() / frames.len() as f64).filter(|mean| mean.is_finite())
    };
    Some(ReferenceRecord {
        epoch: first.epoch,
        values: (0..first.values.len()).map(mean).collect(),
        sequences: frames.iter().map(|frame| frame.sequence).collect(),
        until,
    })
}

/// Begins a recording in the middle of a run: writes the frames of the current reference and which they are, so that
/// a replay does not take the frames that follow for those of the untouched skin.
///
/// # Errors
///
/// A file that cannot be written.
#[cfg(feature = "recording")]
pub fn write_reference(writer: &mut CaptureWriter, frames: &[Frame]) -> Result<(), HwError> {
    frames.iter().try_for_each(|frame| writer.frame(frame))?;
    reference_record(frames, None).map_or(Ok(()), |record| writer.reference(&record))
}
