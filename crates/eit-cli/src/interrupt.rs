//! Ctrl-C ends live commands cleanly: what is written is complete and named.

use crate::error::CliError;
use eit_skin::StopFlag;

/// A flag that Ctrl-C, and the system's request to terminate, set from now on; a second one kills.
pub(crate) fn listen() -> Result<StopFlag, CliError> {
    let stop = StopFlag::default();
    let failed = |e| CliError::Failure(format!("signals cannot be taken: {e}"));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        // in this order: the first finds the flag unset
        let kill =
            signal_hook::flag::register_conditional_shutdown(signal, 128 + signal, stop.shared());
        kill.map_err(failed)?;
        signal_hook::flag::register(signal, stop.shared()).map_err(failed)?;
    }
    Ok(stop)
}
