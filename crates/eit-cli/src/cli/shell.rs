//! Arguments of commands that help to use the program.

use clap::Args;
use std::path::PathBuf;

/// `eit completions`
#[derive(Debug, Args)]
pub(crate) struct CompletionsArgs {
    /// Shell to complete for.
    #[arg(value_enum)]
    pub shell: clap_complete::Shell,
}

/// `eit man`
#[derive(Debug, Args)]
pub(crate) struct ManArgs {
    /// Folder for the pages; existing pages are overwritten.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}
