//! One file per command. A command returns its result as text and as JSON.

pub(crate) mod base;
#[cfg(feature = "zenoh")]
pub(crate) mod body;
#[cfg(not(feature = "zenoh"))]
#[path = "body_absent.rs"]
pub(crate) mod body;
pub(crate) mod calibrate;
pub(crate) mod check;
pub(crate) mod convert;
pub(crate) mod demo;
pub(crate) mod denoise;
pub(crate) mod devices;
mod electrode_watch;
pub(crate) mod emulate;
pub(crate) mod forward;
mod frame_rate;
pub(crate) mod init;
pub(crate) mod jacobian;
pub(crate) mod learn;
pub(crate) mod live;
pub(crate) mod mesh;
mod network;
mod no_data;
pub(crate) mod plan;
mod publish;
pub(crate) mod reconstruct;
pub(crate) mod record;
mod recorder;
pub(crate) mod recover;
pub(crate) mod replay;
pub(crate) mod report;
pub(crate) mod shell;
pub(crate) mod simulate;
mod solve;
#[cfg(feature = "train")]
pub(crate) mod train;
#[cfg(not(feature = "train"))]
#[path = "train_absent.rs"]
pub(crate) mod train;
mod view;
mod viewer;

use crate::cli::WatchArgs;
use crate::error::CliError;
use std::path::Path;

pub(crate) use eit_report::Answer;
use eit_report::output::ending;

/// Exit code of a live command that ended while its instrument was silent or unplugged.
pub(crate) const SILENT: u8 = 3;
/// Exit code of a check that found a fault.
pub(crate) const FAULTY: u8 = 4;

/// A command's result, and the exit code.
pub(crate) struct Ended {
    /// Text and JSON of the result.
    pub answer: Answer,
    /// 0, [`SILENT`] or [`FAULTY`].
    pub exit_code: u8,
}

impl From<Answer> for Ended {
    fn from(answer: Answer) -> Self {
        Self { answer, exit_code: 0 }
    }
}

/// Rejects `--frames 0`, whose empty result would look like a silent instrument.
fn check_frames(frames: Option<u64>) -> Result<(), CliError> {
    match frames {
        Some(0) => {
            Err(CliError::input("--frames 0: it must be above 0; leave it out for no limit"))
        }
        _ => Ok(()),
    }
}

/// Rejects a file name extension of `--out` that the command does not write.
fn check_ending(path: &Path, known: &[&str]) -> Result<String, CliError> {
    check_ending_of("--out", path, known)
}

/// Rejects a file name extension of an option that the command does not write.
fn check_ending_of(option: &str, path: &Path, known: &[&str]) -> Result<String, CliError> {
    let found = ending(path);
    if known.contains(&found.as_str()) {
        return Ok(found);
    }
    let message = format!("{}: {option} must end in .{}", path.display(), known.join(" or ."));
    Err(CliError::input(message))
}

/// Rejects arguments of `eit live` and `eit replay` that need no scene, before any work.
fn check_watch(args: &WatchArgs) -> Result<(), CliError> {
    check_frames(args.frames)?;
    // the picture is always PNG, which another name would hide
    args.picture
        .iter()
        .try_for_each(|picture| check_ending_of("--picture", picture, &["png"]).map(|_format| ()))
}
