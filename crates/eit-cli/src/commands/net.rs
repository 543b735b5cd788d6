//! `eit net`: the learning base of a U-net, its training, and images through the net.

use crate::cli::{ApplyArgs, BaseArgs, NetCommand, PairsArgs};
use crate::commands::prelude::*;
use eit_report::settings::DenoiseImages;
use eit_skin::train::{self, BaseRequest, Sequences};

pub(super) fn run(command: NetCommand) -> Result<Answer, CliError> {
    match command {
        NetCommand::Base(args) => base(&args),
        #[cfg(feature = "train")]
        NetCommand::Train(args) => super::train::run(&args),
        #[cfg(not(feature = "train"))]
        NetCommand::Train(_) => {
            let what = "training, which compiles burn for ten minutes";
            Err(super::built_without(what, "train"))
        }
        NetCommand::Apply(args) => apply(args),
    }
}

/// Makes the sequences of a learning base that are missing, or those of one part of it.
fn base(args: &BaseArgs) -> Result<Answer, CliError> {
    eit_report::output::check_folder(&args.out)?;
    let scene = Scene::load(&args.scene)?;
    scene.refuse_movement("net base")?;
    let request = args.pairs.request()?;
    let threads = args.pairs.threads()?;
    let mut progress = progress::terminal();
    let skin = Skin::set_up(&scene, &MeshOverride::default(), &mut progress)?;
    let sequences = Sequences::new(&skin, &request, &mut progress)?;
    let stop = interrupt::listen()?;
    let (folder, part) = (&args.out, args.shard);
    let base = train::base(&request, &sequences, folder, part, threads, &stop, &mut progress)?;
    let missing = request.sequence_count() - base.complete();
    let json = json!({
        "scene": scene.name,
        "base": folder.display().to_string(),
        "sequences": request.sequence_count(),
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
        "{} frames of {} sequences in {}: {done}\nnext: eit net train {} --base {} --out w.safetensors",
        base.frames(),
        base.complete(),
        folder.display(),
        args.scene,
        folder.display(),
    );
    Ok(Answer { text, json })
}

/// Runs images through a net.
fn apply(args: ApplyArgs) -> Result<Answer, CliError> {
    let ApplyArgs { scene, images, weights, any_skin, truth, out } = args;
    let settings = DenoiseImages { scene, images, weights, any_skin, truth, out };
    Ok(eit_report::denoised::run(&settings, &mut progress::terminal())?)
}

impl PairsArgs {
    /// Returns the learning base that the flags describe, after checking it.
    pub(super) fn request(&self) -> Result<BaseRequest, CliError> {
        let args = self.clone();
        let request = BaseRequest {
            method: args.method,
            frames: args.frames,
            fingers: args.fingers,
            usual_tips: args.usual_tips,
            script: args.script,
            recording: args.recording,
            sequences: args.sequences,
            pairs: args.pairs,
            seed: args.seed,
        };
        request.validate()?;
        Ok(request)
    }

    /// Returns the number of threads to work on.
    pub(super) fn threads(&self) -> Result<usize, CliError> {
        match self.threads {
            Some(0) => Err(CliError::input("--threads 0: at least 1")),
            Some(threads) => Ok(threads),
            None => Ok(std::thread::available_parallelism().map_or(1, usize::from)),
        }
    }
}
