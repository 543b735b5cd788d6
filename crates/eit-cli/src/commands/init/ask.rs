//! Asks questions on a terminal; elsewhere a missing answer is an error that names its flag.

use crate::cli::ShapeArg;
use crate::error::CliError;
use std::io::{BufRead as _, IsTerminal as _, Write as _};

/// Asks on stderr, so that stdout only contains the answer.
pub(super) struct Questions {
    is_terminal: bool,
    is_quiet: bool,
}

impl Questions {
    /// `is_quiet`: only print errors and the answer.
    pub(super) fn new(is_quiet: bool) -> Self {
        let is_terminal = std::io::stdin().is_terminal() && std::io::stderr().is_terminal();
        Self { is_terminal, is_quiet }
    }

    /// Tells the user what to do next.
    pub(super) fn say(&self, text: &str) {
        if !self.is_quiet {
            eprintln!("{}", eit_skin::words::printable(text));
        }
    }

    pub(super) fn shape(&mut self) -> Result<ShapeArg, CliError> {
        loop {
            match self.ask("--shape", "shape of the skin, disc or rectangle")?.as_str() {
                "disc" | "d" | "circle" | "round" => return Ok(ShapeArg::Disc),
                "rectangle" | "r" => return Ok(ShapeArg::Rectangle),
                other => eprintln!(
                    "\"{other}\" is neither disc nor rectangle; for other shapes see docs/SCENE.md"
                ),
            }
        }
    }

    pub(super) fn number(&mut self, flag: &str, question: &str) -> Result<f64, CliError> {
        loop {
            let text = self.ask(flag, question)?;
            match text.replace(',', ".").parse::<f64>() {
                Ok(number) if (1.0..=1e4).contains(&number) => return Ok(number),
                _ => eprintln!("\"{text}\" is not a number from 1 to 10000"),
            }
        }
    }

    pub(super) fn count(&mut self, flag: &str, question: &str) -> Result<usize, CliError> {
        loop {
            let text = self.ask(flag, question)?;
            match text.parse::<usize>() {
                Ok(count) if count >= 4 => return Ok(count),
                _ => eprintln!("\"{text}\" is not a whole number of 4 or more"),
            }
        }
    }

    fn ask(&mut self, flag: &str, question: &str) -> Result<String, CliError> {
        let missing = || CliError::input(format!("{flag} is missing: {question}"));
        if !self.is_terminal {
            return Err(missing());
        }
        eprint!("{question}: ");
        let mut line = String::new();
        let flushed = std::io::stderr().flush();
        let read = flushed.and_then(|()| std::io::stdin().lock().read_line(&mut line));
        match read {
            Ok(bytes) if bytes > 0 => Ok(line.trim().to_owned()),
            _ => Err(missing()),
        }
    }
}
