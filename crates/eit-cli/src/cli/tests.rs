//! Every command of the README, the book, the crates' pages and the help is one that the program understands.

use super::Cli;
use clap::error::ErrorKind;
use clap::{Command, CommandFactory as _, Parser as _};
use std::path::{Path, PathBuf};

/// Pages of the repository; none in the package of this crate.
fn pages() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut folders = vec![root.join("docs"), root.join("crates")];
    let mut pages = vec![root.join("README.md")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() && entry.file_name() != "src" {
                folders.push(path);
            } else if path.extension().is_some_and(|ending| ending == "md") {
                pages.push(path);
            }
        }
    }
    pages.retain(|page| page.exists());
    pages
}

/// The `eit` commands of the `sh` blocks of a page, without what a shell adds.
fn commands(page: &Path) -> Vec<String> {
    let mut commands = Vec::new();
    let mut is_shell = false;
    for line in std::fs::read_to_string(page).unwrap().lines() {
        let line = line.trim();
        if line.starts_with("```") {
            is_shell = line.split([' ', '`']).any(|word| word == "sh");
        }
        let line = line
            .strip_prefix("cargo run --release -p eit-cli --")
            .map_or(line.to_owned(), |rest| format!("eit{rest}"));
        if is_shell && line.starts_with("eit ") {
            let end = line.find(['#', '|', ';', '&']).unwrap_or(line.len());
            commands.push(line[..end].trim().to_owned());
        }
    }
    commands
}

#[test]
fn every_documented_command_parses() {
    let pages = pages();
    if pages.len() < 5 {
        println!("skipped: the book is not part of this package");
        return;
    }
    let mut count = 0;
    for page in &pages {
        for command in commands(page) {
            // no argument of the book has a space
            match Cli::try_parse_from(command.split_whitespace()) {
                Ok(_) => {}
                Err(error) if !error.use_stderr() => {}
                Err(error) => panic!("{}: `{command}`: {error}", page.display()),
            }
            count += 1;
        }
    }
    assert!(count >= 35, "only {count} commands found");
}

/// The `eit` commands of a help text: whole lines, which are examples (`true`), and mentions in backticks.
fn examples(command: &Command, found: &mut Vec<(String, bool)>) {
    let texts = [command.get_long_about(), command.get_after_help()];
    for text in texts.into_iter().flatten().map(ToString::to_string) {
        for line in text.lines().map(str::trim) {
            let line = line.trim_start_matches("Examples: ").trim_start_matches("Example: ");
            let mentions = line.split('`').skip(1).step_by(2).map(|text| (text, false));
            let whole = (!line.contains('`')).then_some((line, true));
            let commands = whole.into_iter().chain(mentions);
            let commands = commands.filter(|(text, _)| text.starts_with("eit "));
            // what follows two spaces explains
            let command = |text: &str| text.split("  ").next().unwrap().to_owned();
            found.extend(commands.map(|(text, is_whole)| (command(text), is_whole)));
        }
    }
    command.get_subcommands().for_each(|command| examples(command, found));
}

/// Examples parse; what prose mentions has words and options that exist, but not every argument.
#[test]
fn every_example_of_the_help_parses() {
    let mut found = Vec::new();
    examples(&Cli::command(), &mut found);
    for (example, is_whole) in &found {
        let words = example.split_whitespace().take_while(|word| *word != ">");
        let Err(error) = Cli::try_parse_from(words) else { continue };
        let unknown = [ErrorKind::UnknownArgument, ErrorKind::InvalidSubcommand];
        assert!(!is_whole && !unknown.contains(&error.kind()), "`{example}`: {error}");
    }
    let whole = found.iter().filter(|(_, is_whole)| *is_whole).count();
    // 31 examples today: the search still finds them
    assert!(whole >= 31 && found.len() >= 35, "only {whole} examples of {} found", found.len());
}
