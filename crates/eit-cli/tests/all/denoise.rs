//! Training and denoising as a user does them, on a small skin.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

#[cfg(feature = "train")]
use crate::common::fail;
use crate::common::{SMALL, refuse, succeed, text, write_scene};
use ndarray::{Array2, Array3, Axis};
use std::path::Path;

/// Few enough for a test; such a net may well be worse than the raw images.
#[cfg(feature = "train")]
const FEW: [&str; 19] = [
    "--force",
    "--method",
    "gauss-newton",
    "--sequences",
    "2",
    "--frames",
    "34",
    "--epochs",
    "2",
    "--width",
    "2",
    "--depth",
    "2",
    "--threads",
    "2",
    "--images",
    "1",
    "--fold",
    "1",
];

fn scene(folder: &Path) -> std::path::PathBuf {
    write_scene(folder, &format!("{SMALL}\n[reconstruction]\npixels = 24\n"))
}

#[cfg(feature = "train")]
fn train(scene: &Path, out: &Path) -> serde_json::Value {
    let mut arguments = vec!["train", text(scene), "--out", text(out), "--json"];
    arguments.extend(FEW);
    serde_json::from_str(&succeed(&arguments)).unwrap()
}

/// Weights of another skin: the option is named, and what would have to be in the scene.
#[test]
fn the_shipped_net_on_another_skin_says_how_to_allow_it() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    let [images, out] = ["images.npy", "out"].map(|name| folder.path().join(name));
    ndarray_npy::write_npy(&images, &Array3::<f64>::zeros((1, 24, 24))).unwrap();
    let found = refuse(&[
        "denoise",
        text(&scene),
        "--images",
        text(&images),
        "--weights",
        "default",
        "--out",
        text(&out),
    ]);
    assert!(found.contains("--any-skin"), "{found}");
    assert!(found.contains("weights = \"default\", any_skin = true"), "{found}");
}

/// Training is compiled in on demand.
#[cfg(not(feature = "train"))]
#[test]
fn a_program_without_training_says_how_to_get_it() {
    let found = refuse(&["train", "paper-disc", "--out", "w.safetensors"]);
    assert!(found.contains("cargo install --path crates/eit-cli --features train"), "{found}");
    assert_eq!(found.trim().lines().count(), 1, "{found}");
}

/// One after the other: train, again from what is there, denoise, refuse.
#[cfg(feature = "train")]
#[test]
fn a_net_is_trained_goes_on_and_denoises() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    let weights = folder.path().join("w.safetensors");
    let report = train(&scene, &weights);
    assert_eq!(report["epochs"], 2);
    assert_eq!(report["status"], "all done");
    assert!(report["held_out"]["frames"].as_u64().unwrap() > 5, "{report}");
    for ending in ["csv", "png", "checkpoint", "base"] {
        assert!(weights.with_extension(ending).exists(), "{ending}");
    }
    let curve = std::fs::read_to_string(weights.with_extension("csv")).unwrap();
    assert_eq!(curve.lines().count(), 3);

    // a shard lost its end, checkpoint and weights are gone: made again, the same bytes
    let bytes = std::fs::read(&weights).unwrap();
    let shard = weights.with_extension("base").join("shard-00001.safetensors");
    let whole = std::fs::read(&shard).unwrap();
    std::fs::write(&shard, &whole[..whole.len() / 2]).unwrap();
    std::fs::remove_file(weights.with_extension("checkpoint")).unwrap();
    train(&scene, &weights);
    assert_eq!(std::fs::read(&shard).unwrap(), whole);
    let same = |a: &[u8], b: &[u8]| {
        // metadata stand in any order
        eit_denoise::Weights::from_bytes(a).unwrap() == eit_denoise::Weights::from_bytes(b).unwrap()
    };
    assert!(same(&std::fs::read(&weights).unwrap(), &bytes));
    let mut other = vec!["train", text(&scene), "--out", text(&weights), "--seed", "2"];
    other.extend(FEW);
    assert!(refuse(&other).contains("the seed is 1 there, but 2 here"));

    starts_from_other_weights(&scene, &weights, folder.path());

    // a recording of the same skin, with and without the net in the scene
    let touched = folder.path().join("touched");
    succeed(&[
        "simulate",
        text(&scene),
        "--frames",
        "40",
        "--nodes",
        "900",
        "--out",
        text(&touched),
    ]);
    let made = touched.join("scene.toml");
    let (plain, netted) = (folder.path().join("plain"), folder.path().join("netted"));
    let gauss_newton = ["--method", "gauss-newton"];
    let mut arguments = vec!["reconstruct", text(&made), "--out", text(&plain)];
    arguments.extend(gauss_newton);
    succeed(&arguments);
    let with_net = std::fs::read_to_string(&made).unwrap()
        + &format!("\n[denoise]\nweights = '{}'\n", weights.display());
    std::fs::write(&made, with_net).unwrap();
    let mut arguments = vec!["reconstruct", text(&made), "--out", text(&netted)];
    arguments.extend(gauss_newton);
    assert!(succeed(&arguments).contains("U-net of"));
    let read = |folder: &Path, name: &str| std::fs::read(folder.join(name)).unwrap();
    assert_eq!(read(&netted, "raw.npy"), read(&plain, "images.npy"));
    assert_ne!(read(&netted, "images.npy"), read(&plain, "images.npy"));

    let images = plain.join("images.npy");
    let truth = touched.join("truth_conductivity.npy");
    let out = folder.path().join("denoised");
    let answer = succeed(&[
        "denoise",
        text(&scene),
        "--images",
        text(&images),
        "--weights",
        text(&weights),
        "--truth",
        text(&truth),
        "--out",
        text(&out),
    ]);
    assert!(answer.contains("of the raw image's"), "{answer}");
    assert_eq!(read(&out, "images.npy"), read(&netted, "images.npy"));

    refusals(folder.path(), &weights, &images);
}

/// Killed while it makes the base, learns or compares: nothing is left but what it goes on with.
#[cfg(all(feature = "train", unix))]
#[test]
fn a_killed_training_leaves_no_stray_files() {
    use std::time::{Duration, Instant};
    fn names(folder: &Path, into: &mut Vec<String>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let entry = entry.unwrap();
            into.push(entry.file_name().into_string().unwrap());
            if entry.file_type().unwrap().is_dir() {
                names(&entry.path(), into);
            }
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    let weights = folder.path().join("w.safetensors");
    let mut arguments = vec!["train", text(&scene), "--out", text(&weights)];
    arguments.extend(FEW);
    let start = Instant::now();
    for kill in 1_u32..=6 {
        let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_eit"))
            .args(&arguments)
            .stdout(std::process::Stdio::null())
            .stderr(std::process::Stdio::null())
            .spawn()
            .unwrap();
        // later each time, whatever it does by then
        let until = Instant::now() + Duration::from_millis(300) * kill * kill;
        while Instant::now() < until && child.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_millis(5));
        }
        // SIGKILL; it may have ended
        let _ = child.kill();
        child.wait().unwrap();
        let mut left = Vec::new();
        names(folder.path(), &mut left);
        // what is half written has the name of what it becomes, so that the next run replaces it
        let known = |name: &String| {
            let name = name.strip_prefix(".eit-").unwrap_or(name);
            let part = name.starts_with("shard-") || name.starts_with("manifest");
            name.starts_with("w.") || part || name.ends_with(".toml")
        };
        assert!(left.iter().all(known), "{left:?}");
        println!("{:?}: {left:?}", start.elapsed());
    }
    train(&scene, &weights);
    let mut left = Vec::new();
    names(folder.path(), &mut left);
    assert!(!left.iter().any(|name| name.starts_with('.')), "{left:?}");
}

/// At a rate at which nothing is learnt the weights stay those that the training started from, and the
/// file names them; they bring their size.
#[cfg(feature = "train")]
fn starts_from_other_weights(scene: &Path, weights: &Path, folder: &Path) {
    let (out, base) = (folder.join("from.safetensors"), weights.with_extension("base"));
    let mut arguments = vec!["train", text(scene), "--out", text(&out), "--base", text(&base)];
    arguments.extend(["--from", text(weights), "--rate", "1e-30"]);
    arguments.extend(FEW.into_iter().take(9).chain(["--threads", "1"]));
    succeed(&arguments);
    let read =
        |file: &Path| eit_denoise::Weights::from_bytes(&std::fs::read(file).unwrap()).unwrap();
    let [first, made] = [read(weights), read(&out)];
    assert_eq!((made.shape, &made.parameters), (first.shape, &first.parameters));
    assert_eq!(made.about["from"], eit_skin::train::parameter_checksum(&first));
    assert!(!first.about.contains_key("from"));
    // a judge needs more frames than this base has
    let judged = folder.join("judged.safetensors");
    let mut only = vec!["train", text(scene), "--out", text(&judged), "--base", text(&base)];
    only.extend(["--from", text(weights), "--epochs", "0"]);
    only.extend(FEW.into_iter().take(7));
    assert!(fail(&only).contains("too few to measure the judge"));
    assert!(!judged.exists());
    arguments.extend(["--width", "4"]);
    assert!(refuse(&arguments).contains("cannot be used with"));
}

#[cfg(feature = "train")]
fn refusals(folder: &Path, weights: &Path, images: &Path) {
    let out = folder.join("refused");
    let denoise = |scene: &str, weights: &Path, images: &Path| {
        let (images, weights) = (text(images), text(weights));
        refuse(&["denoise", scene, "--images", images, "--weights", weights, "--out", text(&out)])
    };
    // the paper's skin at 24 pixels is not the small one
    let found = denoise("paper-disc", weights, images);
    assert!(found.contains("the weights are for skin"), "{found}");
    let scene = scene(folder);
    let cut = folder.join("cut.safetensors");
    let bytes = std::fs::read(weights).unwrap();
    std::fs::write(&cut, &bytes[..bytes.len() - 9]).unwrap();
    let found = denoise(text(&scene), &cut, images);
    assert!(found.contains("cut.safetensors: damaged, or not a file"), "{found}");
    let found = denoise(text(&scene), weights, &cut);
    assert!(found.contains("cut.safetensors"), "{found}");
    let found = refuse(&["train", text(&scene), "--out", "w.npy"]);
    assert!(found.contains(".safetensors"), "{found}");
    let device =
        |name: &str| refuse(&["train", text(&scene), "--out", "w.safetensors", "--device", name]);
    let found = device("torch");
    assert!(found.contains("there are flex (the processor), cuda and wgpu"), "{found}");
    if !cfg!(feature = "cuda") {
        let found = device("cuda");
        assert!(found.contains("--device cuda: this program was built without"), "{found}");
    }
    assert!(!out.join("images.npy").exists());
}

/// A net that sees measurements runs where they are, and is refused where there are images alone.
#[cfg(feature = "train")]
#[test]
fn a_net_that_sees_measurements_is_trained_and_runs() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    let weights = folder.path().join("w.safetensors");
    let mut arguments = vec!["train", text(&scene), "--out", text(&weights), "--seed", "3"];
    arguments.extend(["--images", "3", "--fold", "2"]);
    arguments.extend(&FEW[..15]);
    // so few frames that no touch is detected in the one held out
    let none = refuse(&arguments);
    assert!(none.contains("no touch is detected in any of the 1 sequences"), "{none}");
    std::fs::remove_dir_all(weights.with_extension("base")).unwrap();
    for (option, value) in [("--sequences", "4"), ("--frames", "50")] {
        let at = arguments.iter().position(|argument| *argument == option).unwrap();
        arguments[at + 1] = value;
    }
    succeed(&arguments);
    let net = eit_denoise::Weights::from_bytes(&std::fs::read(&weights).unwrap()).unwrap();
    assert_eq!((net.shape.images, net.shape.conditions, net.shape.fold), (3, 2, 2));
    let touched = folder.path().join("touched");
    let few = ["--frames", "40", "--nodes", "900", "--out"];
    succeed(&[&["simulate", text(&scene)], &few[..], &[text(&touched)]].concat());
    let made = touched.join("scene.toml");
    let with_net = std::fs::read_to_string(&made).unwrap()
        + &format!("\n[denoise]\nweights = '{}'\n", weights.display());
    std::fs::write(&made, with_net).unwrap();
    let out = folder.path().join("out");
    succeed(&["reconstruct", text(&made), "--method", "gauss-newton", "--out", text(&out)]);
    let read = |name: &str| std::fs::read(out.join(name)).unwrap();
    assert_ne!(read("images.npy"), read("raw.npy"));
    let images = out.join("raw.npy");
    let denoised = folder.path().join("denoised");
    let answer = refuse(&[
        "denoise",
        text(&scene),
        "--images",
        text(&images),
        "--weights",
        text(&weights),
        "--out",
        text(&denoised),
    ]);
    assert!(answer.contains("this net sees the measurements too"), "{answer}");
}

/// Two processes at the same time make the halves of a learning base in one folder: the bytes are those
/// of one process.
#[test]
fn two_processes_make_one_base() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    let base = |out: &Path| {
        let few = ["--method", "gauss-newton", "--sequences", "4", "--frames", "30"];
        let mut arguments: Vec<String> = few.map(str::to_owned).to_vec();
        arguments.extend(["--threads", "1", "--out", text(out)].map(str::to_owned));
        let mut all = vec!["base".to_owned(), text(&scene).to_owned()];
        all.append(&mut arguments);
        all
    };
    let [shared, alone] = ["shared", "alone"].map(|name| folder.path().join(name));
    let part = |part: &'static str| {
        let mut arguments = base(&shared);
        arguments.extend(["--shard".to_owned(), part.to_owned()]);
        std::thread::spawn(move || {
            succeed(&arguments.iter().map(String::as_str).collect::<Vec<_>>())
        })
    };
    let running = [part("1/2"), part("2/2")];
    running.into_iter().for_each(|thread| assert!(thread.join().unwrap().contains("is complete")));
    assert!(shared.join("manifest.1-of-2.json").exists() && !shared.join("manifest.json").exists());
    for out in [&shared, &alone] {
        let arguments = base(out);
        succeed(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    }
    let mut names: Vec<String> =
        (0..4).map(|index| format!("shard-{index:05}.safetensors")).collect();
    names.push("manifest.json".to_owned());
    for name in names {
        let read = |folder: &Path| std::fs::read(folder.join(&name)).unwrap();
        assert_eq!(read(&shared), read(&alone), "{name}");
    }
    let out = text(&shared);
    let found = refuse(&["base", text(&scene), "--out", out, "--shard", "3/2"]);
    assert!(found.contains("the number of a part"), "{found}");
}

/// The paper's learning base: its script, each sequence with a seed of its own, and the images after its
/// rule as the wanted ones.
#[test]
fn a_base_of_the_papers_script_and_rule() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    let out = folder.path().join("paper");
    let mut arguments = vec!["base", text(&scene), "--out", text(&out), "--wanted", "rule"];
    arguments.extend(["--script", "paper-one-finger", "--method", "gauss-newton"]);
    arguments.extend(["--sequences", "2", "--frames", "40", "--threads", "1"]);
    succeed(&arguments);
    let base = eit_denoise::LearningBase::open(&out).unwrap();
    let recipe = &base.settings().recipe;
    assert!(recipe.contains("script paper-one-finger, wanted Rule"), "{recipe}");
    let shards = [0, 1].map(|index| base.read(index).unwrap());
    assert_ne!(shards[0].raw, shards[1].raw);
    for shard in &shards {
        let raw = shard.raw.mapv(f64::from);
        let stack = eit_denoise::ImageStack::new(raw, shard.mask.clone()).unwrap();
        let mut rule = eit_denoise::ThresholdRule::default().on(shard.mask.view()).unwrap();
        let kept = rule.apply(&stack).unwrap();
        let (mut all, mut left) = (0, 0);
        for ((at, wanted), kept) in shard.wanted.indexed_iter().zip(kept.values()) {
            assert!(kept.is_nan() || *wanted == *kept as f32, "{at:?}: {wanted} {kept}");
            all += usize::from(shard.raw[at] != 0.0);
            left += usize::from(*wanted != 0.0);
        }
        assert!(left > 0 && left < all / 2, "{left} of {all}");
    }
    arguments.extend(["--fingers", "2"]);
    assert!(refuse(&arguments).contains("a built-in script has the fingers that it has"));
}

/// A rate at which nothing is learnt leaves the first weights, here a net that shows a touch everywhere:
/// no weights are written, the checkpoint and the curve stay, and `--force` writes them.
#[cfg(feature = "train")]
#[test]
fn a_net_that_is_worse_than_the_raw_images_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    let [weights, first, bad] =
        ["w", "first", "bad"].map(|name| folder.path().join(name).with_extension("safetensors"));
    train(&scene, &first);
    let mut net = eit_denoise::Weights::from_bytes(&std::fs::read(&first).unwrap()).unwrap();
    // the bias of the last convolution
    *net.parameters.last_mut().unwrap() = 10.0;
    std::fs::write(&bad, net.to_bytes().unwrap()).unwrap();
    let base = first.with_extension("base");
    let mut arguments = vec!["train", text(&scene), "--out", text(&weights), "--base", text(&base)];
    arguments.extend(["--from", text(&bad), "--rate", "1e-30"]);
    arguments.extend(&FEW[1..9]);
    let found = fail(&arguments);
    assert!(found.contains("is not written") && found.contains("--force"), "{found}");
    assert!(!weights.exists());
    for ending in ["csv", "png", "checkpoint"] {
        assert!(weights.with_extension(ending).exists(), "{ending}");
    }
    arguments.push("--force");
    succeed(&arguments);
    assert!(weights.exists());
}

/// The shipped weights belong to the built-in scene, and bring images of a simulated finger on
/// another script and seed than they were made from nearer to the truth. Regression: measured 0.3 for
/// 140 frames (see `crates/eit-denoise/weights/README.md`); the bound leaves room for other meshes.
#[test]
fn the_shipped_weights_serve_the_paper_disc() {
    let folder = tempfile::tempdir().unwrap();
    let [touched, raw, out] = ["touched", "raw", "out"].map(|name| folder.path().join(name));
    let frames = ["--frames", "60", "--nodes", "3000", "--seed", "77"];
    let mut arguments = vec!["simulate", "paper-disc", "--out", text(&touched)];
    arguments.extend(frames);
    succeed(&arguments);
    let scene = touched.join("scene.toml");
    succeed(&["reconstruct", text(&scene), "--method", "gauss-newton", "--out", text(&raw)]);
    let (images, truth) = (raw.join("images.npy"), touched.join("truth_conductivity.npy"));
    let answer = succeed(&[
        "denoise",
        "paper-disc",
        "--weights",
        "default",
        "--images",
        text(&images),
        "--truth",
        text(&truth),
        "--out",
        text(&out),
        "--json",
    ]);
    let report: serde_json::Value = serde_json::from_str(&answer).unwrap();
    let ratio = report["against_truth"]["net_over_raw"].as_f64().unwrap();
    assert!(ratio < 0.7, "{ratio}");
    foreign_frames_are_put_aside(folder.path(), &touched);
}

/// The same frames as they are, and turned about the quiet ones, so that a finger lowers the
/// conductivity: nothing in the training did.
fn foreign_frames_are_put_aside(folder: &Path, touched: &Path) {
    let with_net = |name: &str| {
        let text_of = std::fs::read_to_string(touched.join("scene.toml")).unwrap();
        let file = touched.join(format!("{name}.toml"));
        let text_of = text_of.replace("frames.npy", &format!("{name}.npy"));
        std::fs::write(&file, text_of + "\n[denoise]\nweights = \"default\"\n").unwrap();
        file
    };
    let frames: Array2<f64> = ndarray_npy::read_npy(touched.join("frames.npy")).unwrap();
    let quiet = frames.select(Axis(0), &(0..20).collect::<Vec<_>>());
    let quiet = quiet.mean_axis(Axis(0)).unwrap();
    let turned = 2.0 * &quiet - &frames;
    ndarray_npy::write_npy(touched.join("turned.npy"), &turned).unwrap();
    let aside = |name: &str| -> Vec<u64> {
        let out = folder.join(name);
        let scene = with_net(name);
        let answer = succeed(&[
            "reconstruct",
            text(&scene),
            "--method",
            "st-tv",
            "--out",
            text(&out),
            "--json",
        ]);
        let report: serde_json::Value = serde_json::from_str(&answer).unwrap();
        let check = &report["denoise"]["check"];
        assert_eq!(check["scores"].as_array().unwrap().len(), 60);
        let list = check["raw_frames"].as_array().unwrap();
        let frames: Vec<u64> = list.iter().map(|f| f.as_u64().unwrap()).collect();
        let images = |file: &str| -> Array3<f64> { ndarray_npy::read_npy(out.join(file)).unwrap() };
        let (raw, made) = (images("raw.npy"), images("images.npy"));
        let bits = |images: &Array3<f64>, f: usize| -> Vec<u64> {
            images.index_axis(Axis(0), f).iter().map(|v| v.to_bits()).collect()
        };
        for &f in &frames {
            assert_eq!(bits(&raw, f as usize), bits(&made, f as usize), "frame {f}");
        }
        frames
    };
    // the finger is there from frame 22 on, and 2 % of known frames may look foreign
    let known = aside("frames").iter().filter(|f| **f >= 25).count();
    let foreign = aside("turned").iter().filter(|f| **f >= 25).count();
    assert!(known <= 4, "{known}");
    assert_eq!(foreign, 35);
}

/// A recording is learnt from as it is and turned, by the paper's rule; what a recording cannot be
/// asked for is refused.
#[cfg(feature = "train")]
#[test]
fn a_net_learns_from_a_recording() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    let touched = folder.path().join("touched");
    let how = ["--frames", "45", "--nodes", "900", "--out"];
    let mut arguments = vec!["simulate", text(&scene)];
    arguments.extend(how);
    arguments.push(text(&touched));
    succeed(&arguments);
    let (made, frames) = (touched.join("scene.toml"), touched.join("frames.npy"));
    let weights = folder.path().join("w.safetensors");
    let train = |recording: &Path| {
        ["train", text(&made), "--recording", text(recording), "--out", text(&weights)]
            .map(str::to_owned)
    };
    let mut arguments: Vec<String> = train(&frames).to_vec();
    for more in
        ["--method", "gauss-newton", "--sequences", "4", "--epochs", "1", "--width", "2", "--force"]
    {
        arguments.push(more.to_owned());
    }
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    // 38 of its 45 frames, three times; the last 7 are held out
    assert!(succeed(&arguments).contains("121 frames of 4 sequences"));
    let base = weights.with_extension("base");
    let manifest = std::fs::read_to_string(base.join("manifest.json")).unwrap();
    assert!(manifest.contains("recorded: ") && manifest.contains("ThresholdRule"), "{manifest}");
    let shard = |k: usize| std::fs::read(base.join(format!("shard-{k:05}.safetensors"))).unwrap();
    // the recording itself, then turned by one of the 32 symmetries: not the same bytes
    assert!((1..4).any(|k| shard(k) != shard(0)));

    let mut with_fingers = train(&frames).to_vec();
    with_fingers.extend(["--fingers".to_owned(), "2".to_owned()]);
    let with_fingers: Vec<&str> = with_fingers.iter().map(String::as_str).collect();
    assert!(refuse(&with_fingers).contains("--fingers: a recording has the fingers that it has"));
    let mut with_tips = train(&frames).to_vec();
    with_tips.extend(["--usual-tips".to_owned(), "0.5".to_owned()]);
    let with_tips: Vec<&str> = with_tips.iter().map(String::as_str).collect();
    assert!(refuse(&with_tips).contains("--usual-tips: a built-in script and a recording have"));
    let absent = train(&folder.path().join("absent.npy"));
    let absent: Vec<&str> = absent.iter().map(String::as_str).collect();
    assert!(refuse(&absent).contains("absent.npy"));
}
