//! `eit report`

use super::Answer;
use crate::cli::ReportArgs;
use crate::error::CliError;
use crate::{interrupt, progress};
use eit_report::settings::ReportSettings;

/// Runs the report until its end or Ctrl-C.
pub(crate) fn run(args: &ReportArgs) -> Result<Answer, CliError> {
    let settings = ReportSettings {
        out: args.out.clone(),
        full: args.full,
        scenes: args.scenes.clone(),
        forward: args.forward,
        images: args.images,
        weights: args.weights.clone(),
    };
    let stop = interrupt::listen()?;
    Ok(eit_report::report::run(&settings, &stop, &mut progress::terminal())?)
}
