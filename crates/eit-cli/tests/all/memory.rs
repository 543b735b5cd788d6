//! Memory of commands that read files: the whole process takes at most 64 MB plus ten times the file.
#![cfg(target_os = "linux")]
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "tests"
)]

use crate::common;
use crate::common::text;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

const MOST_BYTES: u64 = 64_000_000;
const FILE_BYTES: usize = 20_000_000;

/// Runs a command; returns its largest memory in bytes, and whether it succeeded.
fn peak(arguments: &[&str]) -> (u64, bool) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_eit"))
        .args(arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let status = format!("/proc/{}/status", child.id());
    let mut peak = 0;
    loop {
        // the largest so far, whenever it is asked
        let found = std::fs::read_to_string(&status).unwrap_or_default();
        let line = found.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kilobytes = line.and_then(|line| line.trim().strip_suffix(" kB")?.trim().parse().ok());
        peak = peak.max(1024 * kilobytes.unwrap_or(0_u64));
        if let Some(ended) = child.try_wait().unwrap() {
            return (peak, ended.success());
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn check(arguments: &[&str], file: &Path) {
    let bytes = std::fs::metadata(file).unwrap().len();
    let (peak, succeeded) = peak(arguments);
    println!("{:.1} MB of {:.1}: {arguments:?}", 1e-6 * peak as f64, 1e-6 * bytes as f64);
    assert!(succeeded, "{arguments:?}");
    assert!(peak > 1_000_000, "not measured");
    assert!(peak <= MOST_BYTES + 10 * bytes, "{arguments:?}: {peak} bytes, file of {bytes}");
}

#[test]
fn commands_that_read_take_little_memory() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (digits, line) = (path("digits.csv"), path("line.csv"));
    let row = format!("{}\n", vec!["7"; 208].join(","));
    let next = format!("{}\n", vec!["8"; 208].join(","));
    std::fs::write(&digits, [row, next].concat().repeat(FILE_BYTES / 832)).unwrap();
    std::fs::write(&line, format!("{}\n", vec!["7"; FILE_BYTES / 2].join(","))).unwrap();
    // the frames of 48 000 lines, as text, as an array and as a recording, and back
    let (array, recording) = (path("digits.npy"), path("digits.mcap"));
    check(&["convert", text(&digits), "--out", text(&path("copy.csv"))], &digits);
    check(&["convert", text(&digits), "--out", text(&array)], &digits);
    check(&["convert", text(&digits), "--scene", "paper-disc", "--out", text(&recording)], &digits);
    check(&["convert", text(&array), "--out", text(&path("array.csv"))], &array);
    check(&["convert", text(&recording), "--out", text(&path("recording.csv"))], &recording);
    check(&["convert", text(&recording), "--out", text(&path("copy.mcap"))], &recording);
    check(&["recover", text(&recording), text(&path("whole.mcap"))], &recording);
    check(&["convert", text(&line), "--out", text(&path("line.npy"))], &line);
    // a frame that no recording can hold is refused before any is written
    let refused = path("line.mcap");
    assert!(!peak(&["convert", text(&line), "--out", text(&refused)]).1);
    assert!(!refused.exists());
    let read = |name: &str| std::fs::read(path(name)).unwrap();
    assert_eq!(read("copy.csv"), read("array.csv"));
    assert_eq!(read("copy.csv"), read("recording.csv"));
}

/// Settings are refused beyond a size at which the most expensive content still fits the bound, and tables of presses
/// beyond a number: at once.
#[test]
fn settings_and_tables_take_little_memory() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let scene = common::SMALL;
    let all = 1 << 19;
    let filled = |unit: &str| {
        format!("{scene}\n[x]\na = [{}]\n", unit.repeat((all - 40 - scene.len()) / unit.len()))
    };
    let contents = ["1,", "[],", "{},", "\"\","].map(filled);
    for content in contents.iter().chain([&format!("{scene}{}", "\n".repeat(all - scene.len()))]) {
        let file = path("scene.toml");
        std::fs::write(&file, content).unwrap();
        let (peak, _) = peak(&["plan", text(&file)]);
        assert!(peak > 1_000_000 && peak <= MOST_BYTES + 10 * content.len() as u64, "{peak}");
        let said = common::eit(&["plan", text(&file)]);
        let said = String::from_utf8(said.stderr).unwrap();
        assert!(!said.contains("kB"), "not read: {said}");
        std::fs::write(&file, format!("{content}{}", " ".repeat(all))).unwrap();
        let said = common::refuse(&["plan", text(&file)]);
        assert!(said.contains("not a file of at most 512 kB"), "{said}");
    }
    let (presses, out) = (path("presses.csv"), path("a.learned"));
    std::fs::write(&presses, format!("x_m,y_m\n{}", "0,0\n".repeat(5_000_000))).unwrap();
    let learn = [
        "learn",
        "paper-disc",
        "--presses",
        text(&presses),
        "--frames",
        text(&presses),
        "--out",
        text(&out),
    ];
    let start = std::time::Instant::now();
    let (peak, succeeded) = peak(&learn);
    assert!(!succeeded && peak <= MOST_BYTES + 10 * 20_000_000, "{peak}");
    assert!(start.elapsed() < Duration::from_secs(60), "{:?}", start.elapsed());
    assert!(common::refuse(&learn).contains("more than 200000 presses"));
}
