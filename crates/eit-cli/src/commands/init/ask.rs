//! Asks questions on a terminal; elsewhere a missing answer is an error that names its flag.

use crate::cli::ShapeArg;
use crate::commands::prelude::*;
use std::io::{BufRead as _, IsTerminal as _, Write as _};

/// Tells the user what to do next, on stderr: stdout only contains the answer.
pub(super) fn say(text: &str) {
    if !terminal::flags().is_json {
        eprintln!("{}", eit_skin::text::printable(text));
    }
}

pub(super) fn shape() -> Result<ShapeArg, CliError> {
    let wanted = "neither disc nor rectangle; for other shapes see docs/SCENE.md";
    ask("--shape", "shape of the skin, disc or rectangle", wanted, |text| match text {
        "disc" | "d" | "circle" | "round" => Some(ShapeArg::Disc),
        "rectangle" | "r" => Some(ShapeArg::Rectangle),
        _ => None,
    })
}

pub(super) fn number(flag: &str, question: &str) -> Result<f64, CliError> {
    ask(flag, question, "not a number from 1 to 10000", |text| {
        let number: f64 = text.replace(',', ".").parse().ok()?;
        (1.0..=1e4).contains(&number).then_some(number)
    })
}

pub(super) fn count(flag: &str, question: &str) -> Result<usize, CliError> {
    let wanted = "not a whole number of 4 or more";
    ask(flag, question, wanted, |text| text.parse().ok().filter(|count| *count >= 4))
}

/// Asks until the answer can be used.
fn ask<T>(
    flag: &str,
    question: &str,
    wrong: &str,
    parse: impl Fn(&str) -> Option<T>,
) -> Result<T, CliError> {
    let missing = || CliError::input(format!("{flag} is missing: {question}"));
    if !std::io::stdin().is_terminal() || !std::io::stderr().is_terminal() {
        return Err(missing());
    }
    loop {
        eprint!("{question}: ");
        let mut line = String::new();
        let flushed = std::io::stderr().flush();
        let read = flushed.and_then(|()| std::io::stdin().lock().read_line(&mut line));
        if !read.is_ok_and(|bytes| bytes > 0) {
            return Err(missing());
        }
        match parse(line.trim()) {
            Some(answer) => return Ok(answer),
            None => eprintln!("\"{}\" is {wrong}", line.trim()),
        }
    }
}
