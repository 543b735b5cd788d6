//! Flags that every command has, and options beside a scene.

use crate::common::*;

fn colored(line: &str, environment: &[(&str, &str)]) -> bool {
    let mut command = command(line);
    command.env_remove("NO_COLOR").envs(environment.iter().copied());
    all_said(&command.output().unwrap()).contains('\u{1b}')
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
    refuse_each([("plan paper-disc --color blue", "always")]);
}

/// -v prints the time of stages, -q nothing but the result, both on the command's own side.
#[test]
fn stages_are_timed_or_nothing_is_said() {
    let folder = Folder::new();
    let (scene, out) = (folder.scene(""), folder.path("v.csv"));
    let forward = |flag: &str| -> (String, String) {
        let output = eit(format!("forward {scene} --out {out} {flag}"));
        (stdout(&output), ended(&output, 0))
    };
    let (plain, noted) = forward("");
    assert!(!plain.is_empty() && noted.is_empty(), "{noted}");
    for flag in ["-q", "--quiet"] {
        assert_eq!(forward(flag), (plain.clone(), String::new()));
    }
    for flag in ["-v", "--verbose", "-v --color always"] {
        let (said, noted) = forward(flag);
        assert_eq!(said, plain);
        // each stage with its time, and what the libraries report of its size
        says(&noted, "meshed the skin…triangles…set up the forward model…unknowns");
        assert_eq!(noted.contains('\u{1b}'), flag.contains("always"), "{noted:?}");
        if flag.contains("always") {
            continue;
        }
        let is_time = |line: &str| line.starts_with("eit: ") && line.ends_with(" s");
        let is_event = |line: &str| line.contains(" DEBUG stage{name=") && line.contains(": eit_");
        assert!(noted.lines().any(is_time) && noted.lines().any(is_event), "{noted}");
        assert!(noted.lines().all(|line| is_time(line) || is_event(line)), "{noted}");
    }
    refuse_each([("plan paper-disc -q -v", "cannot be used with")]);
}

/// Either on stderr while the work goes on or with the result; the report has every note.
#[test]
fn a_note_is_reported_once() {
    let folder = Folder::new();
    let scene = folder.altered("[protocol]", "[protocol]\ncheck_order = false");
    let out = folder.path("out");
    let value = |(r, i): (usize, usize)| (1 + (7 * i + r % 3) % 11) as f64;
    let rows = table(&Array2::from_shape_fn((12, 40), value));
    let frames = folder.write("f.csv", &rows);
    let more = format!("--reference 0..10 --method gauss-newton --out {out}");
    let output = eit(format!("reconstruct {scene} --frames {frames} {more}"));
    let (said, noted) = (stdout(&output), ended(&output, 0));
    let words = "explains the reference poorly";
    assert_eq!([&said, &noted].map(|text| text.matches(words).count()), [0, 1], "{said}{noted}");
    let report = read_text(format!("{out}/report.json"));
    assert_eq!(report.matches(words).count(), 1, "{report}");
    // one of several files that have the same fault
    let cut = folder.write("g.csv", rows.trim_end());
    let line = format!("reconstruct {scene} --frames {cut} {cut} {frames} {cut} {more}");
    let all = all_said(&eit(line));
    assert_eq!(all.matches("has no line end").count(), 1, "{all}");
    assert!(all.contains("(2 more files have such a note)"), "{all}");
}

/// Options of eit.toml count for their command and only for scenes beside it; those given win; mistakes are named.
#[test]
fn options_stand_beside_the_scene() {
    let folder = Folder::new();
    let (scene, out) = (folder.scene(""), folder.path("frames.npy"));
    let simulate = |more: &str| eit(format!("simulate {scene} --nodes 900 --out {out} {more}"));
    let keys = "[simulate]\nframes = 23\nscript = \"press-and-hold\"\n[live]\nweb = true\n";
    let options = folder.write("eit.toml", keys);
    for (more, frames) in [("", 23), ("--frames 25", 25)] {
        ended(&simulate(more), 0);
        assert_eq!(read_array::<Ix2>(&out).nrows(), frames);
    }
    // other commands and built-in scenes do not see it
    succeed(format!("plan {scene}"));
    for (content, words) in [
        ("[simulate]\nframe = 3", "'--frame' found tip: a similar argument exists: '--frames'"),
        ("[simulat]\nframes = 3", "[simulat]: not a command"),
        ("frames = 3", "[frames]: not a command"),
        ("[simulate]\nframes = true", "a value is required for '--frames <N>'"),
        ("[simulate]\njson = \"yes\"", "json"),
        ("[simulate]\nframes = \"many\"", "invalid value 'many'"),
        ("[simulate", "eit.toml"),
    ] {
        std::fs::write(&options, content).unwrap();
        says(&one_line(&simulate(""), 2), format!("{words}…eit.toml"));
    }
    std::fs::remove_file(&options).unwrap();
    std::fs::create_dir(&options).unwrap();
    says(&stderr(&simulate("")), "eit.toml: not a file of at most");
}

/// A board that measures each electrode against the sink, in rows or one value per line: refused with what to set.
#[test]
fn potentials_are_recognised_by_what_they_are() {
    let folder = Folder::new();
    let electrodes = "[electrodes]\ncount = 16\nwidth_m = 0.008\ncontact_impedance_ohm_m = 0.5\n";
    let skin = "[skin]\nshape = \"disc\"\nradius_m = 0.1\nconductivity_s = 1e-3\n";
    // value k is of electrode k modulo 16, and k / 16 drives across the skin, to and fro
    let is_driven = |k: usize| k % 8 == k / 16 % 8;
    let sink = |k: usize| (k / 16 + 8) % 16;
    let quadruple = |k: usize| format!("{},{},{},{}\n", k / 16, sink(k), k % 16, sink(k));
    let all = (0..256).filter(|k| !is_driven(*k)).map(quadruple);
    folder.write("q.csv", &all.collect::<String>());
    let truth = "[protocol]\nquadruples_file = \"q.csv\"\ncurrent_a = 1e-3\n[mesh]\nnodes = 6000\n";
    let truth = folder.write("truth.toml", format!("{skin}{electrodes}{truth}"));
    let out = folder.path("v.csv");
    succeed(format!("forward {truth} --out {out}"));
    let mut voltages = recorded(&out, false).into_iter();
    let mut value = |k| if is_driven(k) { 0.0 } else { voltages.next().unwrap() };
    let frame: Vec<f64> = (0..256).map(&mut value).collect();
    assert_eq!(voltages.next(), None);
    let value = |(k, i): (usize, usize)| frame[i] * (1.0 + 1e-4 * (k % 3) as f64);
    let rows = table(&Array2::from_shape_fn((12, 256), value));
    for (name, text) in [("rows.csv", &rows), ("lines.txt", &rows.replace(',', "\n"))] {
        folder.write(name, text);
        let recording = format!(
            "[recording]\nfile = \"{name}\"\nreference = \"0..6\"\n[reconstruction]\npixels = 16\n"
        );
        let out = folder.path("out");
        let read = |protocol: &str| {
            let protocol = format!("[protocol]\n{protocol}\ncurrent_a = 1e-3\n{recording}");
            let scene = folder.write("scene.toml", format!("{skin}{electrodes}{protocol}"));
            eit(format!("reconstruct {scene} --out {out}"))
        };
        let said = stderr(&read("drive = \"adjacent\""));
        let (_, keys) = said.split_once("set [protocol] ").unwrap_or_else(|| panic!("{said}"));
        let (keys, _) = keys.split_once(" (").unwrap();
        let (first, back) = ("pairs = [[0, 8], [1, 9], ", "[8, 0], ");
        assert!(keys.starts_with(first) && keys.contains(back), "{said}");
        let keys = keys.replace(", measure", "\nmeasure").replace(", driven", "\ndriven");
        let output = read(&keys);
        let all = all_said(&output);
        let found = all.split_once("with correlation ").and_then(|(_, rest)| rest.split_once(','));
        // another mesh
        let is_explained = found.is_some_and(|(found, _)| found.parse::<f64>().unwrap() > 0.99);
        assert!(output.status.success() && is_explained, "{all}");
    }
}
