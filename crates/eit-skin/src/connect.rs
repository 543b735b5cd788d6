//! The instrument of a scene, opened.

use crate::error::SkinError;
use crate::scene::{Instrument, Scene};
use eit_hw::HwError;
use eit_hw::capture::SessionRecord;
use eit_hw::driver::Event;
use eit_hw::driver::{FrameSource, Overflow, Session, SessionSettings};

/// Frames that may wait while a recorder is busy with the disk: 8 s at 1000 frames a second.
const RECORDER_FRAMES: usize = 8192;
/// Frames that may wait for a live view, which wants the present.
const VIEWER_FRAMES: usize = 8;

/// Opens the scene's instrument. A protocol that it does not measure is told with both names.
pub fn open(
    scene: &Scene,
    instrument: &Instrument,
    port: Option<&str>,
    overflow: Overflow,
) -> Result<Session, SkinError> {
    let endpoint = instrument.endpoint(port)?;
    let capacity = match overflow {
        Overflow::Fail => RECORDER_FRAMES,
        Overflow::KeepLatest => VIEWER_FRAMES,
    };
    let settings = SessionSettings {
        quadruples: Some(instrument.quadruples.clone()),
        capacity,
        overflow,
        ..SessionSettings::default()
    };
    Session::open(instrument.driver()?, &endpoint, settings).map_err(|error| match error {
        HwError::MissingDrive { .. }
        | HwError::MissingMeasurement { .. }
        | HwError::MissingElectrode { .. }
        | HwError::CountMismatch { .. } => SkinError::input(format!(
            "the protocol of {} is not what the instrument \"{}\" measures: {error}",
            scene.place,
            instrument.driver_name()
        )),
        other => other.into(),
    })
}

/// What a recording says about itself.
pub fn session_record(
    scene: &Scene,
    instrument: &Instrument,
    source: &dyn FrameSource,
) -> Result<SessionRecord, SkinError> {
    Ok(SessionRecord {
        current_a: Some(instrument.current_a),
        frequency_hz: (instrument.frequency_hz > 0.0).then_some(instrument.frequency_hz),
        scene_toml: Scene::text(&scene.place)?,
        recorder: concat!("eit ", env!("CARGO_PKG_VERSION")).to_owned(),
        ..SessionRecord::of(source.setup(), &instrument.quadruples)
    })
}

/// An event in words; `None` for a frame.
pub fn words(event: &Event) -> Option<String> {
    Some(match event {
        Event::Frame(_) => return None,
        Event::Gap { frames } => format!("{frames} frames were lost"),
        Event::Notice(text) => text.clone(),
        Event::Stalled { for_s } => format!("no frame has come for {for_s:.1} s"),
        Event::Disconnected { reason } => format!("disconnected: {reason}"),
        Event::Reconnected { epoch } => {
            format!("connected again; epoch {epoch}: an old reference frame does not hold")
        }
        other => format!("{other:?}"),
    })
}
