//! Flags that every command has, and options beside a scene.

use crate::common::{
    Folder, all_said, altered, command, eit, read_array, read_text, recorded, refuse_each, says,
    stderr, stdout, succeed,
};

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
    // one of several files that have the same fault
    let cut = folder.write("g.csv", rows.join("\n"));
    let line = format!("reconstruct {scene} --frames {cut} {cut} {frames} {cut} --reference 0..10");
    let all = all_said(&eit(format!("{line} --method gauss-newton --out {out}")));
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
        assert!(simulate(more).status.success());
        assert_eq!(read_array::<ndarray::Ix2>(&out).nrows(), frames);
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
        let output = simulate("");
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{content}: {said}");
        assert!(said.contains(words) && said.contains("eit.toml"), "{content}: {said}");
        assert_eq!(said.lines().count(), 1, "{content}: {said}");
    }
    std::fs::remove_file(&options).unwrap();
    std::fs::create_dir(&options).unwrap();
    says(&stderr(&simulate("")), "eit.toml: not a file of at most");
}

/// A board that measures each electrode against the sink, with frames in rows or one value per line: refused with what
/// to set, and right once that is set.
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
    let frame: Vec<f64> =
        (0..256).map(|k| if is_driven(k) { 0.0 } else { voltages.next().unwrap() }).collect();
    assert_eq!(voltages.next(), None);
    let scaled =
        |k: usize| frame.iter().map(move |v| (v * (1.0 + 1e-4 * (k % 3) as f64)).to_string());
    let rows: Vec<String> = (0..12).map(|k| scaled(k).collect::<Vec<_>>().join(",")).collect();
    let lines: Vec<String> = (0..12).flat_map(scaled).collect();
    for (name, text) in [("rows.csv", rows.join("\n")), ("lines.txt", lines.join("\n"))] {
        folder.write(name, &text);
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

/// Another order is told before a table is converted; magnitudes calibrate like voltages.
#[test]
fn values_are_what_the_scene_says_or_are_refused() {
    let folder = Folder::new();
    let scene = folder.scene("");
    let ascending = altered("[mesh]", "order = \"ascending\"\n[mesh]");
    let ascending = folder.write("ascending.toml", ascending);
    let [table, out] = folder.paths(["v.csv", "v.mcap"]);
    succeed(format!("forward {ascending} --out {table}"));
    let convert = |scene: &str| format!("convert {table} --scene {scene} --out {out}");
    refuse_each([(convert(&scene), "set that…order = \"ascending\"")]);
    succeed(convert(&ascending));
    // all voltages of adjacent pairs have one sign: those of other conductivity as magnitudes give it back
    succeed(format!("forward {scene} --out {table}"));
    let sizes = recorded(&table, false).mapv(f64::abs);
    let sizes = folder.write_array("sizes.npy", &sizes);
    let guess = folder.altered("conductivity_s = 1e-5", "conductivity_s = 2e-5");
    let said = succeed(format!("calibrate {guess} --frames {sizes}"));
    says(&said, "the values are magnitudes…conductivity 1.0000e-5 S");
}
