//! `eit body` of a command that was built without zenoh.

use super::Answer;
use crate::cli::BodyArgs;
use crate::error::CliError;

/// Explains how to build a program that has the command.
pub(crate) fn run(_: &BodyArgs, _: bool) -> Result<Answer, CliError> {
    Err(CliError::input(
        "this eit was built without zenoh: build it with cargo install --path crates/eit-cli --features zenoh",
    ))
}
