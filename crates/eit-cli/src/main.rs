//! `eit`: electrical impedance tomography for robot skin, from the command line.
//!
//! Thin: parses, joins the library crates, draws, writes. `eit --help` teaches the rest.
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a command line program speaks through them"
)]

mod cli;
mod commands;
mod error;
mod interrupt;
mod progress;

use clap::Parser as _;
use cli::{Cli, Command};
use std::io::Write as _;
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => return usage(&error),
    };
    let result = match &cli.command {
        Command::Demo(args) => commands::demo::run(args),
        Command::Plan(args) => commands::plan::run(args),
        Command::Mesh(args) => commands::mesh::run(args),
        Command::Forward(args) => commands::forward::run(args),
        Command::Jacobian(args) => commands::jacobian::run(args),
        Command::Calibrate(args) => commands::calibrate::run(args),
        Command::Simulate(args) => commands::simulate::run(args),
        Command::Reconstruct(args) => commands::reconstruct::run(args),
        Command::Train(args) => commands::train::run(args),
        Command::Denoise(args) => commands::denoise::run(args),
        Command::Report(args) => commands::report::run(args),
        Command::Devices(args) => commands::devices::run(args),
        Command::Check(args) => commands::check::run(args),
        Command::Record(args) => commands::record::run(args),
        Command::Live(args) => commands::live::run(args, cli.json),
        Command::Replay(args) => commands::replay::run(args, cli.json),
        Command::Convert(args) => commands::convert::run(args),
        Command::Emulate(args) => commands::emulate::run(args, cli.json),
    };
    match result {
        Ok(answer) if cli.json => say(&answer.json.to_string()),
        Ok(answer) => say(&answer.text),
        Err(error) => {
            eprintln!("eit: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}

/// Prints an answer; a reader who has gone away is no failure.
fn say(text: &str) -> ExitCode {
    match writeln!(std::io::stdout().lock(), "{text}") {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            eprintln!("eit: cannot write the answer: {error}");
            ExitCode::from(1)
        }
        _ => ExitCode::SUCCESS,
    }
}

/// Help and version as they are; wrong usage on one line.
fn usage(error: &clap::Error) -> ExitCode {
    if !error.use_stderr() {
        return say(error.render().to_string().trim_end());
    }
    if error.kind() == clap::error::ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        eprintln!("{}", error.render());
        return ExitCode::from(2);
    }
    let text = error.render().to_string();
    // up to the usage: what is wrong and the tips
    let lines = text.lines().take_while(|l| !l.starts_with("Usage:")).map(str::trim);
    let words: Vec<&str> = lines.filter(|l| !l.is_empty()).collect();
    eprintln!("eit: {}; see --help", words.join(" ").trim_start_matches("error: "));
    ExitCode::from(2)
}
