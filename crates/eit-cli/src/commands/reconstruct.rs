//! `eit reconstruct`

use super::Answer;
use crate::cli::ReconstructArgs;
use crate::error::CliError;
use crate::progress;
use eit_report::settings::ReconstructSettings;

/// Reads frames, reconstructs, draws and reports.
pub(crate) fn run(args: &ReconstructArgs) -> Result<Answer, CliError> {
    let settings = ReconstructSettings {
        scene: args.scene.clone(),
        frames: args.frames.clone(),
        reference: args.reference.clone(),
        method: args.method.clone(),
        out: args.out.clone(),
    };
    Ok(eit_report::reconstruct::run(&settings, &mut progress::terminal())?)
}
