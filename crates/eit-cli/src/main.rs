//! `eit`: electrical impedance tomography for robot skin, from the command line.
//!
//! Thin: parses arguments, calls the library crates, and prints. See `eit --help`.
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a command line program speaks through them"
)]

mod cli;
mod commands;
mod defaults;
mod error;
mod events;
mod interrupt;
mod progress;
mod terminal;

use commands::Ended;
use eit_skin::text::{printable, printable_json};
use error::{CliError, Exit};
use std::io::Write as _;
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<_> = std::env::args_os().collect();
    let parsed = defaults::parse(arguments.clone());
    if !matches!(parsed, Ok(Ok(_))) {
        terminal::set_early(&arguments);
    }
    let exit = match parsed {
        Ok(Ok(cli)) => run(cli),
        Ok(Err(error)) => usage(&error),
        Err(error) => failed(&error),
    };
    ExitCode::from(exit as u8)
}

/// Runs a command and prints its answer.
fn run(cli: cli::Cli) -> Exit {
    terminal::set(&cli);
    events::show();
    interrupt::end_tidily();
    match commands::run(cli.command) {
        Ok(Ended { answer, exit }) => {
            let printed = match terminal::flags().is_json {
                true => say(&printable_json(&answer.json.to_string())),
                false => say(&printable(&answer.text)),
            };
            if printed == Exit::Done { exit } else { printed }
        }
        Err(error) => failed(&error),
    }
}

/// Prints why a command stopped, on one line.
fn failed(error: &CliError) -> Exit {
    eprintln!("{} {}", terminal::error_name(), printable(&error.to_string()));
    error.exit
}

/// Prints an answer, if there is one; a reader that has gone away is not an error.
fn say(text: &str) -> Exit {
    if text.is_empty() {
        return Exit::Done;
    }
    match writeln!(std::io::stdout().lock(), "{text}") {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            eprintln!("eit: cannot write the answer: {error}");
            Exit::Failed
        }
        _ => Exit::Done,
    }
}

/// Prints help and version unchanged, and wrong usage on one line.
fn usage(error: &clap::Error) -> Exit {
    if !error.use_stderr() {
        let help = error.render();
        return match terminal::is_colored(&std::io::stdout()) {
            true => say(help.ansi().to_string().trim_end()),
            false => say(help.to_string().trim_end()),
        };
    }
    if error.kind() == clap::error::ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        eprintln!("{}", error.render());
        return Exit::Input;
    }
    failed(&CliError::input(format!("{}; see --help", defaults::one_line(error))))
}
