//! Flags that every command has, and options beside a scene.

use crate::common::{
    Folder, SMALL, command, eit, read_array, read_text, refuse, stderr, stdout, succeed,
};

fn colored(line: &str, environment: &[(&str, &str)]) -> bool {
    let mut command = command(line);
    command.env_remove("NO_COLOR").envs(environment.iter().copied());
    let output = command.output().unwrap();
    [output.stdout, output.stderr].concat().contains(&0x1b)
}

/// Nothing in a pipe is coloured unless it is asked for, whatever the environment says; the flag wins over NO_COLOR.
#[test]
fn colours_are_asked_for() {
    for line in ["--help", "plan no-such-scene", "plan"] {
        let with = |more: &str, environment: &[(&str, &str)]| {
            colored(&format!("{line} {more}"), environment)
        };
        assert!(!with("", &[]), "{line}");
        assert!(!with("--color never", &[("CLICOLOR_FORCE", "1")]), "{line}");
        assert!(with("--color=always", &[]), "{line}");
        assert!(with("--color always", &[("NO_COLOR", "1")]), "{line}");
    }
    assert!(!colored("plan paper-disc --color auto", &[("NO_COLOR", "1")]));
    assert!(refuse("plan paper-disc --color blue").contains("always"));
}

/// -v prints the time of stages, -q nothing but the result, both on the command's own side.
#[test]
fn stages_are_timed_or_nothing_is_said() {
    let folder = Folder::new();
    let scene = folder.write("scene.toml", SMALL);
    let out = folder.path("v.csv");
    let forward = |flag: &str| -> (String, String) {
        let output = eit(format!("forward {scene} --out {out} {flag}"));
        assert!(output.status.success());
        (stdout(&output), stderr(&output))
    };
    let (plain, noted) = forward("");
    assert!(!plain.is_empty() && noted.is_empty(), "{noted}");
    for flag in ["-q", "--quiet"] {
        assert_eq!(forward(flag), (plain.clone(), String::new()));
    }
    for flag in ["-v", "--verbose", "-v --color always"] {
        let (said, noted) = forward(flag);
        assert_eq!(said, plain);
        // each stage with its time, and what the libraries report of it
        // sizes of each stage
        for words in ["meshed the skin", "triangles", "set up the forward model", "unknowns"] {
            assert!(noted.contains(words), "no {words:?} in {noted}");
        }
        assert_eq!(noted.contains('\u{1b}'), flag.contains("always"), "{noted:?}");
        if flag.contains("always") {
            continue;
        }
        let is_time = |line: &str| line.starts_with("eit: ") && line.ends_with(" s");
        let is_event = |line: &str| line.contains(" DEBUG stage{name=") && line.contains(": eit_");
        assert!(noted.lines().any(is_time) && noted.lines().any(is_event), "{noted}");
        assert!(noted.lines().all(|line| is_time(line) || is_event(line)), "{noted}");
    }
    assert!(refuse("plan paper-disc -q -v").contains("cannot be used with"));
}

/// What was told on stderr while the work went on is not told again with the result: here that the electrodes are in
/// another order. The report has every note.
#[test]
fn a_note_is_reported_once() {
    let folder = Folder::new();
    let content = SMALL.replace("[protocol]", "[protocol]\ncheck_order = false");
    let scene = folder.write("scene.toml", &content);
    let out = folder.path("out");
    let row = |r: usize| (0..40).map(|i| format!("{}", 1 + (7 * i + r) % 11)).collect::<Vec<_>>();
    let rows: Vec<String> = (0..12).map(|r| row(r % 3).join(",")).collect();
    let frames = folder.write("f.csv", rows.join("\n") + "\n");
    let output = eit(format!(
        "reconstruct {scene} --frames {frames} --reference 0..10 --method gauss-newton --out {out}"
    ));
    let (said, noted) = (stdout(&output), stderr(&output));
    assert!(output.status.success(), "{noted}");
    let words = "explains the reference poorly";
    let times = [&said, &noted].map(|text| text.matches(words).count());
    assert_eq!(times, [0, 1], "{said}{noted}");
    let report = read_text(format!("{out}/report.json"));
    assert_eq!(report.matches(words).count(), 1, "{report}");
}

/// Options of eit.toml count for their command and only for scenes beside it; those given win; mistakes are named.
#[test]
fn options_stand_beside_the_scene() {
    let folder = Folder::new();
    let scene = folder.write("scene.toml", SMALL);
    let out = folder.path("frames.npy");
    let simulate = |more: &str| eit(format!("simulate {scene} --nodes 900 --out {out} {more}"));
    let options = folder.write(
        "eit.toml",
        "[simulate]\nframes = 23\nscript = \"press-and-hold\"\n[live]\nweb = true\n",
    );
    for (more, frames) in [("", 23), ("--frames 25", 25)] {
        assert!(simulate(more).status.success());
        assert_eq!(read_array::<ndarray::Ix2>(&out).nrows(), frames);
    }
    // other commands and built-in scenes do not see it
    succeed(format!("plan {scene}"));
    for (content, words) in [
        (
            "[simulate]\nframe = 3",
            "unexpected argument '--frame' found tip: a similar argument exists: '--frames'",
        ),
        ("[simulat]\nframes = 3", "[simulat]: not a command"),
        ("frames = 3", "[frames]: not a command"),
        ("[simulate]\nframes = true", "a value is required for '--frames <N>'"),
        ("[simulate]\njson = \"yes\"", "json"),
        ("[simulate]\nframes = \"many\"", "invalid value 'many'"),
        ("[simulate", "eit.toml"),
    ] {
        std::fs::write(&options, content).unwrap();
        let output = simulate("");
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{content}: {said}");
        assert!(said.contains(words) && said.contains("eit.toml"), "{content}: {said}");
        assert_eq!(said.lines().count(), 1, "{content}: {said}");
    }
    std::fs::remove_file(&options).unwrap();
    std::fs::create_dir(&options).unwrap();
    let said = stderr(&simulate(""));
    assert!(said.contains("eit.toml: not a file of at most"), "{said}");
}
