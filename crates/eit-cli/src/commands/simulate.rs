//! `eit simulate`

use super::Answer;
use crate::cli::SimulateArgs;
use crate::error::CliError;
use crate::progress;
use eit_report::settings::SimulateSettings;

/// Simulates a touched fabric and writes the results.
pub(crate) fn run(args: &SimulateArgs) -> Result<Answer, CliError> {
    let settings = SimulateSettings {
        scene: args.scene.clone(),
        script: args.script.clone(),
        seed: args.seed,
        frames: args.frames,
        nodes: args.nodes,
        threads: args.threads,
        out: args.out.clone(),
    };
    Ok(eit_report::simulated::run(&settings, &mut progress::terminal())?)
}
