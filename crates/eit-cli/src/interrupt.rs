//! Ctrl-C, the end of the terminal and a request to terminate end live commands cleanly: what is written is complete and named.

use crate::error::CliError;
use eit_skin::StopFlag;
#[cfg(unix)]
use std::sync::Arc;

/// A flag that Ctrl-C, and the system's request to terminate, set from now on; a second one kills.
pub(crate) fn listen() -> Result<StopFlag, CliError> {
    let stop = StopFlag::default();
    let failed = |e| CliError::Failure(format!("signals cannot be taken: {e}"));
    #[cfg(unix)]
    {
        use signal_hook::consts::{SIGHUP, SIGXFSZ};
        // a terminal that is closed ends it like Ctrl-C; where `nohup` asked for it, it goes on
        signal_hook::flag::register(SIGHUP, stop.shared()).map_err(failed)?;
        // a file beyond the user's limit is an error of its write, and no end of the program
        signal_hook::flag::register(SIGXFSZ, Arc::default()).map_err(failed)?;
    }
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        // in this order: the first finds the flag unset
        let kill =
            signal_hook::flag::register_conditional_shutdown(signal, 128 + signal, stop.shared());
        kill.map_err(failed)?;
        signal_hook::flag::register(signal, stop.shared()).map_err(failed)?;
    }
    Ok(stop)
}
