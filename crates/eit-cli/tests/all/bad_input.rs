//! Invalid input: exit code 2 and one line that says what is wrong, where, and how to fix it.

use crate::common::*;

/// One line of the small scene replaced.
#[test]
fn scenes_that_cannot_be() {
    let polygon = |keys: &str| format!("shape = \"polygon\"\noutline = {keys}");
    let millimetres = polygon("[[0, 0], [200, 0], [200, 100], [0, 100]]");
    let hole = "holes = [[[50, 50], [60, 50], [60, 60]]]";
    let far_hole = polygon(&format!("[[0, 0], [0.2, 0], [0.2, 0.1], [0, 0.1]]\n{hole}"));
    let disc = "shape = \"disc\"\nradius_m = 0.1";
    let cases = [
        ("radius_m = 0.1", "radius_m = 0.0", "radius"),
        ("radius_m = 0.1", "radius_m = 100.0", "skin.radius_m is 100: lengths are in metres"),
        (disc, &millimetres, "skin.outline, corner 2 is 200: lengths are in metres, of which a"),
        (disc, &millimetres, "has at most 10; 200 looks like millimetres, which are 0.2 metres"),
        (disc, &far_hole, "skin.holes, hole 1, corner 1 is 50: lengths are in metres"),
        ("radius_m = 0.1", "radius_m = -1.0", "-1"),
        ("radius_m = 0.1", "radius_m = nan", "NaN"),
        ("radius_m = 0.1", "", "skin.radius_m is missing"),
        ("radius_m = 0.1", "radus_m = 0.1", "did you mean \"radius_m\"?"),
        ("conductivity_s = 1e-5", "conductivity_s = 0.0", "skin.conductivity_s is 0"),
        ("conductivity_s = 1e-5", "conductivity_s = -1e-5", "above zero"),
        ("contact_impedance_ohm_m = 1e3", "contact_impedance_ohm_m = -1.0", "electrode 1 is -1"),
        ("contact_impedance_ohm_m = 1e3", "contact_impedance_ohm_m = [1.0, 2.0]", "2 values for 8"),
        ("width_m = 0.02", "width_m = [0.01, 0.02, 0.03]", "width_m has 3 values for 8 electrodes"),
        ("width_m = 0.02", "width_m = 0.2", "electrodes 1 and 2 overlap"),
        ("width_m = 0.02", "width_m = 0.0", "width_m"),
        ("count = 8", "count = 3", "no measurement"),
        ("count = 8", "positions_m = [[0.2, 0.0], [0.0, 0.1]]", "from the rim"),
        ("drive = \"adjacent\"", "drive = \"adjacnt\"", "\"adjacent\", \"opposite\", \"skip-N\""),
        ("drive = \"adjacent\"", "measurement_file = \"m.npy\"", "no effect without"),
        ("drive = \"adjacent\"", "drive = \"adjacent\"\npairs = [[0, 1]]", "exclude each other"),
        ("edge_m = 0.012", "edge_m = 0.012\nnodes = 500", "exclude each other"),
        ("drive = \"adjacent\"", "pairs = [[0, 1, 2]]", "3 values instead of two"),
        ("drive = \"adjacent\"", "pairs = [[0, 9]]", "electrode index 9"),
        ("drive = \"adjacent\"", "pairs = [[3, 3]]", "with itself"),
        ("drive = \"adjacent\"", "quadruples_file = \"nowhere.csv\"", "nowhere.csv"),
        ("current_a = 1e-4", "current_a = 0.0", "current_a is 0"),
        ("current_a = 1e-4", "current_a = 1e4", "current_a is 10000: it must be from 1e-9 to 10"),
        ("edge_m = 0.012", "edge_m = -1.0", "edge_m"),
        ("edge_m = 0.012", "edge_m = 1e-7", "limit"),
        ("shape = \"disc\"", "shape = \"mesh\"\nfile = \"f.msh\"", "exclude each other"),
        ("count = 8", "count = 2049", "2049 electrodes: a skin has at most 2048"),
        ("edge_m = 0.012", "nodes = 20000001", "nodes is 20000001: it must be at most 20000000"),
        ("edge_m = 0.012", "node_limit = 20000001", "20000001: it must be at most 20000000"),
    ];
    refuse_plans(cases.map(|(from, to, wanted)| (altered(from, to), wanted)));
    // the limits themselves are accepted: 2048 electrodes do not fit the rim, and the others have another error
    let folder = Folder::new();
    let said = refuse(format!("plan {}", folder.altered("count = 8", "count = 2048")));
    assert!(!said.contains("at most"), "{said}");
    let beside = ["nodes", "node_limit"].map(|key| {
        let keys = format!("{key} = 20000000\n[touch]\nradius_m = -1.0");
        (altered("edge_m = 0.012", &keys), "touch.radius_m is -1")
    });
    refuse_plans(beside);
}

/// Keys added to the small scene.
#[test]
fn keys_that_cannot_be() {
    let reconstruction: &[_] = &[
        ("pixels = 0", "reconstruction.pixels is 0"),
        ("hyperparameter = -1.0", "hyperparameter is -1"),
        ("hyperparameter = 1.0\nnoise_figure = 1.0", "no effect"),
        ("lambda_space = 0.0", "lambda_space is 0"),
        ("lambda_time = 1.0", "no effect without"),
        ("lambda_time = -1.0", "not below zero"),
        ("lamda_space = 1.0", "mean \"lambda_space\"?"),
        ("delta = \"noisy\"", "a number, \"noise\" or \"paper\""),
        ("delta = -1.0", "reconstruction.delta is -1"),
        ("lower_s = 1e-6", "must include zero"),
        ("lower_s = 0.0\nupper_s = 0.0", "must include zero"),
        ("target_gap = nan", "target_gap is NaN"),
        ("target_gap = 5.0", "target_gap is 5: "),
        ("deadline_s = 0.0", "deadline_s is 0"),
        ("delta = 1.0\nprior = \"noser\"", "belong to different methods"),
        ("method = \"TV\"", "reconstruction.method = \"TV\"…\"time-prior\""),
        ("method = \"time-prior\"\ntarget_gap = 1e-3", "with method = \"time-prior\""),
        ("method = \"st-tv\"\nnoise_figure = 1.0", "with method = \"st-tv\""),
        ("method = \"tv\"\nlambda_space = 1.0\nlambda_time = 1.0", "use \"st-tv\""),
    ];
    let noise = &[
        ("additive_v = -1.0", "noise.additive_v is -1"),
        ("quiet_frames = \"4..6\"", "three or more"),
        ("quiet_frames = \"0..10\"\nadditive_v = 1.0", "exclude each"),
    ];
    let recording = &[
        ("scale = 0.0", "recording.scale is 0"),
        ("frame_rate_hz = 0.0", "recording.frame_rate_hz is 0"),
        ("frame_rate_hz = 1e-300", "recording.frame_rate_hz is 0.00"),
    ];
    let touch = &[
        ("radius_m = 7.0", "touch.radius_m is 7: it must be from 0.00001 to 1"),
        ("apart_m = 1e-12", "touch.apart_m is 0.000000000001"),
        ("drift_time_s = -1.0", "touch.drift_time_s is -1"),
    ];
    let names = ["reconstruction", "noise", "recording", "touch"];
    for (table, cases) in names.into_iter().zip([reconstruction, noise, recording, touch]) {
        let scene = |keys| format!("{SMALL}\n[{table}]\n{keys}");
        refuse_plans(cases.iter().map(|(keys, words)| (scene(keys), *words)));
    }
    // currents on all electrodes at once leave none undriven
    let scene = succeed("plan general-32 --print-scene");
    let dropped = scene.replace("driven_electrodes = \"keep\"", "driven_electrodes = \"drop\"");
    refuse_plans([(dropped, "trigonometric…keep")]);
}

/// A scene file that is missing, and one whose mesh is: both are named.
#[test]
fn missing_files_are_named() {
    let folder = Folder::new();
    let mut content = altered("shape = \"disc\"", "shape = \"mesh\"\nfile = \"nowhere.msh\"");
    for key in ["radius_m = 0.1", "count = 8", "width_m = 0.02", "edge_m = 0.012"] {
        content = content.replace(key, "");
    }
    refuse_each([
        (&*format!("plan {}", folder.write("scene.toml", content)), "nowhere.msh"),
        ("plan papr-disc", "paper-disc…papr-disc"),
        ("reconstruct paper-disc --out unused-folder", "--frames"),
    ]);
}

/// A table of values that grow by 0.01 from 1.
fn csv(rows: usize, columns: usize) -> String {
    let value = |(r, c): (usize, usize)| 1.0 + 0.01 * (r * columns + c) as f64;
    table(&Array2::from_shape_fn((rows, columns), value))
}

#[test]
fn frames_that_cannot_be() {
    let folder = Folder::new();
    let (scene, out) = (folder.scene(""), folder.path("out"));
    let first = "--reference 0";
    let all_missing = [vec!["nan"; 40].join(","), String::new()].join("\n").repeat(2);
    let (table, short) = (csv(2, 40), csv(2, 39));
    let (header, word) = (format!("a,b,3\n{table}"), table.replacen("\n1.4,", "\nvolt,", 1));
    assert_ne!(word, table);
    let cases: [(&str, &[u8], &str, &str); 9] = [
        ("f.csv", header.as_bytes(), first, "line 1…value 1 is \"a\"…a header, remove it"),
        ("f.csv", short.as_bytes(), first, "39…40"),
        // a few missing values are accepted: missing_values.rs
        ("f.csv", all_missing.as_bytes(), first, "no measurement is usable…80 value(s) missing"),
        ("f.csv", word.as_bytes(), first, "f.csv…line 2"),
        ("f.csv", b"", first, "f.csv…empty"),
        ("f.csv", &[0, 159, 146, 150, 0, 1, 2], first, "f.csv"),
        ("f.npy", b"\x93NUMPY\x01\x00", first, "f.npy"),
        ("f.csv", table.as_bytes(), "", "no reference frame…--reference"),
        ("f.csv", table.as_bytes(), "--reference 5", "frames 0 to 1"),
    ];
    for (name, content, more, wanted) in cases {
        let frames = folder.write(name, content);
        let line = format!("reconstruct {scene} --frames {frames} --out {out} {more}");
        refuse_each([(line, wanted)]);
    }
    let frames = folder.write("f.csv", "1.0,2.0,3.0\n");
    refuse_each([
        ("calibrate paper-disc", "--frames: no frames: give their files, or set [recording] file"),
        (&format!("calibrate paper-disc --frames {frames}"), "208"),
    ]);
}

/// Under a limit of 1.2 GB of address space, where one raster of that many pixels takes 1.8 GB.
#[cfg(unix)]
#[test]
fn images_beyond_memory_are_refused_before_work() {
    let folder = Folder::new();
    for (rows, electrodes, method, wanted) in [
        (302, 8, "st-tv", "302 images of 4096 x 4096 pixels take 41 GB"),
        (302, 8, "gauss-newton", "302 images of 4096 x 4096 pixels take 41 GB"),
        // the images would fit, but not the arrays needed to make them
        (3, 16, "st-tv", "208 measurements on 4096 x 4096 pixels take 28 GB"),
    ] {
        let keys = format!("[reconstruction]\nmethod = \"{method}\"\npixels = 4096\n[mesh]");
        let content = altered("count = 8", &format!("count = {electrodes}"));
        let scene = folder.write("scene.toml", content.replace("[mesh]", &keys));
        let frames = folder.write("f.csv", csv(rows, electrodes * (electrodes - 3)));
        let more = format!("--reference 0 --out {}", folder.path("out"));
        let line = format!("reconstruct {scene} --frames {frames} {more}");
        let output = in_shell("ulimit -v 1200000;", line).output().unwrap();
        says(&ended(&output, 2), wanted);
    }
}

/// The line points to the help once; a number below zero is one that is not taken, and not another option.
#[test]
fn wrong_usage_is_one_line() {
    let seed = "'--seed <N>'…a whole number, 0 or above";
    for (line, wanted) in [
        ("plan", "required"),
        ("plan paper-disc --frobnicate", "'--frobnicate'"),
        ("nonsense", "unrecognized subcommand 'nonsense'; see --help"),
        ("reconstruct paper-disc --out", "a value is required"),
        ("simulate paper-disc --seed -1 --out never", seed),
        ("mesh paper-disc --out never.png --nodes -1", "'--nodes <N>'…a whole number, 0 or above"),
        ("simulate paper-disc --seed one --out never", seed),
    ] {
        let said = refuse(line);
        says(&said, wanted);
        assert!(said.starts_with("eit: ") && said.matches("--help").count() == 1, "{said}");
        assert!(!wanted.contains("whole") || !said.contains("tip"), "{said}");
    }
}

/// A file stands where results would go, or above it: found before any work, and kept.
#[test]
fn a_file_is_no_folder() {
    let folder = Folder::new();
    let (scene, file) = (folder.scene(""), folder.write("f.csv", csv(2, 40)));
    let is_file = "f.csv: is a file, but --out must name a folder here";
    refuse_each([
        (format!("reconstruct {scene} --frames {file} --reference 0 --out {file}"), is_file),
        (format!("net base {scene} --out {file}"), is_file),
        (format!("man --out {file}"), is_file),
        (format!("reconstruct paper-disc --frames nowhere.csv --out {file}/out"), "cannot write"),
        (format!("demo --out {file}/out"), "cannot write"),
        (format!("forward paper-disc --out {file}/v.csv"), "cannot write"),
    ]);
    assert_eq!(read_text(&file), csv(2, 40));
}

/// Contacts so far from the sheet that no digit survives nodal assembly: linear elements are solved differently
/// (`accuracy.rs`), quadratic ones fail and say so; a few decades closer, the voltages come with a warning.
#[test]
fn voltages_without_a_certain_digit_are_refused() {
    let (folder, [out]) = Folder::with_paths(["v.csv"]);
    let forward = |impedance: &str, elements: &str| {
        let scene = altered("ohm_m = 1e3", &format!("ohm_m = {impedance}"));
        let scene = folder.write("scene.toml", format!("{scene}elements = \"{elements}\"\n"));
        format!("forward {scene} --out {out}")
    };
    for impedance in ["1e-12", "1e16", "[1e20, 1e3, 1e3, 1e3, 1e3, 1e3, 1e3, 1e3]"] {
        let said = ended(&eit(forward(impedance, "quadratic")), 1);
        assert!(said.contains("no digit") || said.contains("decades"), "{said}");
        assert!(!exists(&out));
        let said = succeed(forward(impedance, "linear"));
        assert!(!said.contains("warning"), "{said}");
        std::fs::remove_file(&out).unwrap();
    }
    says(&succeed(forward("1e-5", "quadratic")), "warning: rounding");
}

/// Each is rejected with its position, and an existing result survives.
#[test]
fn meshes_and_conductivities_that_cannot_be() {
    let (folder, scene) = Folder::with_scene("");
    let two_parts = folder.write(
        "two_parts.msh",
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n6\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 5 0 0\n\
         5 6 0 0\n6 5 1 0\n$EndNodes\n$Elements\n2\n1 2 2 0 1 1 2 3\n2 2 2 0 1 4 5 6\n\
         $EndElements\n",
    );
    let (out, sigma) = (folder.write("v.csv", "old"), folder.write("sigma.csv", "1,2,3\n"));
    let skin = folder.path("skin.msh");
    refuse_each([
        (format!("forward paper-disc --mesh {two_parts} --out {out}"), "2 parts"),
        (format!("forward paper-disc --conductivity {sigma} --out {out}"), "3 values…elements"),
    ]);
    let count = number(&answer(format!("mesh {scene} --out {skin}")), "triangles") as usize;
    for bad in [0.0, -1.0] {
        let mut sigma = Array2::from_elem((1, count), 1e-5);
        sigma[[0, 17]] = bad;
        let file = folder.write_array("sigma.npy", &sigma);
        let line = format!("forward {scene} --mesh {skin} --conductivity {file} --out {out}");
        refuse_each([(line, format!("element 17…{bad}"))]);
    }
    assert_eq!(read_text(&out), "old");
    let names = ["scene.toml", "sigma.csv", "sigma.npy", "skin.msh", "two_parts.msh", "v.csv"];
    assert_eq!(folder.names(), names, "no temporary is left");
}

/// The wrong order is detected by reciprocity, also before a table is converted, and reported with the key that fixes it.
#[test]
fn the_wrong_order_is_reported_with_its_key() {
    let folder = Folder::new();
    let with = |key: &str| folder.altered("current_a", &format!("{key}\ncurrent_a"));
    let [frames, out, recording] = folder.paths(["f.csv", "out", "v.mcap"]);
    let more = format!("--frames {frames} --reference 0 --out {out}");
    let convert = |scene: &str| format!("convert {frames} --scene {scene} --out {recording}");
    let (plain, ascending) = (folder.write("plain.toml", SMALL), with("order = \"ascending\""));
    succeed(format!("forward {ascending} --out {frames}"));
    refuse_each([
        (format!("reconstruct {plain} {more}"), "order = \"ascending\""),
        (convert(&plain), "set that…order = \"ascending\""),
    ]);
    succeed(convert(&ascending));
    // the user may insist
    ended(&eit(format!("reconstruct {} {more}", with("check_order = false"))), 0);
}
