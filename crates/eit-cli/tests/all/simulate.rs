//! `eit simulate`: its files, and that they reconstruct.

use crate::common::*;
use eit_fem::fabric::{PlayCircle, TouchScript};
use eit_skin::{Progress, Skin};

const FAST: &str = "--nodes 1500 --frames 40";

/// The rim is rigid, because the artefacts of moving electrodes are brighter than the finger.
#[test]
fn simulated_frames_reconstruct_from_their_own_scene() {
    let (folder, [out]) = Folder::with_paths(["touched"]);
    let scene = succeed("plan paper-disc --print-scene");
    let rigid = "\n[fabric.rim]\ncompliance = 0.0\ncontact_gain = 0.0\n";
    let scene = folder.write("scene.toml", format!("{scene}{rigid}"));
    let json = answer(format!("simulate {scene} --out {out} {FAST}"));
    assert_eq!(json["frames"], 40);
    for name in json["files"].as_array().unwrap() {
        assert!(!read(format!("{out}/{}", name.as_str().unwrap())).is_empty(), "{name}");
    }
    assert_eq!(read_array::<Ix2>(format!("{out}/frames.npy")).dim(), (40, 208));
    let truth: Array3<f64> = read_array(format!("{out}/truth_conductivity.npy"));
    assert_eq!(truth.dim(), (40, 64, 64));
    let images = folder.path("images");
    let scene = format!("{out}/scene.toml");
    succeed(format!("reconstruct {scene} --method gauss-newton --out {images}"));
    let images: Array3<f64> = read_array(format!("{images}/images.npy"));
    let brightest = |images: &Array3<f64>| {
        let image = images.index_axis(Axis(0), 35);
        let values = image.indexed_iter().filter(|(_, v)| v.is_finite());
        let ((row, column), _) = values.max_by(|a, b| a.1.total_cmp(b.1)).unwrap();
        [row as f64, column as f64]
    };
    let ([r, c], [i, j]) = (brightest(&truth), brightest(&images));
    // one-step images place a finger near the rim up to a tenth of the radius, three pixels, too far out
    assert!((r - i).hypot(c - j) < 5.0, "truth ({r}, {c}), image ({i}, {j})");
}

/// Fraction of frame 50's squared image that is at its fingers. Three fingers, none near the rim; pixels are
/// 3 mm, and fingers of 5 mm appear 10 mm wide, a pixel or two from their place.
fn part_at_fingers(truth: &Array3<f64>, images: &Array3<f64>) -> f64 {
    let bright = truth.index_axis(Axis(0), 50);
    let peak = bright.iter().filter(|v| v.is_finite()).fold(0.0_f64, |m, v| m.max(*v));
    let near = |row: usize, column: usize| {
        let mut cells = bright.indexed_iter().filter(|(_, v)| **v > 0.2 * peak);
        cells.any(|((r, c), _)| (r as f64 - row as f64).hypot(c as f64 - column as f64) < 5.0)
    };
    let image = images.index_axis(Axis(0), 50);
    let (mut inside, mut all) = (0.0, 0.0);
    for ((row, column), value) in image.indexed_iter().filter(|(_, v)| v.is_finite()) {
        let square = value.max(0.0).powi(2);
        all += square;
        inside += if near(row, column) { square } else { 0.0 };
    }
    inside / all
}

/// Weights that explained them, too, would fill the skin with blobs; with the noise of the quiet frames, and with a stated
/// one of a twentieth of the rounding, which no residual reaches: then the corner of the L-curve is taken.
#[test]
fn total_variation_does_not_explain_moving_electrodes() {
    let (folder, [out]) = Folder::with_paths(["random"]);
    succeed(format!("simulate paper-disc --script random --out {out} --nodes 2500 --frames 60"));
    let truth: Array3<f64> = read_array(format!("{out}/truth_conductivity.npy"));
    let measured = read_text(format!("{out}/scene.toml"));
    let quiet = "quiet_frames = \"0..20\"";
    assert!(measured.contains(quiet), "{measured}");
    for (noise, rule) in [(quiet, "discrepancy"), ("additive_v = 5e-7", "corner")] {
        std::fs::write(format!("{out}/scene.toml"), measured.replace(quiet, noise)).unwrap();
        let (scene, images) = (format!("{out}/scene.toml"), folder.path(rule));
        let json = answer(format!("reconstruct {scene} --method st-tv --out {images}"));
        let weights = &json["weights"];
        assert!(weights["rule"].as_str().unwrap().starts_with(rule), "{noise}: {weights}");
        let part = part_at_fingers(&truth, &read_array(format!("{images}/images.npy")));
        println!("{rule}: {part:.3} of the image is at the fingers");
        assert!(part > 0.7, "{noise}: only {part:.2} is at the fingers: {weights}");
    }
}

/// The script that was run, run again from its file, gives the same frames.
#[test]
fn scripts_round_trip_through_files() {
    let (folder, scene) = Folder::with_scene("[fabric.weave]\namplitude = 0.1\n");
    let run = |script: &str, name: &str| {
        let out = folder.path(name);
        succeed(format!("simulate {scene} --script {script} --seed 7 --out {out} {FAST}"));
        out
    };
    let first = run("random", "first");
    let again = run(&format!("{first}/script.toml"), "again");
    for name in ["frames.npy", "touches.csv", "script.toml"] {
        let [a, b] = [&first, &again].map(|folder| read(format!("{folder}/{name}")));
        assert!(a == b, "{name}");
    }
    let threads = folder.path("two.npy");
    let line = format!("simulate {scene} --script {first}/script.toml --seed 7 {FAST}");
    succeed(format!("{line} --threads 2 --out {threads}"));
    assert!(read(&threads) == read(format!("{first}/frames.npy")));
}

#[test]
fn bad_scripts_and_settings_are_one_line() {
    let folder = Folder::new();
    let run = |scene: &str, script: &str| {
        format!("simulate {scene} --script {script} --nodes 1200 --out {}", folder.path("out"))
    };
    let key = |x: f64, force: f64| {
        let place = format!("time_s = 1.0\nposition_m = [{x:?}, 0.0]\nradius_m = 0.01\n");
        format!("[[finger.key]]\n{place}force_n = {force:?}\n")
    };
    let head = "frame_rate_hz = 10.0\nframes = 30\n[[finger]]\nid = 1\n";
    for (keys, wanted) in [
        (key(0.3, 1.0), "finger 1, at key 0, 1 s: (0.3, 0) m"),
        (key(0.0, -1.0), "key 0: force_n is -1"),
        (key(0.0, 1.0).repeat(2), "is not after"),
        ("speed = 3\n".to_owned() + &key(0.0, 1.0), "unknown key \"speed\""),
    ] {
        let script = folder.write("s.toml", format!("{head}{keys}"));
        refuse_each([(run("paper-disc", &script), wanted)]);
    }
    for (key, wanted) in [
        ("compliance = 2.0", "fabric.rim.compliance is 2"),
        ("complianc = 0.2", "did you mean \"compliance\""),
    ] {
        refuse_each([(run(&folder.scene(&format!("[fabric.rim]\n{key}\n")), "random"), wanted)]);
    }
    // frames that would all be quiet: the option is named, and how many there are
    let quiet =
        "--frames: 20, but the script one-finger begins with 20 frames of the untouched skin";
    refuse_each([
        (run("paper-disc", "dance"), "known scripts are paper-one-finger"),
        (run("paper-disc", "one-finger --frames 20"), quiet),
    ]);
}

/// Also where the centroid lies in a hole or off the skin, or where the skin is curved.
#[test]
fn random_touches_fit_every_skin() {
    let folder = Folder::new();
    let shape = |name: &str, shape: &str, electrodes: &str| {
        let contacts = "width_m = 0.01\ncontact_impedance_ohm_m = 1e3";
        let rest = format!("[electrodes]\n{electrodes}\n{contacts}\n[protocol]\ncurrent_a = 1e-4");
        folder.write(name, format!("[skin]\n{shape}\nconductivity_s = 1e-5\n{rest}\n"))
    };
    // narrow: a fingertip of 20 mm would not fit
    let rectangle =
        shape("flat.toml", "shape = \"rectangle\"\nwidth_m = 0.2\nheight_m = 0.05", "count = 8");
    // an L, whose centroid is off the skin
    let angle = shape(
        "angle.toml",
        "shape = \"polygon\"\noutline = [[0, 0], [0.2, 0], [0.2, 0.03], [0.03, 0.03], [0.03, 0.2], [0, 0.2]]",
        "positions_m = [[0.05, 0], [0.1, 0], [0.15, 0], [0.2, 0.015], [0.1, 0.03], [0.03, 0.1], [0.015, 0.2], [0, 0.1]]",
    );
    let out = folder.path("frames.npy");
    let own = [(&*rectangle, 1500), (&angle, 2500)];
    let built_in = [("plate-with-hole", 4000), ("patches", 7000), ("hemisphere", 2500)];
    for (scene, nodes) in own.into_iter().chain(built_in) {
        let skin = Skin::load(scene).unwrap();
        let skin = skin.with_nodes(nodes, &mut Progress::silent()).unwrap();
        let circle = PlayCircle::of(&skin.mesh);
        for seed in 1..=5 {
            let script = TouchScript::built_in("random", &circle, seed).unwrap();
            script.validate(&skin.mesh).unwrap();
        }
        let few = "--script random --frames 40 --seed 1";
        succeed(format!("simulate {scene} {few} --nodes {nodes} --out {out}"));
    }
}

/// A simulation is replayed with the reference and the frame rate of its scene, and its truth is not replaced.
#[test]
fn a_simulation_is_replayed_as_its_scene_says() {
    let folder = Folder::new();
    let (out, recording) = (folder.path("held"), folder.path("held.mcap"));
    let fixed = "simulate paper-disc --script press-and-hold --nodes 1500";
    succeed(format!("{fixed} --frames 80 --out {out}"));
    let scene = format!("{out}/scene.toml");
    let frames = format!("{out}/frames.npy");
    succeed(format!("convert {frames} --scene {scene} --out {recording}"));

    // the finger lands before frame 40, the usual length of a reference
    let replay = format!("replay {scene} --from {recording}");
    // the summary of such a run is on stderr
    let output = eit(format!("{replay} --json-lines"));
    ended(&output, 0);
    let lines: Vec<Value> = stdout(&output).lines().map(parse).collect();
    assert_eq!(lines[0]["reference_frames"], 20);
    let shown: Vec<&Value> = lines.iter().filter(|line| line["type"] == "frame").collect();
    // the last list ends the touches
    let (last, shown) = shown.split_last().unwrap();
    assert_eq!((last["state"].as_str(), shown.len()), (Some("no_data"), 60));
    for pair in shown.windows(2) {
        let step = number(pair[1], "time_s") - number(pair[0], "time_s");
        assert!((step - 0.1).abs() < 1e-9, "{step}");
    }
    let touched = shown.iter().filter(|frame| !frame["touches"].as_array().unwrap().is_empty());
    assert!(touched.count() > 40, "{:?}", shown.last());
    assert!(shown.iter().all(|frame| frame["explained"] == true && frame["frozen"] == false));

    let few = succeed(format!("{replay} --reference-frames 90"));
    says(&few, "80 frames came, fewer than the reference needs");
    let begun = Instant::now();
    succeed(format!("{replay} --speed 20 --json"));
    // 80 frames of 0.1 s, twenty times as fast; only at least this long, whatever the machine does
    assert!(begun.elapsed().as_secs_f64() > 0.39, "{:?}", begun.elapsed());

    let before = read(format!("{out}/touches.csv"));
    refuse_each([(format!("reconstruct {scene} --out {out}"), "holds a simulation")]);
    assert_eq!(read(format!("{out}/touches.csv")), before);
}
