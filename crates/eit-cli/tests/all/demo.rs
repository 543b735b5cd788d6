//! `eit demo` as a user runs it, and obstacles it may meet.
#![cfg(unix)]
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

use crate::common::{refuse, succeed, text};
use ndarray::Array3;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Maximum time that a test waits.
const LIMIT: Duration = Duration::from_secs(240);

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|e| panic!("{e}: {text}"))
}

fn images(folder: &Path) -> Array3<f64> {
    ndarray_npy::read_npy(folder.join("images.npy")).unwrap()
}

/// Fingers are found, every result exists, the page needs no other files, and the recordings reproduce
/// images, raw images and touches bit for bit.
#[test]
fn the_demo_finds_the_fingers_and_replays_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("demo");
    let answer = json(&succeed(&["demo", "--quick", "--out", text(&out), "--json"]));
    for experiment in answer["experiments"].as_array().unwrap() {
        let judged = &experiment["judged"];
        assert_eq!(experiment["line"], "a pseudo-terminal", "{experiment}");
        assert_eq!(experiment["frames"], 30);
        // measured 28 of 29 and 56 of 58, 3.7 and 2.1 mm, none invented, 0.48 and 0.31 of the error with a
        // U-net trained on other pixels; the first frame of a contact is not reported
        let [fingers, found] = ["fingers", "found"].map(|key| judged[key].as_u64().unwrap());
        assert!(fingers >= 29 && 10 * found >= 9 * fingers, "{judged}");
        assert!(10 * judged["invented"].as_u64().unwrap() <= fingers, "{judged}");
        assert!(judged["position_error_m"].as_f64().unwrap() < 6e-3, "{judged}");
        assert!(judged["error_over_raw"].as_f64().unwrap() < 0.8, "{judged}");
        // proven for every frame, as the scene requires
        assert!(experiment["images"]["worst_gap"].as_f64().unwrap() <= 0.1, "{experiment}");
    }
    for file in answer["files"].as_array().unwrap() {
        assert!(out.join(file.as_str().unwrap()).exists(), "{file}");
    }
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    // overview and tracks are in the page, the others and the movies beside it
    assert_eq!(page.matches("data:image/png;base64,").count(), 3);
    assert!(page.len() < 1_000_000 && !page.contains("data:image/gif"), "{} bytes", page.len());
    let named: Vec<&str> =
        page.split("<img src=\"").skip(1).map(|p| p.split('"').next().unwrap()).collect();
    let files = named.iter().filter(|name| !name.starts_with("data:"));
    assert_eq!(files.clone().count(), 11, "{named:?}");
    assert!(files.clone().all(|name| out.join(name).exists()), "{named:?}");
    for never in ["http:", "https:", "<script", "src=\"/", "href=\"/"] {
        assert!(!page.contains(never), "{never}");
    }
    for experiment in ["one-finger", "two-fingers"] {
        let (scene, again) = (out.join("scene.toml"), folder.path().join(experiment));
        let recording = out.join(format!("{experiment}.mcap"));
        let from = ["--from", text(&recording), "--out", text(&again)];
        succeed(&[&["replay", text(&scene)], &from[..]].concat());
        assert_eq!(images(&again).dim(), (30, 32, 32));
        for file in ["images.npy", "raw.npy", "touches.csv"] {
            let [one, other] =
                [&out.join(experiment), &again].map(|f| std::fs::read(f.join(file)).unwrap());
            assert!(one == other, "{experiment}: {file} differs");
        }
    }
}

/// A folder with other files, even a scene of the user's, is rejected by name and left unchanged; with
/// --force the demo writes next to them. Without a folder for the terminal's name the instrument is reached
/// by TCP, and the answer says so.
#[test]
fn other_content_is_never_written_over_and_tcp_stands_in() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("thesis");
    std::fs::create_dir(&out).unwrap();
    let names = ["a.txt", "b.txt", "c.txt", "d.txt", "scene.toml"];
    for name in names {
        std::fs::write(out.join(name), "mine").unwrap();
    }
    let said = refuse(&["demo", "--quick", "--out", text(&out)]);
    assert!(said.contains("contains a.txt, b.txt, c.txt and 2 more"), "{said}");
    assert!(said.contains("--force"), "{said}");
    for name in names {
        assert_eq!(std::fs::read_to_string(out.join(name)).unwrap(), "mine", "{name}");
    }
    std::fs::remove_file(out.join("scene.toml")).unwrap();
    let nowhere = folder.path().join("nowhere");
    let output = Command::new(env!("CARGO_BIN_EXE_eit"))
        .args(["demo", "--quick", "--force", "--out", text(&out)])
        .env("TMPDIR", &nowhere)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(said.contains("TCP on this computer, because no pseudo-terminal was available"));
    assert!(out.join("report.html").exists());
    assert_eq!(std::fs::read_to_string(out.join("a.txt")).unwrap(), "mine");
    // the demo's own files are accepted, the others still are not
    let said = refuse(&["demo", "--quick", "--out", text(&out)]);
    assert!(said.contains("contains a.txt, b.txt, c.txt and 1 more"), "{said}");
    assert!(out.join("report.html").exists(), "what was refused is left alone");
}

/// Ctrl-C in the middle: files are complete and listed, and the next demo accepts the folder.
#[test]
fn ctrl_c_leaves_whole_files() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("demo");
    // the whole demo takes more than half a minute: the signal arrives in the middle on any computer
    let child = Command::new(env!("CARGO_BIN_EXE_eit"))
        .args(["demo", "--out", text(&out), "--json"])
        .stdout(Stdio::piped())
        .stderr(Stdio::inherit())
        .spawn()
        .unwrap();
    let recording = out.join("one-finger.mcap");
    let start = Instant::now();
    while !recording.exists() {
        assert!(start.elapsed() < LIMIT, "no recording");
        std::thread::sleep(Duration::from_millis(10));
    }
    let interrupt = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(interrupt.success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    let answer = json(&String::from_utf8(output.stdout).unwrap());
    assert_eq!(answer["interrupted"], true, "{answer}");
    for file in answer["files"].as_array().unwrap() {
        assert!(out.join(file.as_str().unwrap()).exists(), "{file}");
    }
    let named = answer["files"].as_array().unwrap().len();
    assert_eq!(std::fs::read_dir(&out).unwrap().count(), named, "nothing that is not named");
    let capture = eit_hw::capture::read(&recording).unwrap();
    assert!(!capture.damage.unfinished, "its end is written");
    let is_frame =
        |entry: &&eit_hw::capture::Entry| matches!(entry, eit_hw::capture::Entry::Frame(_));
    let recorded = capture.entries.iter().filter(is_frame).count();
    let seen = answer["experiments"][0]["frames"].as_u64().unwrap() as usize;
    assert!(seen < 377, "{answer}");
    // the first 40 are the reference
    assert!((seen..=seen + 40).contains(&recorded), "{recorded} recorded, {seen} seen");
    if seen > 0 {
        assert_eq!(images(&out.join("one-finger")).dim(), (seen, 64, 64));
    }
    assert!(!out.join("report.html").exists());
    succeed(&["demo", "--quick", "--out", text(&out)]);
    assert!(out.join("report.html").exists());
}
