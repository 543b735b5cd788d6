//! Events of the libraries as lines on stderr, with --verbose.

use crate::{progress, terminal};
use std::io::{self, Write};
use tracing::Level;
use tracing_subscriber::filter::{LevelFilter, filter_fn};
use tracing_subscriber::fmt::time::uptime;
use tracing_subscriber::layer::{Layer, SubscriberExt};

/// Shows the events of this project's crates from now on, if --verbose was given. Without it there is no
/// subscriber, and an event costs one comparison.
pub(crate) fn show() {
    if !terminal::flags().is_verbose {
        return;
    }
    let ours = filter_fn(|about| {
        // the command prints the time of each stage itself
        let is_stage = about.is_event() && about.target() == "eit_skin::progress";
        about.target().starts_with("eit_") && *about.level() <= Level::DEBUG && !is_stage
    });
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(|| Stderr)
        .with_ansi(terminal::is_colored(&io::stderr()))
        .with_timer(uptime())
        .with_filter(ours.with_max_level_hint(LevelFilter::DEBUG));
    // fails only if there is a subscriber already
    let _ = tracing::subscriber::set_global_default(tracing_subscriber::registry().with(lines));
}

/// Standard error above the progress bars.
struct Stderr;

impl Write for Stderr {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        progress::above(|| io::stderr().write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stderr().flush()
    }
}
