//! Flags that every command has, and options beside a scene.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "tests")]

use crate::common::{SMALL, eit, refuse, text, write_scene};
use std::process::{Command, Output};

fn colored(arguments: &[&str], environment: &[(&str, &str)]) -> bool {
    let output = Command::new(env!("CARGO_BIN_EXE_eit"))
        .args(arguments)
        .env_remove("NO_COLOR")
        .envs(environment.iter().copied())
        .output()
        .unwrap();
    [output.stdout, output.stderr].concat().contains(&0x1b)
}

/// Nothing in a pipe is coloured unless it is asked for, whatever the environment says; the flag wins over NO_COLOR.
#[test]
fn colours_are_asked_for() {
    for command in [&["--help"][..], &["plan", "no-such-scene"], &["plan"]] {
        let with = |more: &[&str], environment: &[(&str, &str)]| {
            colored(&[command, more].concat(), environment)
        };
        assert!(!with(&[], &[]), "{command:?}");
        assert!(!with(&["--color", "never"], &[("CLICOLOR_FORCE", "1")]), "{command:?}");
        assert!(with(&["--color=always"], &[]), "{command:?}");
        assert!(with(&["--color", "always"], &[("NO_COLOR", "1")]), "{command:?}");
    }
    assert!(!colored(&["plan", "paper-disc", "--color", "auto"], &[("NO_COLOR", "1")]));
    assert!(refuse(&["plan", "paper-disc", "--color", "blue"]).contains("always"));
}

/// -v prints the time of stages, -q nothing but the result, both on the command's own side.
#[test]
fn stages_are_timed_or_nothing_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let scene = write_scene(folder.path(), SMALL);
    let out = folder.path().join("v.csv");
    let forward = |flag: &[&str]| -> (String, String) {
        let output = eit(&[&["forward", text(&scene), "--out", text(&out)], flag].concat());
        assert!(output.status.success());
        let [said, noted] = [output.stdout, output.stderr].map(|b| String::from_utf8(b).unwrap());
        (said, noted)
    };
    let (plain, noted) = forward(&[]);
    assert!(!plain.is_empty() && noted.is_empty(), "{noted}");
    for flag in ["-q", "--quiet"] {
        assert_eq!(forward(&[flag]), (plain.clone(), String::new()));
    }
    for flag in ["-v", "--verbose"] {
        let (said, noted) = forward(&[flag]);
        assert_eq!(said, plain);
        // each stage with its time, and what the libraries report of it
        let is_time = |line: &str| line.starts_with("eit: ") && line.ends_with(" s");
        let is_event = |line: &str| line.contains(" DEBUG stage{name=") && line.contains(": eit_");
        assert!(noted.lines().any(is_time) && noted.lines().any(is_event), "{noted}");
        assert!(noted.lines().all(|line| is_time(line) || is_event(line)), "{noted}");
    }
    assert!(refuse(&["plan", "paper-disc", "-q", "-v"]).contains("cannot be used with"));
}

/// What was told on stderr while the work went on is not told again with the result: here that the electrodes are in
/// another order. The report has every note.
#[test]
fn a_note_is_told_once() {
    let folder = tempfile::tempdir().unwrap();
    let content = SMALL.replace("[protocol]", "[protocol]\ncheck_order = false");
    let scene = write_scene(folder.path(), &content);
    let (frames, out) = (folder.path().join("f.csv"), folder.path().join("out"));
    let row = |r: usize| (0..40).map(|i| format!("{}", 1 + (7 * i + r) % 11)).collect::<Vec<_>>();
    let rows: Vec<String> = (0..12).map(|r| row(r % 3).join(",")).collect();
    std::fs::write(&frames, rows.join("\n") + "\n").unwrap();
    let output = eit(&[
        "reconstruct",
        text(&scene),
        "--frames",
        text(&frames),
        "--reference",
        "0..10",
        "--method",
        "gauss-newton",
        "--out",
        text(&out),
    ]);
    let [said, noted] = [output.stdout, output.stderr].map(|b| String::from_utf8(b).unwrap());
    assert!(output.status.success(), "{noted}");
    let words = "explains the reference poorly";
    assert_eq!(
        (said.matches(words).count(), noted.matches(words).count()),
        (0, 1),
        "{said}{noted}"
    );
    let report = std::fs::read_to_string(out.join("report.json")).unwrap();
    assert_eq!(report.matches(words).count(), 1, "{report}");
}

/// Options of eit.toml count for their command and only for scenes beside it; those given win; mistakes are named.
#[test]
fn options_stand_beside_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let scene = write_scene(folder.path(), SMALL);
    let options = folder.path().join("eit.toml");
    let simulate = |more: &[&str]| -> Output {
        let out = folder.path().join("frames.npy");
        let fixed = ["simulate", text(&scene), "--nodes", "900", "--out", text(&out)];
        eit(&[&fixed[..], more].concat())
    };
    let frames = || -> usize {
        let read = ndarray_npy::read_npy(folder.path().join("frames.npy"));
        ndarray::Array2::<f64>::nrows(&read.unwrap())
    };
    std::fs::write(
        &options,
        "[simulate]\nframes = 23\nscript = \"press-and-hold\"\n[live]\nweb = true\n",
    )
    .unwrap();
    assert!(simulate(&[]).status.success());
    assert_eq!(frames(), 23);
    assert!(simulate(&["--frames", "25"]).status.success());
    assert_eq!(frames(), 25);
    // other commands and built-in scenes do not see it
    assert!(eit(&["plan", text(&scene)]).status.success());
    for (content, words) in [
        ("[simulate]\nframe = 3", "[simulate] frame: no such option; known are"),
        ("[simulat]\nframes = 3", "[simulat]: not a command"),
        ("frames = 3", "[frames]: not a command"),
        ("[simulate]\nframes = true", "frames = true: not a value"),
        ("[simulate]\njson = \"yes\"", "json"),
        ("[simulate]\nframes = \"many\"", "invalid value 'many'"),
        ("[simulate", "eit.toml"),
    ] {
        std::fs::write(&options, content).unwrap();
        let output = simulate(&[]);
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{content}: {said}");
        assert!(said.contains(words) && said.contains("eit.toml"), "{content}: {said}");
        assert_eq!(said.lines().count(), 1, "{content}: {said}");
    }
    std::fs::remove_file(&options).unwrap();
    std::fs::create_dir(&options).unwrap();
    let said = String::from_utf8(simulate(&[]).stderr).unwrap();
    assert!(said.contains("eit.toml: not a file of at most"), "{said}");
}
