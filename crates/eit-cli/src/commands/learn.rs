//! `eit learn`: learns position and force of touches from presses at known places.

mod answer;
mod outputs;

use self::outputs::Outputs;
use super::Answer;
use crate::cli::LearnArgs;
use crate::error::CliError;
use crate::progress;
use eit_skin::learn::{
    CurvePoint, Frame, LearnedSkin, Learning, PressFrames, PressTable, learning_curve,
};
use eit_skin::scene::{Reference, Scene};
use eit_skin::{MeshOverride, Skin};
use std::sync::Arc;

/// What was learnt, for the answer.
struct Found {
    learning: Learning,
    curve: Vec<CurvePoint>,
    /// Notes about the frames and the presses.
    notes: Vec<String>,
}

/// Reads table and frames, learns, and writes the file and the learning curve.
pub(crate) fn run(args: &LearnArgs) -> Result<Answer, CliError> {
    let mut scene = Scene::load(&args.scene)?;
    // ignore what was learnt before
    scene.touch.learned = None;
    // the table counts frames from the start of the recording
    scene.recording.first_frame = None;
    super::check_ending(&args.out, &["learned"])?;
    let outputs = Outputs::new(args, &scene)?;
    let table = PressTable::read(&args.presses)?;
    let earlier = args.with.as_deref().map(LearnedSkin::read).transpose()?;
    let mut progress = progress::terminal();
    let skin = Skin::set_up(&scene, &MeshOverride::default(), &mut progress)?;
    let linearised = Arc::new(skin.linearise(&mut progress)?);
    let reference = reference(args, &scene, &table);
    let frames =
        progress.stage("read frames", || skin.read_frames(&args.frames, reference.as_ref()))?;
    let mut notes = frames.notes.clone();
    let fitted = linearised.fit(frames)?;
    let pressed = PressFrames::new(&table, &fitted.frames)?;
    let frame = if args.fit_frame { Frame::Fitted } else { Frame::Scene };
    let earlier = earlier.as_ref();
    let learning = LearnedSkin::learn(&fitted, &pressed, frame, earlier, &mut progress)?;
    let curve = learning_curve(&fitted, &pressed, frame, earlier, &mut progress)?;
    notes.extend(answer::notes(&learning, &pressed));
    let found = Found { learning, curve, notes };
    outputs.write(&found)?;
    Ok(answer::answer(args, &found, &progress))
}

/// The reference; any frame serves if every press has its own.
fn reference(args: &LearnArgs, scene: &Scene, table: &PressTable) -> Option<Reference> {
    let own = table.presses.iter().all(|press| press.before_first.is_some());
    let any = (own && scene.recording.reference.is_none()).then(|| "mean".to_owned());
    args.reference.clone().or(any).map(Reference::Text)
}
