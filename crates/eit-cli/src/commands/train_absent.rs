//! `eit train` of a command that was built without it.

use super::Answer;
use crate::cli::TrainArgs;
use crate::error::CliError;

/// Explains how to build a program that has the command.
pub(crate) fn run(_: &TrainArgs) -> Result<Answer, CliError> {
    Err(CliError::input(
        "this eit was built without training, which compiles burn for ten minutes: build it with \
         cargo install --path crates/eit-cli --features train",
    ))
}
