//! `--verbose` shows the events of the libraries on stderr; without it there are none.
#![allow(clippy::unwrap_used, reason = "tests")]

use std::process::{Command, Output};

fn forward(flags: &[&str]) -> Output {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("v.csv");
    Command::new(env!("CARGO_BIN_EXE_eit"))
        .args(flags)
        .args(["forward", "paper-disc", "--out"])
        .arg(&out)
        .env_remove("NO_COLOR")
        .output()
        .unwrap()
}

#[test]
fn verbose_shows_sizes_of_each_stage() {
    let output = forward(&["--verbose"]);
    assert!(output.status.success());
    let text = String::from_utf8(output.stderr).unwrap();
    for word in
        ["meshed the skin", "triangles=", "set up the forward model", "unknowns=", "eit_fem"]
    {
        assert!(text.contains(word), "no {word:?} in {text}");
    }
    assert!(!text.contains('\u{1b}'), "colours in a pipe: {text:?}");
    let stdout = String::from_utf8(output.stdout).unwrap();
    assert!(!stdout.contains("meshed the skin"), "{stdout}");
}

#[test]
fn colours_follow_the_flag() {
    let output = forward(&["--verbose", "--color", "always"]);
    assert!(String::from_utf8(output.stderr).unwrap().contains('\u{1b}'));
}

#[test]
fn the_default_shows_none() {
    for flags in [&[][..], &["--quiet"][..]] {
        let output = forward(flags);
        assert!(output.status.success());
        let text = String::from_utf8(output.stderr).unwrap();
        assert!(!text.contains("meshed") && !text.contains("eit_"), "{text}");
    }
}
