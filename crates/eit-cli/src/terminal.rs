//! How much is printed, and in which colours. Set once, by the flags; the program has one terminal.

use crate::cli::{Cli, ColorWhen};
use std::io::IsTerminal;
use std::sync::OnceLock;

/// Flags that concern all output.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Flags {
    /// Whether progress and notes are left out.
    pub(crate) is_quiet: bool,
    /// Whether the time of every stage is printed.
    pub(crate) is_verbose: bool,
    /// Whether stdout is reserved for one JSON object.
    pub(crate) is_json: bool,
    color: ColorWhen,
}

static FLAGS: OnceLock<Flags> = OnceLock::new();

/// Sets the flags; only the first call counts.
pub(crate) fn set(cli: &Cli) {
    let Cli { quiet: is_quiet, verbose: is_verbose, json: is_json, color, .. } = *cli;
    FLAGS.get_or_init(|| Flags { is_quiet, is_verbose, is_json, color });
}

pub(crate) fn flags() -> Flags {
    FLAGS.get().copied().unwrap_or_default()
}

/// Whether to use colours on a stream.
pub(crate) fn is_colored(stream: &impl IsTerminal) -> bool {
    let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty());
    let is_plain = set("NO_COLOR").is_some() || set("TERM").is_some_and(|term| term == "dumb");
    choose(flags().color, stream.is_terminal(), is_plain)
}

/// The flag wins over the environment.
fn choose(when: ColorWhen, is_terminal: bool, is_plain: bool) -> bool {
    match when {
        ColorWhen::Always => true,
        ColorWhen::Never => false,
        ColorWhen::Auto => is_terminal && !is_plain,
    }
}

/// Colour requested before the command line is parsed, for `--help` and usage errors.
pub(crate) fn set_early(arguments: &[std::ffi::OsString]) {
    let words: Vec<_> = arguments.iter().filter_map(|argument| argument.to_str()).collect();
    let mut words = words.iter().flat_map(|word| word.split('='));
    let color = match words.by_ref().find(|word| *word == "--color").and_then(|_| words.next()) {
        Some("always") => ColorWhen::Always,
        Some("never") => ColorWhen::Never,
        _ => ColorWhen::Auto,
    };
    FLAGS.get_or_init(|| Flags { color, ..Flags::default() });
}

/// The name in front of errors, red where colours are used.
pub(crate) fn error_name() -> &'static str {
    if is_colored(&std::io::stderr()) { "\x1b[1;31meit:\x1b[0m" } else { "eit:" }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_flag_wins_then_the_environment_then_the_terminal() {
        for (when, is_terminal, is_plain, wanted) in [
            (ColorWhen::Auto, true, false, true),
            (ColorWhen::Auto, true, true, false),
            (ColorWhen::Auto, false, false, false),
            (ColorWhen::Always, false, true, true),
            (ColorWhen::Never, true, false, false),
        ] {
            assert_eq!(choose(when, is_terminal, is_plain), wanted, "{when:?}");
        }
    }
}
