//! A process with a time limit.

use std::io::Read as _;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Time limit of a peer's process, seconds; the slowest takes half a minute on an idle machine.
const LIMIT_S: f64 = 300.0;
/// Poll interval; the peers measure times with their own clocks.
const LOOK: Duration = Duration::from_millis(20);

/// Runs a process to its end, or kills it at the limit; an error gives the last line of its output.
pub(super) fn run(command: &mut Command) -> Result<(), String> {
    within(command, LIMIT_S)
}

fn within(command: &mut Command, limit_s: f64) -> Result<(), String> {
    let program = command.get_program().to_string_lossy().into_owned();
    // a file, not a pipe, because nobody reads while it runs
    let mut words = tempfile::tempfile().map_err(|e| format!("no temporary file: {e}"))?;
    let to = words.try_clone().map_err(|e| format!("no temporary file: {e}"))?;
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(to)
        .spawn()
        .map_err(|e| format!("cannot run {program}: {e}"))?;
    let start = Instant::now();
    let status = loop {
        match child.try_wait() {
            Ok(Some(status)) => break status,
            Ok(None) if start.elapsed().as_secs_f64() < limit_s => std::thread::sleep(LOOK),
            Ok(None) => {
                // the process may already have ended
                let _ = child.kill();
                let _ = child.wait();
                return Err(format!("killed after the time limit of {limit_s} s"));
            }
            Err(e) => return Err(format!("cannot wait for {program}: {e}")),
        }
    };
    if status.success() {
        return Ok(());
    }
    let mut text = Vec::new();
    // unreadable output counts as empty
    let _ = std::io::Seek::rewind(&mut words).and_then(|()| words.read_to_end(&mut text));
    let text = String::from_utf8_lossy(&text);
    Err(text.trim().lines().last().unwrap_or("no reason given").to_owned())
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn a_process_ends_by_itself_or_at_the_limit() {
        let shell =
            |script: &str, limit_s: f64| within(Command::new("sh").args(["-c", script]), limit_s);
        assert_eq!(shell("exit 0", 60.0), Ok(()));
        assert_eq!(
            shell("echo first >&2; echo last words >&2; exit 3", 60.0).unwrap_err(),
            "last words"
        );
        assert_eq!(shell("exit 3", 60.0).unwrap_err(), "no reason given");
        let start = Instant::now();
        let error = shell("exec sleep 600", 0.1).unwrap_err();
        assert!(error.contains("0.1 s"), "{error}");
        assert!(start.elapsed().as_secs_f64() < 300.0, "it was ended");
        assert!(
            within(&mut Command::new("./no-such-program"), 1.0).unwrap_err().contains("no-such")
        );
    }
}
