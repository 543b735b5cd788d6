//! `eit completions` and `eit man`: shell completions and manual pages, generated from the program's own
//! definitions.

use crate::cli::{Cli, CompletionsArgs, ManArgs};
use crate::commands::prelude::*;
use clap::CommandFactory as _;

/// Returns the completions for a shell.
pub(super) fn completions(args: &CompletionsArgs) -> Answer {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "eit", &mut script);
    let text = String::from_utf8_lossy(&script).trim_end().to_owned();
    let json = json!({ "shell": args.shell.to_string(), "script": text });
    Answer { text, json }
}

/// Writes the manual pages of the program and its commands.
pub(super) fn man(args: &ManArgs) -> Result<Answer, CliError> {
    let failed = |error| CliError::at(&args.out, error);
    eit_report::output::check_folder(&args.out)?;
    std::fs::create_dir_all(&args.out).map_err(failed)?;
    // a page for each of our commands, but not for clap's own `help`
    let command = Cli::command().disable_help_subcommand(true);
    let command = command.mut_subcommand("net", |net| net.disable_help_subcommand(true));
    let pages = pages(&command);
    clap_mangen::generate_to(command, &args.out).map_err(failed)?;
    Ok(Answer {
        text: format!("{pages} manual pages in {}", args.out.display()),
        json: json!({ "pages": pages, "folder": args.out }),
    })
}

/// Number of a command's pages: its own, and those of its commands that the help lists.
fn pages(command: &clap::Command) -> usize {
    let listed = command.get_subcommands().filter(|command| !command.is_hide_set());
    1 + listed.map(pages).sum::<usize>()
}
