//! `eit base`: a learning base out of simulated touches or recordings, or a part of it.

use super::Answer;
use crate::cli::{BaseArgs, PairsArgs};
use crate::error::CliError;
use crate::{interrupt, progress};
use eit_skin::scene::Scene;
use eit_skin::train::{self, BaseRequest, Sequences, Wanted};
use eit_skin::{MeshOverride, Skin};
use serde_json::json;

/// Makes the sequences that are missing.
pub(crate) fn run(args: &BaseArgs) -> Result<Answer, CliError> {
    eit_report::output::check_folder(&args.out)?;
    let scene = Scene::load(&args.scene)?;
    scene.refuse_movement("base")?;
    let request = request(&args.pairs)?;
    let threads = threads(&args.pairs)?;
    let mut progress = progress::terminal();
    let skin = Skin::set_up(&scene, &MeshOverride::default(), &mut progress)?;
    let sequences = Sequences::new(&skin, &request, &mut progress)?;
    let stop = interrupt::listen()?;
    let (folder, part) = (&args.out, args.shard);
    let base = train::base(&request, &sequences, folder, part, threads, &stop, &mut progress)?;
    let missing = (0..request.sequences).len() - base.complete();
    let json = json!({
        "scene": scene.name,
        "base": folder.display().to_string(),
        "sequences": request.sequences,
        "missing": missing,
        "frames": base.frames(),
        "part": part.map(|part| part.to_string()),
        "checksum": base.checksum()?,
        "stages": progress.times(),
    });
    let done = match part {
        Some(part) => format!("part {part} is complete; {missing} sequences are missing in all"),
        None => "complete".to_owned(),
    };
    let text = format!(
        "{} frames of {} sequences in {}: {done}\nnext: eit train {} --base {} --out w.safetensors",
        base.frames(),
        base.complete(),
        folder.display(),
        args.scene,
        folder.display(),
    );
    Ok(Answer { text, json })
}

/// Returns the settings that the flags specify, checked.
pub(super) fn request(args: &PairsArgs) -> Result<BaseRequest, CliError> {
    let request = BaseRequest {
        method: args.method.clone(),
        frames: args.frames,
        fingers: args.fingers,
        usual_tips: args.usual_tips,
        script: args.script.clone(),
        wanted: if args.wanted == "rule" { Wanted::Rule } else { Wanted::Truth },
        recording: args.recording.clone(),
        sequences: args.sequences,
        seed: args.seed,
    };
    request.validate()?;
    Ok(request)
}

/// Threads to work on.
pub(super) fn threads(args: &PairsArgs) -> Result<usize, CliError> {
    match args.threads {
        Some(0) => Err(CliError::input("--threads 0: at least 1")),
        Some(threads) => Ok(threads),
        None => Ok(std::thread::available_parallelism().map_or(1, usize::from)),
    }
}
