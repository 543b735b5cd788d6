//! The commands do what `--help` says.

use crate::common::*;

#[test]
fn help_teaches_every_command() {
    let commands = crate::shell::commands("--help");
    assert_eq!(commands.len(), 19, "{commands:?}");
    commands.iter().for_each(|command| says(&succeed(format!("{command} --help")), "Usage"));
    // words that are gone are named as such, and those that are hidden work
    let gone = ["base", "train", "denoise", "recover", "devices"];
    refuse_each(gone.map(|word| (word, format!("unrecognized subcommand '{word}'"))));
}

#[test]
fn plan_says_what_is_done_and_left_out() {
    let json = answer("plan paper-disc");
    let stages = texts(&json["stages"], "stage");
    let [images, touches] = [5, 3];
    assert_eq!(stages.len(), images + touches, "{stages:?}");
    assert!(stages.ends_with(&["sheet as it is", "detector of touches", "touches of each frame"]));
    says(&json["left_out"].to_string(), "complex…U-net");
}

/// A mesh written and read back gives the same voltages to the bit, and the Jacobian has the announced shape.
#[test]
fn mesh_file_forward_and_jacobian_agree() {
    let (folder, scene) = Folder::with_scene("");
    for name in ["skin.vtu", "skin.png", "skin.msh"] {
        succeed(format!("mesh {scene} --out {}", folder.path(name)));
    }
    let [direct, by_file, mesh] = folder.paths(["direct.npy", "by_file.npy", "skin.msh"]);
    succeed(format!("forward {scene} --out {direct}"));
    succeed(format!("forward {scene} --mesh {mesh} --out {by_file}"));
    let [v, w] = [&direct, &by_file].map(read_array::<Ix1>);
    assert_eq!((v.len(), &v), (40, &w));
    let [jacobian, moved] = folder.paths(["j.npy", "moved.npy"]);
    let json = answer(format!("jacobian {scene} --out {jacobian}"));
    let j: Array2<f64> = read_array(&jacobian);
    assert_eq!(json["shape"], json!([j.nrows(), j.ncols()]));
    // one element 1 % more conductive: the change of the voltages is the Jacobian's column
    let element = j.ncols() / 2;
    let step = 1e-7;
    let mut sigma = Array2::from_elem((1, j.ncols()), 1e-5);
    sigma[[0, element]] += step;
    let sigma_file = folder.write_array("sigma.npy", &sigma);
    succeed(format!("forward {scene} --conductivity {sigma_file} --out {moved}"));
    let column = j.column(element).to_owned() * step;
    let (error, size) = (largest(&(&read_array::<Ix1>(&moved) - &v - &column)), largest(&column));
    // the second-order term of a change of 1 %
    assert!(error < 0.02 * size, "{error:e} of {size:e}");
}

/// Bit for bit, every time; also from a transposed table, with the key that the rejection names.
#[test]
fn the_same_frames_give_the_same_images() {
    let (folder, [frames, out]) = Folder::with_paths(["frames.npy", "out"]);
    let script = "--script two-fingers --frames 30 --nodes 2500";
    succeed(format!("simulate paper-disc {script} --out {frames}"));
    let turned: Array2<f64> = read_array(&frames);
    let turned = folder.write_array("turned.npy", &turned.t().to_owned());
    let line = |scene: &str, frames: &str| {
        format!("reconstruct {scene} --frames {frames} --reference 0 --out {out}")
    };
    let run = |scene: &str, frames: &str| {
        succeed(line(scene, frames));
        read(format!("{out}/images.npy"))
    };
    let images = run("paper-disc", &frames);
    assert!(images == run("paper-disc", &frames), "two runs differ");
    let key = "frames_are = \"columns\"";
    assert!(refuse(line("paper-disc", &turned)).contains(key));
    let scene = succeed("plan paper-disc --print-scene") + "\n[recording]\n" + key;
    assert!(images == run(&folder.write("scene.toml", scene), &turned));
}

/// A second run leaves nothing of the first next to its own results.
#[test]
fn results_of_an_earlier_run_do_not_stay() {
    let (folder, scene) = Folder::with_scene("");
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
