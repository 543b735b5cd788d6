//! `eit live`: touches of a live instrument as they happen.

use super::recorder::Recordings;
use super::silence::NoData;
use super::viewer::Viewer;
use super::{check_ending_of, check_watch, publish};
use crate::cli::LiveArgs;
use crate::commands::prelude::*;
use eit_hw::driver::FrameSource as _;
use eit_skin::connect;
use eit_skin::live::{LiveModel, REFERENCE_FRAMES};

/// Watches until Ctrl-C, the end of `--seconds` or enough frames.
pub(super) fn run(args: &LiveArgs) -> Result<Ended, CliError> {
    let until = Until::new(args.seconds)?;
    let split = args.split.settings()?;
    if split.is_split() && args.record.is_none() {
        return Err(CliError::input("--split-mb and --split-s need --record F.mcap"));
    }
    check_watch(&args.watch)?;
    if let Some(path) = &args.record {
        check_ending_of("--record", path, &["mcap"])?;
    }
    let publisher = publish::open(&args.watch.publish, true)?;
    let scene = Scene::load(&args.scene)?;
    let instrument = scene.instrument()?;
    let mut progress = progress::terminal();
    let frames = args.watch.reference_frames.unwrap_or(REFERENCE_FRAMES);
    let model = Arc::new(LiveModel::from_scene(&scene, frames, &mut progress)?);
    let mut viewer = Viewer::new(&model, &args.watch, until)?;
    let mut session =
        progress.stage("connect", || connect::open_recorder(&instrument, args.port.as_deref()))?;
    let record = connect::session_record(&model.skin().scene_toml, &instrument, &session);
    let mut recordings = Recordings::new(&args.scene, record, session.tape());
    args.record.iter().try_for_each(|path| recordings.record(path, split))?;
    let name = session.setup().identity.to_string();
    viewer.publish(publisher, &name, Some(recordings), true)?;
    let summary = model.watch(&mut session, true, &mut viewer);
    session.stop();
    let statistics = session.statistics();
    // the connection may have changed the name
    let name = session.setup().identity.to_string();
    let is_silent = viewer.silence.is_silent();
    let (mut answer, summary) = viewer.finish(&name, summary, &statistics)?;
    let without_s = [statistics.silent_s, statistics.disconnected_s];
    let stated_hz = session.setup().frame_rate_hz;
    let no_data = NoData::new(without_s, stated_hz, summary.frame_rate_hz(), is_silent);
    answer.text += &no_data.description().replacen("; ", "\n", 1);
    answer.json = joined(answer.json, no_data);
    let exit = if is_silent { Exit::Silent } else { Exit::Done };
    Ok(Ended { answer: publish::moved(answer, args.watch.publish.json_lines), exit })
}
