//! `eit replay`: plays a recording as if it were live.

use super::viewer::Viewer;
use super::{Answer, publish};
use crate::cli::ReplayArgs;
use crate::error::CliError;
use crate::progress;
use eit_hw::Frame;
use eit_hw::HwError;
use eit_hw::capture;
use eit_hw::driver::{Event, FrameSource, Pace, Replay, Setup, Statistics};
use eit_report::output::ending;
use eit_report::simulated::pasted;
use eit_report::watched::answer;
use eit_skin::live::{LiveModel, REFERENCE_FRAMES};
use eit_skin::scene::{Reference, Scene};
use std::sync::Arc;
use std::time::Duration;

/// Watches until the end of the recording, Ctrl-C or enough frames.
pub(crate) fn run(args: &ReplayArgs, is_json: bool) -> Result<Answer, CliError> {
    super::check_watch(&args.watch)?;
    if let Some(speed) = args.speed.filter(|speed| !(speed.is_finite() && *speed > 0.0)) {
        return Err(CliError::input(format!("--speed is {speed}: it must be above 0")));
    }
    check_recording(args)?;
    let publisher = publish::open(&args.watch.publish, is_json, false)?;
    let scene = Scene::load(&args.scene)?;
    let mut progress = progress::terminal();
    let of_scene = scene.recording.reference.as_ref().and_then(Reference::first_frames);
    let frames = args.watch.reference_frames.or(of_scene).unwrap_or(REFERENCE_FRAMES);
    let model = Arc::new(LiveModel::from_scene(&scene, frames, &mut progress)?);
    let protocol = &model.skin().protocol;
    let quadruples = protocol.quadruples().ok_or_else(|| {
        CliError::input("[protocol] has general current patterns, which recordings do not support")
    })?;
    let pace = args.speed.map_or(Pace::OnDemand, Pace::Speed);
    let mut replay = Replay::open(&args.from, Some(quadruples), pace)?
        .with_frame_rate(scene.recording.frame_rate_hz);
    let mut viewer = Viewer::new(&model, &args.watch, None, !is_json)?;
    let name = replay.setup().identity.to_string();
    viewer.publish(publisher, &name, false)?;
    let (summary, statistics) = if args.step {
        let mut stepped = Stepped(replay);
        (model.watch(&mut stepped, false, &mut viewer), stepped.statistics())
    } else {
        (model.watch(&mut replay, false, &mut viewer), replay.statistics())
    };
    let (files, told) = viewer.finish()?;
    let answer = answer(&name, &summary?, &statistics, &files, &told);
    Ok(publish::told(&args.watch.publish, answer))
}

/// Rejects files of other formats, and names the command that converts them. A file that is
/// missing, empty or unreadable is reported when it is opened.
fn check_recording(args: &ReplayArgs) -> Result<(), CliError> {
    let place = &args.from;
    let is_table = || {
        let has_content = place.metadata().is_ok_and(|data| data.len() > 0);
        has_content && ending(place) != "mcap" && matches!(capture::is_recording(place), Ok(false))
    };
    if !place.is_dir() && !is_table() {
        return Ok(());
    }
    let (from, scene) = (pasted(place), pasted(&args.scene));
    let to = pasted(place.with_extension("mcap"));
    Err(CliError::input(format!(
        "{}: `eit replay` plays recordings, F.mcap, and this is none: make one with `eit convert {from} --scene {scene} \
         --out {to}`, and if its frames have no times, state [recording] frame_rate_hz in the scene",
        place.display()
    )))
}

/// A replay that waits for a line on stdin before each frame, until stdin ends.
struct Stepped(Replay);

impl FrameSource for Stepped {
    fn setup(&self) -> &Setup {
        self.0.setup()
    }

    fn next_event(&mut self, timeout: Duration) -> Result<Option<Event>, HwError> {
        let event = self.0.next_event(timeout)?;
        if let Some(Event::Frame(_)) = &event {
            // treat a stdin that cannot be read as ended
            let _ = std::io::stdin().read_line(&mut String::new());
        }
        Ok(event)
    }

    fn recycle(&mut self, frame: Frame) {
        self.0.recycle(frame);
    }

    fn statistics(&self) -> Statistics {
        self.0.statistics()
    }

    fn is_over(&self) -> bool {
        self.0.is_over()
    }
}
