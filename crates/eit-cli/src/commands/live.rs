//! `eit live`: touches of a live instrument as they happen.

use super::no_data::NoData;
use super::recorder::PageRecorder;
use super::viewer::Viewer;
use super::{Ended, SILENT, publish, record};
use crate::cli::LiveArgs;
use crate::error::CliError;
use crate::progress;
use eit_hw::capture::CaptureWriter;
use eit_hw::driver::FrameSource;
use eit_report::watched::answer;
use eit_skin::connect::{self, Backlog};
use eit_skin::live::{LiveModel, REFERENCE_FRAMES};
use eit_skin::scene::Scene;
use std::sync::Arc;

/// Watches until Ctrl-C, the end of `--seconds` or enough frames.
pub(crate) fn run(args: &LiveArgs, is_json: bool) -> Result<Ended, CliError> {
    let limit = record::duration(args.seconds)?;
    let recorded = args.split.settings()?;
    if recorded.is_split() && args.record.is_none() {
        return Err(CliError::input("--split-mb and --split-s need --record F.mcap"));
    }
    super::check_watch(&args.watch)?;
    if let Some(place) = &args.record {
        super::check_ending_of("--record", place, &["mcap"])?;
    }
    let publisher = publish::open(&args.watch.publish, is_json, true)?;
    let scene = Scene::load(&args.scene)?;
    let instrument = scene.instrument()?;
    let mut progress = progress::terminal();
    let frames = args.watch.reference_frames.unwrap_or(REFERENCE_FRAMES);
    let model = Arc::new(LiveModel::from_scene(&scene, frames, &mut progress)?);
    let mut viewer = Viewer::new(&model, &args.watch, limit, !is_json)?;
    let backlog = match args.record {
        Some(_) => Backlog::Recorded,
        None => Backlog::Published,
    };
    let mut session =
        progress.stage("connect", || connect::open(&instrument, args.port.as_deref(), backlog))?;
    let record = connect::session_record(&model.skin().scene_toml, &instrument, &session);
    if let Some(place) = &args.record {
        let writer = CaptureWriter::create(place, &record, recorded)
            .map_err(|error| CliError::input(error.to_string()))?;
        viewer.record(writer);
    }
    viewer.publish(publisher, &session.setup().identity.to_string(), true)?;
    if args.watch.publish.page.web.is_some() {
        let (fixed, waiting) = (args.record.clone(), session.waiting());
        viewer.let_record(PageRecorder::new(&args.scene, record, fixed, waiting))?;
    }
    let summary = model.watch(&mut session, true, &mut viewer);
    session.stop();
    let statistics = FrameSource::statistics(&session);
    let name = session.setup().identity.to_string();
    let ended_silent = viewer.is_silent();
    // report first what stopped the view: a writer that failed fails again
    let files = viewer.finish();
    let summary = summary?;
    let (files, told) = files?;
    let mut answer = answer(&name, &summary, &statistics, &files, &told);
    let no_data = NoData::of(session.setup(), &statistics, summary.frame_rate_hz(), ended_silent);
    answer.text += &no_data.words().replacen("; ", "\n", 1);
    no_data.add_to(&mut answer.json);
    let answer = publish::told(&args.watch.publish, answer);
    Ok(Ended { answer, exit_code: if ended_silent { SILENT } else { 0 } })
}
