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
mod draw;
mod error;
mod frames;
mod output;
mod picture;
mod pipeline;
mod progress;
mod scene;

use clap::Parser as _;
use cli::{Cli, Command};
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = Cli::parse();
    let result = match &cli.command {
        Command::Demo(args) => commands::demo::run(args),
        Command::Plan(args) => commands::plan::run(args),
        Command::Mesh(args) => commands::mesh::run(args),
        Command::Forward(args) => commands::forward::run(args),
        Command::Jacobian(args) => commands::jacobian::run(args),
        Command::Reconstruct(args) => commands::reconstruct::run(args),
    };
    match result {
        Ok(answer) => {
            if cli.json {
                println!("{}", answer.json);
            } else {
                println!("{}", answer.text);
            }
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("eit: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}
