//! `eit learn`: learns position and force of touches from presses at known places.
//!
//! `live.rs` collects them with an instrument; otherwise they are read from a table and recordings.

mod live;

use crate::cli::LearnArgs;
use crate::commands::prelude::*;
use eit_report::learnt::{LearnFiles, Presses};
use eit_skin::frames::{FramesInput, ReferenceInput};
use eit_skin::learn::{Frame, LearnedSkin, PressTable, RecordedPresses};
use eit_skin::scene::Reference;

/// Learns from files, or from presses that are made now.
pub(super) fn run(args: &LearnArgs) -> Result<Ended, CliError> {
    match &args.presses {
        _ if args.live.live => live::run(args),
        Some(presses) => from_files(args, presses).map(Ended::from),
        None => Err(CliError::input("--presses P.csv is missing; with --live it is written")),
    }
}

/// Reads table and frames, learns, and writes the file and the learning curve.
fn from_files(args: &LearnArgs, presses: &Path) -> Result<Answer, CliError> {
    let scene = Scene::load(&args.scene)?;
    super::check_ending(&args.out, &["learned"])?;
    let outputs = LearnFiles::new(&args.out, &inputs(args, &scene))?;
    let table = PressTable::read(presses)?;
    let earlier = args.with.as_deref().map(LearnedSkin::read).transpose()?;
    let mut progress = progress::terminal();
    let skin = Skin::set_up(&scene, &MeshOverride::default(), &mut progress)?;
    let reference = args.reference.clone().map(Reference::Text);
    let reference = reference.as_ref().map_or(ReferenceInput::Settings, ReferenceInput::Named);
    let frames = FramesInput::Files(&args.frames);
    let recorded = skin.recorded_presses(&table, frames, reference, &mut progress)?;
    let RecordedPresses { fitted, pressed, .. } = &recorded;
    let notes = fitted.frames.notes.clone();
    let (frame, earlier) = (args.frame(), earlier.as_ref());
    let presses = Presses { fitted, pressed, frame, earlier, notes };
    Ok(outputs.learn(presses, &mut progress)?)
}

/// Input files, with their roles.
fn inputs(args: &LearnArgs, scene: &Scene) -> Vec<(&'static str, PathBuf)> {
    let recording = &scene.recording;
    let stated = recording.files().into_iter().flatten().map(|file| scene.resolve(file));
    let frames = if args.frames.is_empty() { stated.collect() } else { args.frames.clone() };
    // a text that is not a file name leads to no existing file
    let reference = match (&args.reference, &recording.reference) {
        (Some(text), _) => Some(PathBuf::from(text)),
        (None, Some(Reference::Text(text))) => Some(scene.resolve(Path::new(text))),
        _ => None,
    };
    let mut inputs = vec![("the scene", PathBuf::from(&args.scene))];
    inputs.extend(args.presses.iter().map(|file| ("the presses", file.clone())));
    inputs.extend(args.with.iter().map(|file| ("the earlier file", file.clone())));
    inputs.extend(frames.into_iter().map(|file| ("the frames", file)));
    inputs.extend(reference.map(|file| ("the reference", file)));
    inputs
}

impl LearnArgs {
    /// The coordinates of the places.
    fn frame(&self) -> Frame {
        if self.fit_frame { Frame::Fitted } else { Frame::Scene }
    }
}
