//! `eit demo`

use super::Answer;
use crate::cli::DemoArgs;
use crate::error::CliError;
use crate::{interrupt, progress};
use eit_report::settings::DemoSettings;

/// Runs the demo until its end or Ctrl-C.
pub(crate) fn run(args: &DemoArgs) -> Result<Answer, CliError> {
    let settings = DemoSettings { out: args.out.clone(), force: args.force, quick: args.quick };
    let stop = interrupt::listen()?;
    Ok(eit_report::demo::run(&settings, &stop, &mut progress::terminal())?)
}
