//! Ctrl-C, a closed terminal and a request to terminate end live commands cleanly: files are complete and
//! listed.

use crate::error::CliError;
use eit_skin::StopFlag;
#[cfg(unix)]
use std::sync::Arc;

/// Returns a flag that is set by Ctrl-C or the system's request to terminate; a second signal kills the
/// program.
pub(crate) fn listen() -> Result<StopFlag, CliError> {
    let stop = StopFlag::default();
    let failed = |e| CliError::Failure(format!("signal handlers cannot be installed: {e}"));
    #[cfg(unix)]
    {
        use signal_hook::consts::{SIGHUP, SIGXFSZ};
        // a closed terminal acts like Ctrl-C, unless the program was started with `nohup`
        if !is_ignored(SIGHUP) {
            signal_hook::flag::register(SIGHUP, stop.shared()).map_err(failed)?;
        }
        // a file beyond the user's size limit is a write error, and does not end the program
        signal_hook::flag::register(SIGXFSZ, Arc::default()).map_err(failed)?;
    }
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        // in this order: the first handler must see the flag unset
        let kill =
            signal_hook::flag::register_conditional_shutdown(signal, 128 + signal, stop.shared());
        kill.map_err(failed)?;
        signal_hook::flag::register(signal, stop.shared()).map_err(failed)?;
    }
    Ok(stop)
}

/// Whether the program was started with this signal ignored. A handler would override that, and asking the
/// system directly needs `unsafe`; if unknown, false.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    // bit 0 is signal 1
    ignored_signals().is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}

/// Linux: read from the process's status.
#[cfg(target_os = "linux")]
fn ignored_signals() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"))?;
    u64::from_str_radix(mask.trim(), 16).ok()
}

/// Other Unix systems, such as macOS: ask `ps`.
#[cfg(all(unix, not(target_os = "linux")))]
fn ignored_signals() -> Option<u64> {
    let id = std::process::id().to_string();
    let output = std::process::Command::new("ps").args(["-o", "sigignore=", "-p", &id]).output();
    let text = String::from_utf8(output.ok()?.stdout).ok()?;
    u64::from_str_radix(text.trim().trim_start_matches("0x"), 16).ok()
}
