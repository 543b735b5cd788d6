//! Options that stand beside a scene: `eit.toml`, with a table for each command.

use crate::cli::Cli;
use crate::error::CliError;
use clap::parser::ValueSource;
use clap::{Arg, ArgMatches, Command, CommandFactory as _, FromArgMatches as _};
use std::ffi::OsString;
use std::io::ErrorKind;
use std::path::Path;
use toml::{Table, Value};

/// Parses the command line, and adds the options of the file beside the scene that it does not give. The outer
/// error is one of that file, the inner one of the command line.
pub(crate) fn parse(mut arguments: Vec<OsString>) -> Result<Result<Cli, clap::Error>, CliError> {
    let program = signed(Cli::command());
    let mut matches = match program.clone().try_get_matches_from(&arguments) {
        Ok(matches) => matches,
        Err(error) => return Ok(Err(error)),
    };
    if let Some((place, more)) = beside_scene(&program, &matches)? {
        arguments.extend(more);
        // the arguments were valid without the file
        let refused = |error| CliError::input(format!("{place}: {}", one_line(&error)));
        matches = program.try_get_matches_from(arguments).map_err(refused)?;
    }
    Ok(Cli::from_arg_matches(&matches))
}

/// A command in which `-1` after an option is its value, to be rejected as such: clap would take it for another
/// option and advise `-- -1`, which no command takes.
fn signed(command: Command) -> Command {
    let of_option = |arg: Arg| match !arg.is_positional() && arg.get_action().takes_values() {
        true => arg.allow_negative_numbers(true),
        false => arg,
    };
    command.mut_subcommands(signed).mut_args(of_option)
}

/// An error of the arguments and its tips on one line; those on numbers say which are taken.
pub(crate) fn one_line(error: &clap::Error) -> String {
    let text = error.render().to_string();
    // lines before the usage, or before the pointer to --help where there is none
    let is_end =
        |line: &str| line.starts_with("Usage:") || line.starts_with("For more information");
    let lines = text.lines().take_while(|line| !is_end(line)).map(str::trim);
    let text = lines.filter(|line| !line.is_empty()).collect::<Vec<_>>().join(" ");
    // all whole numbers of the program are unsigned
    text.trim_start_matches("error: ")
        .replace("invalid digit found in string", "give a whole number, 0 or above")
        .replace("invalid float literal", "give a number")
}

/// The file beside a command's scene, and its options for that command.
fn beside_scene(
    program: &Command,
    matches: &ArgMatches,
) -> Result<Option<(String, Vec<OsString>)>, CliError> {
    let (mut names, mut given) = (Vec::new(), matches);
    while let Some((name, next)) = given.subcommand() {
        names.push(name);
        given = next;
    }
    let scene = given.try_get_one::<String>("scene").ok().flatten();
    let Some(scene) = scene.map(Path::new).filter(|scene| scene.is_file()) else { return Ok(None) };
    let path = scene.with_file_name("eit.toml");
    let place = path.display().to_string();
    let refuse = |why: String| Err(CliError::input(format!("{place}: {why}")));
    if std::fs::metadata(&path).is_ok_and(|data| !data.is_file() || data.len() > 64 << 10) {
        return refuse("not a file of at most 64 kB".to_owned());
    }
    let text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => return refuse(error.to_string()),
    };
    let file: Table = match text.parse() {
        Ok(file) => file,
        Err(error) => return refuse(error.to_string().trim().replace('\n', " ")),
    };
    let is_command = |(name, value): &(&String, &Value)| {
        program.find_subcommand(name).is_some() && value.is_table()
    };
    if let Some((name, _)) = file.iter().find(|table| !is_command(table)) {
        return refuse(format!("[{name}]: not a command; give tables such as [live]"));
    }
    let file = Value::Table(file);
    let table = names.iter().try_fold(&file, |table, name| table.get(name));
    let mut more = Vec::new();
    for (key, value) in table.and_then(Value::as_table).into_iter().flatten() {
        let id = key.replace('-', "_");
        let is_known = given.try_contains_id(&id).is_ok();
        if is_known && given.value_source(&id) == Some(ValueSource::CommandLine) {
            continue;
        }
        let Some(values) = values(value) else {
            return refuse(format!("[{}] {key} = {value}: not a value", names.join(".")));
        };
        let long = format!("--{}", key.replace('_', "-"));
        let word = |value: Option<String>| value.map_or(long.clone(), |v| format!("{long}={v}"));
        more.extend(values.into_iter().map(|value| OsString::from(word(value))));
    }
    Ok(Some((place, more)))
}

/// Values to give: `None` for the option alone. Nothing for `false`, several for a list.
fn values(value: &Value) -> Option<Vec<Option<String>>> {
    Some(match value {
        Value::Boolean(true) => vec![None],
        Value::Boolean(false) => Vec::new(),
        Value::String(text) => vec![Some(text.clone())],
        Value::Integer(number) => vec![Some(number.to_string())],
        Value::Float(number) => vec![Some(number.to_string())],
        Value::Array(list) => list.iter().map(values).collect::<Option<Vec<_>>>()?.concat(),
        Value::Datetime(_) | Value::Table(_) => return None,
    })
}
