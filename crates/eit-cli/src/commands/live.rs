//! `eit live`: touches of a live instrument as they happen.

use super::viewer::Viewer;
use super::{Answer, record};
use crate::cli::LiveArgs;
use crate::error::CliError;
use crate::progress;
use eit_hw::capture::{CaptureSettings, CaptureWriter};
use eit_hw::driver::{FrameSource, Overflow};
use eit_report::watched::answer;
use eit_skin::connect;
use eit_skin::live::LiveModel;
use eit_skin::scene::Scene;
use std::sync::Arc;

/// Watches until Ctrl-C, the end of `--seconds` or enough frames.
pub(crate) fn run(args: &LiveArgs, is_json: bool) -> Result<Answer, CliError> {
    let limit = record::duration(args.seconds)?;
    let scene = Scene::load(&args.scene)?;
    let instrument = scene.instrument()?;
    let mut progress = progress::terminal();
    let frames = args.watch.reference_frames;
    let model = Arc::new(LiveModel::from_scene(&scene, frames, &mut progress)?);
    let mut viewer = Viewer::new(&model, &args.watch, limit, !is_json)?;
    // a recording must not lose a frame; a view wants the present
    let overflow = match args.record {
        Some(_) => Overflow::Fail,
        None => Overflow::KeepLatest,
    };
    let mut session =
        progress.stage("connect", || connect::open(&instrument, args.port.as_deref(), overflow))?;
    if let Some(place) = &args.record {
        let record = connect::session_record(&model.skin().scene_toml, &instrument, &session);
        let settings = CaptureSettings::default();
        let writer = CaptureWriter::create(place, &record, settings)
            .map_err(|error| CliError::input(error.to_string()))?;
        viewer.record(writer);
    }
    let summary = model.watch(&mut session, true, &mut viewer);
    session.stop();
    let statistics = FrameSource::statistics(&session);
    let name = session.setup().identity.to_string();
    // what stopped the view is what the user wants to know; a writer that failed fails again
    let files = viewer.finish();
    let summary = summary?;
    Ok(answer(&name, &summary, &statistics, &files?))
}
