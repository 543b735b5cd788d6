//! Completions and manual pages, compared with the shell and the commands that `eit --help` lists.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

use crate::common;
use crate::common::{refuse, succeed, text};

/// Commands as the help lists them.
fn commands() -> Vec<String> {
    let help = succeed(&["--help"]);
    let lines = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let lines = lines.take_while(|line| !line.trim().is_empty());
    let name = |line: &str| line.split_whitespace().next().unwrap().to_owned();
    let names: Vec<String> = lines.map(name).filter(|name| name != "help").collect();
    assert!(names.len() > 18 && names.contains(&"live".to_owned()), "{names:?}");
    names
}

#[test]
fn every_command_has_a_manual_page() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("man1");
    let commands = commands();
    let said = succeed(&["man", "--out", text(&out)]);
    assert!(said.starts_with(&format!("{} manual pages", commands.len() + 1)), "{said}");
    let mut pages: Vec<String> = std::fs::read_dir(&out)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    let mut wanted: Vec<String> = commands.iter().map(|name| format!("eit-{name}.1")).collect();
    wanted.push("eit.1".to_owned());
    pages.sort();
    wanted.sort();
    assert_eq!(pages, wanted);
    let live = std::fs::read_to_string(out.join("eit-live.1")).unwrap();
    assert!(live.contains(".TH") && live.contains(r"\-\-json\-lines"), "{live}");
    // a file where the folder should be
    let page = out.join("eit.1");
    let said = common::refuse(&["man", "--out", text(&page)]);
    assert!(said.contains("eit.1: is a file"), "{said}");
}

#[test]
fn completions_name_every_command_for_every_shell() {
    let commands = commands();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = succeed(&["completions", shell]);
        for command in &commands {
            assert!(script.contains(command.as_str()), "{shell} does not know {command}");
        }
        assert!(script.contains("json-lines"), "{shell}");
    }
    let said = refuse(&["completions", "cmd"]);
    assert!(said.contains("cmd") && said.contains("bash"), "{said}");
}

/// Bash itself completes `eit li`, if it is installed.
#[cfg(unix)]
#[test]
fn bash_completes_a_command() {
    let folder = tempfile::tempdir().unwrap();
    let script = folder.path().join("eit.bash");
    std::fs::write(&script, succeed(&["completions", "bash"])).unwrap();
    let ask = format!(
        "source {}; COMP_WORDS=(eit li); COMP_CWORD=1; _eit eit li eit; echo \"${{COMPREPLY[*]}}\"",
        text(&script)
    );
    let Ok(output) = std::process::Command::new("bash").args(["-c", &ask]).output() else {
        println!("skipped: no bash");
        return;
    };
    assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), "live");
}
