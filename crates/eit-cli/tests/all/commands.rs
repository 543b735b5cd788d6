//! The commands do what `--help` says.

use crate::common::{Folder, SMALL, answer, exists, read, read_array, read_text, refuse, succeed};
use ndarray::{Array1, Array2};
use serde_json::Value;

#[test]
fn help_teaches_every_command() {
    let help = succeed("--help");
    let commands = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let commands = commands.take_while(|line| line.starts_with("  "));
    let commands: Vec<&str> = commands.filter_map(|line| line.split_whitespace().next()).collect();
    assert_eq!(commands.len(), 19 + 1, "with `help`: {commands:?}");
    for command in commands.into_iter().filter(|command| *command != "help") {
        assert!(succeed(format!("{command} --help")).contains("Usage"), "{command}");
    }
    // words that are gone are named as such, and those that are hidden work
    for word in ["base", "train", "denoise", "recover", "devices"] {
        assert!(refuse(word).contains(&format!("unrecognized subcommand '{word}'")));
    }
}

#[test]
fn plan_says_what_is_done_and_left_out() {
    let json = answer("plan paper-disc");
    let stages: Vec<&str> =
        json["stages"].as_array().unwrap().iter().map(|s| s["stage"].as_str().unwrap()).collect();
    let [images, touches] = [5, 3];
    assert_eq!(stages.len(), images + touches, "{stages:?}");
    assert!(stages.ends_with(&["sheet as it is", "detector of touches", "touches of each frame"]));
    let left_out = json["left_out"].to_string();
    assert!(left_out.contains("complex") && left_out.contains("U-net"), "{left_out}");
    // measured 4e-3 on the default mesh; a wrong closed form or mesh would be far off
    let error = json["expected_voltage_error"].as_f64().unwrap();
    assert!((1e-4..2e-2).contains(&error), "{error}");
}

/// A mesh written and read back gives the same voltages to the last bit, and the Jacobian has the
/// announced shape.
#[test]
fn mesh_file_forward_and_jacobian_agree() {
    let folder = Folder::new();
    let scene = folder.write("scene.toml", SMALL);
    for name in ["skin.vtu", "skin.png", "skin.msh"] {
        succeed(format!("mesh {scene} --out {}", folder.path(name)));
    }
    let [direct, by_file, mesh] = folder.paths(["direct.npy", "by_file.npy", "skin.msh"]);
    succeed(format!("forward {scene} --out {direct}"));
    succeed(format!("forward {scene} --mesh {mesh} --out {by_file}"));
    let v: Array1<f64> = read_array(&direct);
    let w: Array1<f64> = read_array(&by_file);
    assert_eq!(v.len(), 40);
    assert_eq!(v, w);
    let [jacobian, moved] = folder.paths(["j.npy", "moved.npy"]);
    let json = answer(format!("jacobian {scene} --out {jacobian}"));
    let j: Array2<f64> = read_array(&jacobian);
    assert_eq!(json["shape"], serde_json::json!([j.nrows(), j.ncols()]));
    // one element 1 % more conductive: the change of the voltages is the Jacobian's column
    let element = j.ncols() / 2;
    let step = 1e-7;
    let mut sigma = Array2::from_elem((1, j.ncols()), 1e-5);
    sigma[[0, element]] += step;
    let sigma_file = folder.write_array("sigma.npy", &sigma);
    succeed(format!("forward {scene} --conductivity {sigma_file} --out {moved}"));
    let moved: Array1<f64> = read_array(&moved);
    let column = j.column(element).to_owned() * step;
    let largest = column.iter().fold(0.0, |m: f64, c| m.max(c.abs()));
    let error = (&moved - &v - &column).iter().fold(0.0, |m: f64, e| m.max(e.abs()));
    // the second-order term of a change of 1 %
    assert!(error < 0.02 * largest, "{error:e} of {largest:e}");
}

/// Shunts (zero) and ideal current sources (infinite) are valid scenes: the limits for small and large
/// contact impedances. No current is measured through a driven electrode here, so both limits are finite.
#[test]
fn limits_of_the_contact_impedance_are_scenes() {
    let folder = Folder::new();
    let forward = |impedance: &str| -> Array1<f64> {
        let key = "contact_impedance_ohm_m = ";
        let content = SMALL.replace(&format!("{key}1e3"), &format!("{key}{impedance}"));
        let scene = folder.write("scene.toml", &content);
        succeed(format!("plan {scene}"));
        let out = folder.path("v.npy");
        succeed(format!("forward {scene} --out {out}"));
        read_array(&out)
    };
    let size = |v: &Array1<f64>| v.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    for (limit, near, nearer) in [("0.0", "1e0", "1e-1"), ("inf", "1e7", "1e8")] {
        let exact = forward(limit);
        let errors = [near, nearer].map(|z| size(&(&forward(z) - &exact)) / size(&exact));
        // contacts of 1e3 ohm m and the skin of 1e5 ohm square have similar effect over an electrode of 0.02
        // m: a thousandth of that shows in the third digit, and the limit is approached linearly
        assert!(errors[0] < 1e-2, "{limit}: {errors:?}");
        assert!((0.08..0.12).contains(&(errors[1] / errors[0])), "{limit}: {errors:?}");
    }
}

/// Few frames of the simulated fabric: frames.npy, and their scene.
fn simulated(folder: &Folder) -> String {
    let out = folder.path("simulated");
    let script = "--script two-fingers --frames 30 --nodes 2500";
    succeed(format!("simulate paper-disc {script} --out {out}"));
    out
}

/// Frames reconstruct to the same images, bit for bit, every time; so does a transposed table, with the key that the
/// rejection names.
#[test]
fn the_same_frames_give_the_same_images() {
    let folder = Folder::new();
    let simulated = simulated(&folder);
    let frames: Array2<f64> = read_array(format!("{simulated}/frames.npy"));
    let turned = folder.write_array("turned.npy", &frames.t().to_owned());
    let run = |scene: &str, frames: &str| {
        let out = folder.path("out");
        succeed(format!("reconstruct {scene} --frames {frames} --reference 0 --out {out}"));
        read(format!("{out}/images.npy"))
    };
    let images = run("paper-disc", &format!("{simulated}/frames.npy"));
    assert!(images == run("paper-disc", &format!("{simulated}/frames.npy")), "two runs differ");
    let out = folder.path("never");
    let line = format!("reconstruct paper-disc --frames {turned} --reference 0 --out {out}");
    let key = "frames_are = \"columns\"";
    assert!(refuse(line).contains(key));
    let scene = succeed("plan paper-disc --print-scene") + "\n[recording]\n" + key;
    assert!(images == run(&folder.write("scene.toml", scene), &turned));
}

/// A second run leaves nothing of the first next to its own results.
#[test]
fn results_of_an_earlier_run_do_not_stay() {
    let folder = Folder::new();
    let scene = folder.write("scene.toml", SMALL);
    let (one, out) = (folder.path("one.csv"), folder.path("out"));
    succeed(format!("forward {scene} --out {one}"));
    let two = folder.write("two.csv", read_text(&one).repeat(2));
    let run = |frames: &str| {
        succeed(format!("reconstruct {scene} --frames {frames} --reference 0 --out {out}"));
        exists(format!("{out}/movie.gif"))
    };
    assert!(run(&two), "a sequence has a movie");
    assert!(!run(&one), "a single frame has none");
    assert!(exists(format!("{out}/report.json")));
}

/// `elements = "quadratic"` on the same mesh: closer to the series by two decades, with a Jacobian of as many
/// elements, and the plan says what is solved.
#[test]
fn quadratic_elements_are_a_key_of_the_scene() {
    let folder = Folder::new();
    let plan = |elements: &str| -> Value {
        let scene = folder.write("scene.toml", format!("{SMALL}elements = \"{elements}\"\n"));
        let jacobian = folder.path("j.npy");
        succeed(format!("jacobian {scene} --out {jacobian}"));
        let j: Array2<f64> = read_array(&jacobian);
        let voltages = folder.path("v.npy");
        let forward = answer(format!("forward {scene} --out {voltages}"));
        assert_eq!(forward["elements"], j.ncols());
        let mut plan = answer(format!("plan {scene}"));
        plan["unknowns"] = forward["solve"]["unknowns"].clone();
        plan["columns"] = j.ncols().into();
        plan
    };
    let (linear, quadratic) = (plan("linear"), plan("quadratic"));
    assert_eq!(linear["columns"], quadratic["columns"]);
    let [few, many] = [&linear, &quadratic].map(|p| p["unknowns"].as_u64().unwrap());
    assert!(many > 3 * few, "{few} {many}");
    let [coarse, fine] =
        [&linear, &quadratic].map(|p| p["expected_voltage_error"].as_f64().unwrap());
    println!("errors of the plans: {coarse:.1e}, {fine:.1e}");
    assert!(fine < 0.05 * coarse, "{coarse:e} {fine:e}");
    let stages = quadratic["stages"].to_string();
    assert!(stages.contains("quadratic elements") && stages.contains(&format!("{many} unknowns")));
}
