//! One file per command. A command returns what it found, as text and as JSON.

pub(crate) mod calibrate;
pub(crate) mod check;
pub(crate) mod convert;
pub(crate) mod demo;
pub(crate) mod denoise;
pub(crate) mod devices;
mod electrode_watch;
pub(crate) mod emulate;
pub(crate) mod forward;
pub(crate) mod jacobian;
pub(crate) mod live;
pub(crate) mod mesh;
pub(crate) mod plan;
pub(crate) mod reconstruct;
pub(crate) mod record;
pub(crate) mod replay;
pub(crate) mod report;
pub(crate) mod simulate;
mod solve;
pub(crate) mod train;
mod view;
mod viewer;

use crate::error::CliError;
use std::path::Path;

pub(crate) use eit_report::Answer;
use eit_report::output::ending;

/// Refuses an ending that the command does not write.
fn check_ending(path: &Path, known: &[&str]) -> Result<String, CliError> {
    let found = ending(path);
    if known.contains(&found.as_str()) {
        return Ok(found);
    }
    let message = format!("{}: --out must end in .{}", path.display(), known.join(" or ."));
    Err(CliError::input(message))
}
