//! `eit denoise`

use super::Answer;
use crate::cli::DenoiseArgs;
use crate::error::CliError;
use crate::progress;
use eit_report::settings::DenoiseImages;

/// Reads images and weights, checks both against the scene, denoises, draws, reports.
pub(crate) fn run(args: &DenoiseArgs) -> Result<Answer, CliError> {
    let settings = DenoiseImages {
        scene: args.scene.clone(),
        images: args.images.clone(),
        weights: args.weights.clone(),
        any_skin: args.any_skin,
        truth: args.truth.clone(),
        out: args.out.clone(),
    };
    Ok(eit_report::denoised::run(&settings, &mut progress::terminal())?)
}
