//! Options that stand beside a scene: `eit.toml`, with a table for each command.

use crate::cli::Cli;
use crate::error::CliError;
use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Command, CommandFactory as _, FromArgMatches as _};
use std::ffi::OsString;
use std::io::ErrorKind;
use std::path::Path;
use toml::{Table, Value};

/// File name of the options.
const FILE: &str = "eit.toml";

/// Largest file that is read.
const MOST_BYTES: u64 = 1 << 16;

/// Adds the options of the file beside the scene to the arguments, except those given explicitly.
/// Without such a file the arguments are unchanged.
pub(crate) fn parse(mut arguments: Vec<OsString>) -> Result<Result<Cli, clap::Error>, CliError> {
    let matches = match command().try_get_matches_from(&arguments) {
        Ok(matches) => matches,
        Err(error) => return Ok(Err(error)),
    };
    if let Some((name, given)) = matches.subcommand()
        && let Some((place, more)) = beside_scene(name, given)?
    {
        arguments.extend(more);
        // the arguments were valid without the file
        let refused = |error: clap::Error| {
            let text = words_of(&error);
            let first = text.lines().next().unwrap_or_default().trim_start_matches("error: ");
            CliError::input(format!("{place}: {first}"))
        };
        let matches = command().try_get_matches_from(arguments).map_err(refused)?;
        return Ok(Cli::from_arg_matches(&matches));
    }
    Ok(Cli::from_arg_matches(&matches))
}

/// The command line parser; it accepts `-1` as the value of an option, so that the value is
/// rejected by name. By default clap would take it for another option and suggest `-- -1`, which no
/// command accepts.
fn command() -> Command {
    let of_option = |arg: Arg| match !arg.is_positional() && arg.get_action().takes_values() {
        true => arg.allow_negative_numbers(true),
        false => arg,
    };
    Cli::command().mut_subcommands(|command| command.mut_args(of_option))
}

/// Text of an argument error; for numbers it includes the accepted range.
pub(crate) fn words_of(error: &clap::Error) -> String {
    let text = error.render().to_string();
    // all whole numbers of the program are unsigned
    text.replace("invalid digit found in string", "give a whole number, 0 or above")
        .replace("invalid float literal", "give a number")
}

/// The file beside a command's scene, and its options for that command.
fn beside_scene(
    name: &str,
    given: &ArgMatches,
) -> Result<Option<(String, Vec<OsString>)>, CliError> {
    let scene = given.try_get_one::<String>("scene").ok().flatten();
    let Some(scene) = scene.map(Path::new).filter(|scene| scene.is_file()) else { return Ok(None) };
    let path = scene.with_file_name(FILE);
    let place = path.display().to_string();
    if std::fs::metadata(&path).is_ok_and(|data| !data.is_file() || data.len() > MOST_BYTES) {
        let most_kb = MOST_BYTES >> 10;
        return Err(CliError::input(format!("{place}: not a file of at most {most_kb} kB")));
    }
    let text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(CliError::input(format!("{place}: {error}"))),
    };
    match options(&text, name, given) {
        Ok(options) => Ok(Some((place, options))),
        Err(error) => Err(error.within(&place)),
    }
}

/// Options of the table of this command.
fn options(text: &str, name: &str, given: &ArgMatches) -> Result<Vec<OsString>, CliError> {
    let file: Table = text
        .parse()
        .map_err(|e: toml::de::Error| CliError::input(e.to_string().trim().replace('\n', " ")))?;
    let program = Cli::command();
    for (table, value) in &file {
        if program.find_subcommand(table).is_none() || !value.is_table() {
            let message = format!("[{table}]: not a command; give tables such as [live]");
            return Err(CliError::input(message));
        }
    }
    let (Some(table), Some(command)) =
        (file.get(name).and_then(Value::as_table), program.find_subcommand(name))
    else {
        return Ok(Vec::new());
    };
    let mut options = Vec::new();
    for (key, value) in table {
        let long = key.replace('_', "-");
        let argument = command.get_arguments().find(|a| a.get_long() == Some(&long));
        let Some(argument) = argument else {
            let known: Vec<&str> = command.get_arguments().filter_map(|a| a.get_long()).collect();
            let message = format!("[{name}] {key}: no such option; known are {}", known.join(", "));
            return Err(CliError::input(message));
        };
        if given.value_source(argument.get_id().as_str()) == Some(ValueSource::CommandLine) {
            continue;
        }
        let is_flag = matches!(argument.get_action(), ArgAction::SetTrue);
        let may_be_bare = is_flag || argument.get_num_args().is_some_and(|n| n.min_values() == 0);
        let words = words(value).filter(|words| may_be_bare || !matches!(words[..], [None]));
        let Some(words) = words else {
            let message = format!("[{name}] {key} = {value}: not a value of this option");
            return Err(CliError::input(message));
        };
        for word in words {
            options.push(match word {
                None => format!("--{long}").into(),
                Some(word) if !is_flag => format!("--{long}={word}").into(),
                Some(_) => {
                    let message = format!("[{name}] {key} = {value}: give true or false");
                    return Err(CliError::input(message));
                }
            });
        }
    }
    Ok(options)
}

/// Converts a value of the file to arguments: `None` for the option alone, nothing for `false`,
/// several for a list.
fn words(value: &Value) -> Option<Vec<Option<String>>> {
    Some(match value {
        Value::Boolean(true) => vec![None],
        Value::Boolean(false) => Vec::new(),
        Value::String(text) => vec![Some(text.clone())],
        Value::Integer(number) => vec![Some(number.to_string())],
        Value::Float(number) => vec![Some(number.to_string())],
        Value::Array(list) => list.iter().map(words).collect::<Option<Vec<_>>>()?.concat(),
        Value::Datetime(_) | Value::Table(_) => return None,
    })
}
