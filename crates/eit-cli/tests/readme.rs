//! The commands of README.md and of the guides run as written, in one folder, in order.
//!
//! Only these are excluded: lines that build or install with cargo, and lines that need a board on a port
//! (`/dev/`, `--port`) or run until they are stopped.
#![cfg(unix)]
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

use std::path::{Path, PathBuf};
use std::process::Command;

/// The lines of all `sh` blocks of a file.
fn shell_lines(name: &str) -> Vec<String> {
    let place = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(name);
    let text = std::fs::read_to_string(&place).unwrap();
    let mut lines = Vec::new();
    let mut is_shell = false;
    for line in text.lines() {
        match line.trim() {
            "```sh" => is_shell = true,
            "```" => is_shell = false,
            line if is_shell && !line.is_empty() && !line.starts_with('#') => {
                lines.push(line.to_owned());
            }
            _ => {}
        }
    }
    lines
}

fn needs_more(line: &str) -> bool {
    let live = ["eit check", "eit live", "eit record", "eit emulate"];
    line.starts_with("cargo ")
        || line.starts_with("$PYTHON")
        || ["/dev/", "--port"].iter().any(|word| line.contains(word))
        || live.iter().any(|command| line.starts_with(command))
}

/// Runs the lines that can run here; returns how many.
fn run(name: &str) -> usize {
    let folder = tempfile::tempdir().unwrap();
    let program = PathBuf::from(env!("CARGO_BIN_EXE_eit"));
    let path =
        format!("{}:{}", program.parent().unwrap().display(), std::env::var("PATH").unwrap());
    let lines: Vec<String> =
        shell_lines(name).into_iter().filter(|line| !needs_more(line)).collect();
    for line in &lines {
        let output =
            Command::new("sh").args(["-c", line]).env("PATH", &path).current_dir(&folder).output();
        let output = output.unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{name}: `{line}`: {said}");
    }
    lines.len()
}

#[test]
fn commands_of_the_readme() {
    // four to look around, three from a scene to touches
    assert!(run("README.md") >= 7);
}

#[test]
fn commands_of_the_guide_to_a_skin_of_ones_own() {
    let name = "docs/BUILD_A_SKIN.md";
    let board: Vec<String> =
        shell_lines(name).into_iter().filter(|line| needs_more(line)).collect();
    // every command that needs the board is run by `init.rs`, `silence.rs` or `instruments.rs`
    assert!(board.len() >= 5, "{board:?}");
    assert!(run(name) >= 1);
}
