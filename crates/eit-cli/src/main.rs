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

use cli::Command;
use commands::Ended;
use eit_skin::words::{printable, printable_json};
use error::CliError;
use std::io::Write as _;
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<_> = std::env::args_os().collect();
    let cli = match defaults::parse(arguments.clone()) {
        Ok(Ok(cli)) => cli,
        Ok(Err(error)) => {
            terminal::set_early(&arguments);
            return usage(&error);
        }
        Err(error) => {
            terminal::set_early(&arguments);
            return failed(&error);
        }
    };
    terminal::set(&cli);
    events::show();
    interrupt::end_tidily();
    let result: Result<Ended, CliError> = match &cli.command {
        Command::Demo(args) => commands::demo::run(args, cli.json).map(Ended::from),
        Command::Plan(args) => commands::plan::run(args).map(Ended::from),
        Command::Mesh(args) => commands::mesh::run(args).map(Ended::from),
        Command::Forward(args) => commands::forward::run(args).map(Ended::from),
        Command::Jacobian(args) => commands::jacobian::run(args).map(Ended::from),
        Command::Calibrate(args) => commands::calibrate::run(args).map(Ended::from),
        Command::Init(args) => commands::init::run(args, cli.json).map(Ended::from),
        Command::Learn(args) => commands::learn::run(args),
        Command::Simulate(args) => commands::simulate::run(args).map(Ended::from),
        Command::Reconstruct(args) => commands::reconstruct::run(args).map(Ended::from),
        Command::Base(args) => commands::base::run(args).map(Ended::from),
        Command::Train(args) => commands::train::run(args).map(Ended::from),
        Command::Denoise(args) => commands::denoise::run(args).map(Ended::from),
        Command::Report(args) => commands::report::run(args).map(Ended::from),
        Command::Devices(args) => commands::devices::run(args).map(Ended::from),
        Command::Check(args) => commands::check::run(args),
        Command::Record(args) => commands::record::run(args),
        Command::Live(args) => commands::live::run(args, cli.json),
        Command::Body(args) => commands::body::run(args, cli.json).map(Ended::from),
        Command::Replay(args) => commands::replay::run(args, cli.json).map(Ended::from),
        Command::Recover(args) => commands::recover::run(args).map(Ended::from),
        Command::Convert(args) => commands::convert::run(args).map(Ended::from),
        Command::Emulate(args) => commands::emulate::run(args, cli.json).map(Ended::from),
        Command::Completions(args) => commands::shell::completions(args).map(Ended::from),
        Command::Man(args) => commands::shell::man(args).map(Ended::from),
    };
    match result {
        Ok(ended) if cli.json => {
            said(say(&printable_json(&ended.answer.json.to_string())), ended.exit_code)
        }
        Ok(ended) => said(say(&printable(&ended.answer.text)), ended.exit_code),
        Err(error) => failed(&error),
    }
}

/// Prints why a command stopped, on one line.
fn failed(error: &CliError) -> ExitCode {
    eprintln!("{} {}", terminal::error_name(), printable(&error.to_string()));
    ExitCode::from(error.exit_code())
}

/// Returns the exit code for a command whose answer was printed.
fn said(printed: ExitCode, exit_code: u8) -> ExitCode {
    if printed == ExitCode::SUCCESS { ExitCode::from(exit_code) } else { printed }
}

/// Prints an answer, if there is one; a closed pipe is not an error.
fn say(text: &str) -> ExitCode {
    if text.is_empty() {
        return ExitCode::SUCCESS;
    }
    match writeln!(std::io::stdout().lock(), "{text}") {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            eprintln!("eit: cannot write the answer: {error}");
            ExitCode::from(1)
        }
        _ => ExitCode::SUCCESS,
    }
}

/// Prints help and version unchanged, and wrong usage on one line.
fn usage(error: &clap::Error) -> ExitCode {
    if !error.use_stderr() {
        let help = error.render();
        return match terminal::is_colored(&std::io::stdout()) {
            true => say(help.ansi().to_string().trim_end()),
            false => say(help.to_string().trim_end()),
        };
    }
    if error.kind() == clap::error::ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        eprintln!("{}", error.render());
        return ExitCode::from(2);
    }
    let text = defaults::words_of(error);
    // lines before the usage, or before the pointer to --help where there is none: the error and tips
    let is_end =
        |line: &str| line.starts_with("Usage:") || line.starts_with("For more information");
    let lines = text.lines().take_while(|line| !is_end(line)).map(str::trim);
    let words: Vec<&str> = lines.filter(|l| !l.is_empty()).collect();
    let words = words.join(" ");
    let name = terminal::error_name();
    eprintln!("{name} {}; see --help", printable(words.trim_start_matches("error: ")));
    ExitCode::from(2)
}
