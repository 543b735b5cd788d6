//! Ctrl-C, a closed terminal and a request to terminate end live commands cleanly: files are complete and
//! listed.

use crate::error::CliError;
use eit_skin::StopFlag;
#[cfg(unix)]
use std::sync::Arc;
#[cfg(unix)]
use std::sync::OnceLock;
#[cfg(unix)]
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Whether the command ends by itself after a signal.
#[cfg(unix)]
static LISTENS: AtomicBool = AtomicBool::new(false);
/// The last signal, or 0.
#[cfg(unix)]
static SIGNAL: OnceLock<Arc<AtomicUsize>> = OnceLock::new();

/// Lets Ctrl-C, a closed terminal and a request to terminate end the program as they do by default, but
/// removes its temporary files first. A command that [listens](listen) ends by itself instead.
#[cfg(unix)]
pub(crate) fn end_tidily() {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    /// How often to check for a signal; a handler itself may not remove files.
    const LOOK: std::time::Duration = std::time::Duration::from_millis(20);
    let got = SIGNAL.get_or_init(Arc::default);
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        // without a handler the signal has its default effect
        if !is_ignored(signal) {
            let _ = signal_hook::flag::register_usize(signal, Arc::clone(got), signal as usize);
        }
    }
    std::thread::spawn(move || {
        loop {
            std::thread::sleep(LOOK);
            let signal = got.load(Ordering::SeqCst);
            if LISTENS.load(Ordering::SeqCst) {
                return;
            }
            if signal != 0 {
                eit_report::output::remove_temporaries();
                // ends the program
                let _ = signal_hook::low_level::emulate_default_handler(signal as i32);
            }
        }
    });
}

/// On other systems, signals keep their default effect.
#[cfg(not(unix))]
pub(crate) fn end_tidily() {}

/// Returns a flag that is set by Ctrl-C or the system's request to terminate; a second signal kills the
/// program.
pub(crate) fn listen() -> Result<StopFlag, CliError> {
    let stop = StopFlag::default();
    #[cfg(unix)]
    LISTENS.store(true, Ordering::SeqCst);
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
    // one that came just before
    #[cfg(unix)]
    if SIGNAL.get().is_some_and(|signal| signal.load(Ordering::SeqCst) != 0) {
        stop.shared().store(true, Ordering::SeqCst);
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
