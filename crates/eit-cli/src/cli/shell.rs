//! Arguments of what helps to use the program.

use clap::Args;
use std::path::PathBuf;

/// `eit completions`
#[derive(Debug, Args)]
pub(crate) struct CompletionsArgs {
    /// The shell.
    #[arg(value_enum)]
    pub shell: clap_complete::Shell,
}

/// `eit man`
#[derive(Debug, Args)]
pub(crate) struct ManArgs {
    /// Folder for the pages; those that are there are written anew.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}
