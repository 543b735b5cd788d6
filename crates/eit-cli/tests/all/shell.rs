//! Completions and manual pages, compared with the shell and the commands that `eit --help` lists.

use crate::common::*;

/// Commands as a help lists them, without `help`.
pub fn commands(help: &str) -> Vec<String> {
    let help = succeed(help);
    let lines = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let lines = lines.take_while(|line| !line.trim().is_empty());
    let name = |line: &str| line.split_whitespace().next().unwrap().to_owned();
    lines.map(name).filter(|name| name != "help").collect()
}

#[test]
fn every_command_has_a_manual_page() {
    let (_folder, [out]) = Folder::with_paths(["man1"]);
    let said = succeed(format!("man --out {out}"));
    let nested = commands("net --help").into_iter().map(|name| format!("net-{name}"));
    let names = commands("--help").into_iter().chain(nested);
    let mut wanted: Vec<String> = names.map(|name| format!("eit-{name}.1")).collect();
    wanted.push("eit.1".to_owned());
    wanted.sort();
    assert!(wanted.len() > 20 && said.starts_with(&format!("{} manual pages", wanted.len())));
    assert_eq!(names_in(&out), wanted);
    let live = read_text(format!("{out}/eit-live.1"));
    assert!(live.contains(".TH") && live.contains(r"\-\-json\-lines"), "{live}");
}

#[test]
fn completions_name_every_command_for_every_shell() {
    let commands = commands("--help");
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = succeed(format!("completions {shell}"));
        says(&script, commands.join("…") + "…json-lines");
    }
    refuse_each([("completions cmd", "cmd…bash")]);
}

/// Bash itself completes `eit li`, if it is installed.
#[cfg(unix)]
#[test]
fn bash_completes_a_command() {
    let folder = Folder::new();
    let script = folder.write("eit.bash", succeed("completions bash"));
    let complete = "COMP_WORDS=(eit li); COMP_CWORD=1; _eit eit li eit; echo \"${COMPREPLY[*]}\"";
    let ask = format!("source {script}; {complete}");
    let Ok(output) = Command::new("bash").args(["-c", &ask]).output() else {
        println!("skipped: no bash");
        return;
    };
    assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), "live");
}
