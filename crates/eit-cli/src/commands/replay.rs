//! `eit replay`: plays a recording as if it were live.

use super::viewer::Viewer;
use super::{check_watch, publish};
use crate::cli::ReplayArgs;
use crate::commands::prelude::*;
use eit_hw::capture;
use eit_hw::driver::{FrameSource as _, Pace, Replay};
use eit_report::output::ending;
use eit_report::simulated::pasted;
use eit_skin::live::{LiveModel, REFERENCE_FRAMES, replayed_reference_frames};

/// Watches until the end of the recording, Ctrl-C or enough frames.
pub(super) fn run(args: &ReplayArgs) -> Result<Answer, CliError> {
    check_watch(&args.watch)?;
    if let Some(speed) = args.speed {
        check_option("--speed", speed, speed.is_finite() && speed > 0.0, "above 0")?;
    }
    check_recording(args)?;
    let publisher = publish::open(&args.watch.publish, false)?;
    let scene = Scene::load(&args.scene)?;
    let frames = args.watch.reference_frames;
    let counted = frames.unwrap_or(REFERENCE_FRAMES);
    let mut model = LiveModel::from_scene(&scene, counted, &mut progress::terminal())?;
    let quadruples = model.skin().protocol.quadruples().ok_or_else(|| {
        CliError::input("[protocol] has general current patterns, which recordings do not support")
    })?;
    let pace = args.speed.map_or(Pace::OnDemand, Pace::Speed);
    let mut replay = Replay::open(&args.from, Some(quadruples), pace)?
        .with_frame_rate(scene.recording.frame_rate_hz);
    match frames {
        Some(_) => replay = replay.without_references(),
        None => model.reference_frames = replayed_reference_frames(&mut replay, &scene.recording),
    }
    let model = Arc::new(model);
    let mut viewer = Viewer::new(&model, &args.watch, Until::new(None)?)?;
    viewer.waits_for_line = args.step;
    let name = replay.setup().identity.to_string();
    viewer.publish(publisher, &name, None, false)?;
    let summary = model.watch(&mut replay, false, &mut viewer);
    let (answer, _) = viewer.finish(&name, summary, &replay.statistics())?;
    Ok(publish::moved(answer, args.watch.publish.json_lines))
}

/// Rejects files of other formats, and names the command that makes a recording of them. A file that is missing,
/// empty or cannot be read is reported when it is opened.
fn check_recording(args: &ReplayArgs) -> Result<(), CliError> {
    let path = &args.from;
    let is_table = || {
        let has_content = path.metadata().is_ok_and(|data| data.len() > 0);
        has_content && ending(path) != "mcap" && matches!(capture::is_recording(path), Ok(false))
    };
    if !path.is_dir() && !is_table() {
        return Ok(());
    }
    let (from, scene) = (pasted(path), pasted(&args.scene));
    let to = pasted(path.with_extension("mcap"));
    Err(CliError::input(format!(
        "{}: `eit replay` plays recordings, F.mcap, and this is none: make one with `eit convert {from} --scene {scene} \
         --out {to}`, and if its frames have no times, state [recording] frame_rate_hz in the scene",
        path.display()
    )))
}
