//! `eit learn`: learns position and force of touches from presses at known places.
//!
//! `live.rs` collects them with an instrument; otherwise they are read from a table and recordings.

mod live;

use crate::cli::LearnArgs;
use crate::commands::prelude::*;
use eit_report::learnt::{LearnFiles, Presses};
use eit_skin::learn::{Frame, LearnedSkin, PressFrames, PressTable};
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
    let mut scene = Scene::load(&args.scene)?;
    // ignore what was learnt before
    scene.touch.learned = None;
    // the table counts frames from the start of the recording
    scene.recording.first_frame = None;
    super::check_ending(&args.out, &["learned"])?;
    let outputs = LearnFiles::new(&args.out, &inputs(args, &scene))?;
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
    let (fitted, frame, earlier) = (&fitted, args.frame(), earlier.as_ref());
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

/// Returns the reference; the mean is good enough if every press has frames before it.
fn reference(args: &LearnArgs, scene: &Scene, table: &PressTable) -> Option<Reference> {
    let own = table.presses.iter().all(|press| press.before_first.is_some());
    let any = (own && scene.recording.reference.is_none()).then(|| "mean".to_owned());
    args.reference.clone().or(any).map(Reference::Text)
}
