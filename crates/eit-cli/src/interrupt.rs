//! Ctrl-C, a closed terminal and a request to terminate end live commands cleanly: files are complete and
//! listed.

use crate::error::CliError;
use eit_skin::StopFlag;
#[cfg(unix)]
use signal_hook::consts::{SIGHUP, SIGXFSZ};
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::{flag, low_level};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock, OnceLock};
use std::time::Duration;

/// The last signal, or 0.
static LAST: LazyLock<Arc<AtomicUsize>> = LazyLock::new(Arc::default);
/// The request to stop, once the command ends by itself after a signal.
static STOP: OnceLock<StopFlag> = OnceLock::new();

/// Lets Ctrl-C, a closed terminal and a request to terminate end the program as they do by default, but
/// removes its temporary files first. A command that [listens](listen) ends by itself instead; a second signal then
/// kills the program, unless it is another one of the closed terminal.
pub(crate) fn end_tidily() {
    for signal in [
        SIGINT,
        SIGTERM,
        #[cfg(unix)]
        SIGHUP,
    ] {
        // without a handler the signal has its default effect
        if !is_ignored(signal) {
            let _ = flag::register_usize(signal, Arc::clone(&LAST), signal as usize);
        }
    }
    // a handler itself may not remove files
    std::thread::spawn(|| {
        loop {
            std::thread::sleep(Duration::from_millis(20));
            let signal = LAST.swap(0, Ordering::SeqCst) as i32;
            match STOP.get() {
                _ if signal == 0 => {}
                Some(stop) if !stop.is_set() => stop.set(),
                #[cfg(unix)]
                Some(_) if signal == SIGHUP => {}
                Some(_) => low_level::exit(128 + signal),
                None => {
                    eit_report::output::remove_temporaries();
                    // ends the program as the signal does
                    #[cfg(unix)]
                    let _ = low_level::emulate_default_handler(signal);
                    low_level::exit(128 + signal);
                }
            }
        }
    });
}

/// Returns a flag that is set by Ctrl-C or the system's request to terminate, even if the program was started with
/// these ignored, as in the background of a script.
pub(crate) fn listen() -> Result<StopFlag, CliError> {
    let failed = |e| CliError::failure(format!("signal handlers cannot be installed: {e}"));
    for signal in [SIGINT, SIGTERM].into_iter().filter(|signal| is_ignored(*signal)) {
        flag::register_usize(signal, Arc::clone(&LAST), signal as usize).map_err(failed)?;
    }
    // a file beyond the user's size limit is a write error, and does not end the program
    #[cfg(unix)]
    flag::register(SIGXFSZ, Arc::default()).map_err(failed)?;
    Ok(STOP.get_or_init(StopFlag::default).clone())
}

/// Whether the program was started with this signal ignored, as `nohup` does with that of a closed terminal. A handler
/// would override that, and asking the system directly needs `unsafe`; if unknown, false.
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

#[cfg(not(unix))]
fn ignored_signals() -> Option<u64> {
    None
}
