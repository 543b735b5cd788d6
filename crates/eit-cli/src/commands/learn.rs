//! `eit learn`: learns position and force of touches from presses at known places.
//!
//! `live.rs` collects them with an instrument; otherwise they are read from a table and recordings.

mod answer;
mod live;
mod outputs;

use self::outputs::Outputs;
use super::{Answer, Ended};
use crate::cli::LearnArgs;
use crate::error::CliError;
use crate::progress;
use eit_skin::learn::{
    CurvePoint, Frame, LearnedSkin, Learning, PressFrames, PressTable, learning_curve,
};
use eit_skin::scene::{Reference, Scene};
use eit_skin::{FittedFrames, MeshOverride, Progress, Skin};
use std::path::Path;
use std::sync::Arc;

/// What was learnt, for the answer.
struct Found {
    learning: Learning,
    curve: Vec<CurvePoint>,
    /// Notes about the frames and the presses.
    notes: Vec<String>,
}

/// What is learnt from, however it was collected.
struct Parts<'a> {
    fitted: &'a FittedFrames,
    pressed: &'a PressFrames,
    frame: Frame,
    earlier: Option<&'a LearnedSkin>,
    notes: Vec<String>,
}

/// Learns from files, or from presses that are made now.
pub(crate) fn run(args: &LearnArgs) -> Result<Ended, CliError> {
    match &args.presses {
        _ if args.live.live => live::run(args),
        Some(presses) => from_files(args, presses).map(Ended::from),
        None => Err(CliError::input("--presses P.csv is missing; with --live it is written")),
    }
}

/// Reads table and frames, learns, and writes the file and the learning curve.
fn from_files(args: &LearnArgs, presses: &Path) -> Result<Answer, CliError> {
    let mut scene = Scene::load(&args.scene)?;
    // ignore what was learnt before
    scene.touch.learned = None;
    // the table counts frames from the start of the recording
    scene.recording.first_frame = None;
    super::check_ending(&args.out, &["learned"])?;
    let outputs = Outputs::new(args, &scene)?;
    let table = PressTable::read(presses)?;
    let earlier = args.with.as_deref().map(LearnedSkin::read).transpose()?;
    let mut progress = progress::terminal();
    let skin = Skin::set_up(&scene, &MeshOverride::default(), &mut progress)?;
    let linearised = Arc::new(skin.linearise(&mut progress)?);
    let reference = reference(args, &scene, &table);
    let frames =
        progress.stage("read frames", || skin.read_frames(&args.frames, reference.as_ref()))?;
    let notes = frames.notes.clone();
    let fitted = linearised.fit(frames)?;
    let pressed = &PressFrames::new(&table, &fitted.frames)?;
    let frame = if args.fit_frame { Frame::Fitted } else { Frame::Scene };
    let parts = Parts { fitted: &fitted, pressed, frame, earlier: earlier.as_ref(), notes };
    finish(args, parts, outputs, &mut progress)
}

/// Learns, and writes the file and the learning curve.
fn finish(
    args: &LearnArgs,
    parts: Parts<'_>,
    outputs: Outputs,
    progress: &mut Progress,
) -> Result<Answer, CliError> {
    let Parts { fitted, pressed, frame, earlier, mut notes } = parts;
    let learning = LearnedSkin::learn(fitted, pressed, frame, earlier, progress)?;
    let curve = learning_curve(fitted, pressed, frame, earlier, progress)?;
    notes.extend(answer::notes(&learning, pressed));
    let found = Found { learning, curve, notes };
    outputs.write(&found)?;
    Ok(answer::answer(args, &found, progress))
}

/// The reference; any frame serves if every press has its own.
fn reference(args: &LearnArgs, scene: &Scene, table: &PressTable) -> Option<Reference> {
    let own = table.presses.iter().all(|press| press.before_first.is_some());
    let any = (own && scene.recording.reference.is_none()).then(|| "mean".to_owned());
    args.reference.clone().or(any).map(Reference::Text)
}
