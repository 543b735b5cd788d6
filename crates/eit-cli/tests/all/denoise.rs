//! Training and denoising as a user does them, on a small skin.

use crate::common::*;

const SMALL_IMAGES: &str = "[reconstruction]\npixels = 24\n";

/// Few enough for a test; such a net may well be worse than the raw images.
#[cfg(feature = "train")]
const FEW: &str =
    "--method gauss-newton --sequences 2 --frames 34 --epochs 2 --width 2 --depth 2 --threads 2";

#[cfg(feature = "train")]
fn train(scene: &str, out: &str) -> serde_json::Value {
    answer(format!("net train {scene} --out {out} {FEW} --images 1 --force"))
}

#[cfg(feature = "train")]
fn weights(path: &str) -> eit_denoise::Weights {
    eit_denoise::Weights::from_bytes(&read(path)).unwrap()
}

/// Weights of another skin: the option is named, and what would have to be in the scene.
#[test]
fn the_shipped_net_on_another_skin_says_how_to_allow_it() {
    let folder = Folder::new();
    let (scene, out) = (folder.scene(SMALL_IMAGES), folder.path("out"));
    let images = folder.write_array("images.npy", &Array3::<f64>::zeros((1, 24, 24)));
    let line = format!("net apply {scene} --images {images} --weights default --out {out}");
    refuse_each([(line, "--any-skin…weights = \"default\", any_skin = true")]);
}

/// Training is compiled in on demand.
#[cfg(not(feature = "train"))]
#[test]
fn a_program_without_training_says_how_to_get_it() {
    let install = "cargo install --path crates/eit-cli --features train";
    refuse_each([("net train paper-disc --out w.safetensors", install)]);
}

/// One after the other: train, again from what is there, denoise, refuse.
#[cfg(feature = "train")]
#[test]
fn a_net_is_trained_goes_on_and_denoises() {
    let (folder, scene) = Folder::with_scene(SMALL_IMAGES);
    let net = folder.path("w.safetensors");
    let report = train(&scene, &net);
    has(&report, json!({ "epochs": 2, "status": "all done" }));
    assert!(number(&report["held_out"], "frames") > 5.0, "{report}");
    for name in ["w.csv", "w.png", "w.checkpoint", "w.base"] {
        assert!(exists(folder.path(name)), "{name}");
    }
    assert_eq!(read_text(folder.path("w.csv")).lines().count(), 3);

    // a shard lost its end, checkpoint and weights are gone: made again, the same weights (metadata stand in any order)
    let (first, shard) = (weights(&net), folder.path("w.base/shard-00001.safetensors"));
    let whole = read(&shard);
    std::fs::write(&shard, &whole[..whole.len() / 2]).unwrap();
    std::fs::remove_file(folder.path("w.checkpoint")).unwrap();
    train(&scene, &net);
    assert!(read(&shard) == whole && weights(&net) == first);
    let other = format!("net train {scene} --out {net} --seed 2 {FEW}");
    refuse_each([(other, "the seed is 1 there, but 2 here")]);
    starts_from_other_weights(&folder, &scene, &net);

    // a recording of the same skin, with and without the net in the scene
    let [touched, plain, netted, out] = folder.paths(["touched", "plain", "netted", "denoised"]);
    succeed(format!("simulate {scene} --frames 40 --nodes 900 --out {touched}"));
    let made = format!("{touched}/scene.toml");
    succeed(format!("reconstruct {made} --method gauss-newton --out {plain}"));
    with_net(&made, &net);
    says(&succeed(format!("reconstruct {made} --method gauss-newton --out {netted}")), "U-net of");
    let images = |folder: &str, name: &str| read(format!("{folder}/{name}"));
    assert_eq!(images(&netted, "raw.npy"), images(&plain, "images.npy"));
    assert_ne!(images(&netted, "images.npy"), images(&plain, "images.npy"));
    let files = format!("--images {plain}/images.npy --truth {touched}/truth_conductivity.npy");
    let said = succeed(format!("net apply {scene} --weights {net} {files} --out {out}"));
    says(&said, "of the raw image's");
    assert_eq!(images(&out, "images.npy"), images(&netted, "images.npy"));
    refusals(&folder, &scene, &net, &format!("{plain}/images.npy"));
}

/// Names a net in a scene.
fn with_net(scene: &str, net: &str) {
    let content = read_text(scene) + &format!("\n[denoise]\nweights = '{net}'\n");
    std::fs::write(scene, content).unwrap();
}

/// Killed while it makes the base, learns or compares: nothing is left but what it goes on with.
#[cfg(all(feature = "train", unix))]
#[test]
fn a_killed_training_leaves_no_stray_files() {
    let folder = Folder::new();
    let (scene, net) = (folder.scene(SMALL_IMAGES), folder.path("w.safetensors"));
    let names = || {
        let base = Some(folder.path("w.base")).filter(|base| exists(base));
        [folder.names(), base.map(names_in).unwrap_or_default()].concat()
    };
    let line = format!("net train {scene} --out {net} {FEW} --images 1 --force");
    for kill in 1_u32..=6 {
        let mut command = command(&line);
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        // later each time, whatever it does by then
        let until = Instant::now() + Duration::from_millis(300) * kill * kill;
        while Instant::now() < until && child.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_millis(5));
        }
        // SIGKILL; it may have ended
        let _ = child.kill();
        child.wait().unwrap();
        // what is half written has the name of what it becomes, so that the next run replaces it
        let known = |name: &String| {
            let name = name.strip_prefix(".eit-").unwrap_or(name);
            let part = name.starts_with("shard-") || name.starts_with("manifest");
            name.starts_with("w.") || part || name.ends_with(".toml")
        };
        assert!(names().iter().all(known), "{:?}", names());
    }
    train(&scene, &net);
    assert!(!names().iter().any(|name| name.starts_with('.')), "{:?}", names());
}

/// At a rate at which nothing is learnt the weights stay the first ones, and the file names them.
#[cfg(feature = "train")]
fn starts_from_other_weights(folder: &Folder, scene: &str, net: &str) {
    let [out, judged, base] = folder.paths(["from.safetensors", "judged.safetensors", "w.base"]);
    let few = "--method gauss-newton --sequences 2 --frames 34";
    let data = format!("--base {base} --from {net} {few}");
    let line = format!("net train {scene} --out {out} {data} --rate 1e-30 --epochs 2 --force");
    succeed(format!("{line} --threads 1"));
    let [first, made] = [net, &out].map(weights);
    assert_eq!((made.shape, &made.parameters), (first.shape, &first.parameters));
    assert_eq!(made.about["from"], eit_skin::train::parameter_checksum(&first));
    assert!(!first.about.contains_key("from"));
    // a judge needs more frames than this base has
    let none = fail(format!("net train {scene} --out {judged} {data} --epochs 0"));
    assert!(none.contains("too few to measure the judge") && !exists(&judged), "{none}");
    refuse_each([(format!("{line} --width 4"), "cannot be used with")]);
    // of a net that shows a touch everywhere (the bias of the last convolution) no weights are written, the checkpoint
    // and the curve stay, and `--force` writes them
    let mut everywhere = first;
    *everywhere.parameters.last_mut().unwrap() = 10.0;
    let bad = folder.write("bad.safetensors", everywhere.to_bytes().unwrap());
    let line = line.replace(net, &bad).replace(&out, &judged).replace(" --force", "");
    let found = fail(&line);
    assert!(found.contains("is not written") && found.contains("--force"), "{found}");
    assert!(!exists(&judged));
    let left = ["judged.csv", "judged.png", "judged.checkpoint"];
    assert!(left.iter().all(|name| exists(folder.path(name))));
    succeed(format!("{line} --force"));
    assert!(exists(&judged));
}

#[cfg(feature = "train")]
fn refusals(folder: &Folder, scene: &str, net: &str, images: &str) {
    let out = folder.path("refused");
    let bytes = read(net);
    let cut = folder.write("cut.safetensors", &bytes[..bytes.len() - 9]);
    let apply = |scene: &str, images: &str, net: &str| {
        format!("net apply {scene} --images {images} --weights {net} --out {out}")
    };
    let train = |out: &str| format!("net train {scene} --out {out}");
    refuse_each([
        // the paper's skin at 24 pixels is not the small one
        (apply("paper-disc", images, net), "the weights are for skin"),
        (apply(scene, images, &cut), "cut.safetensors: damaged, or not a file"),
        (apply(scene, &cut, net), "cut.safetensors"),
        (train("w.npy"), ".safetensors"),
        (train("w.safetensors --device torch"), "there are flex (the processor), cuda and wgpu"),
    ]);
    if !cfg!(feature = "cuda") {
        let wanted = "--device cuda: this program was built without";
        refuse_each([(train("w.safetensors --device cuda"), wanted)]);
    }
    assert!(!exists(format!("{out}/images.npy")));
}

/// A net that sees measurements runs where they are, and is refused where there are images alone.
#[cfg(feature = "train")]
#[test]
fn a_net_that_sees_measurements_is_trained_and_runs() {
    let (folder, scene) = Folder::with_scene(SMALL_IMAGES);
    let [net, touched, out, applied] = folder.paths(["w.safetensors", "touched", "out", "applied"]);
    let line = format!("net train {scene} --out {net} --seed 3 --images 3 --fold 2 --force {FEW}");
    // so few frames that no touch is detected in the one held out
    refuse_each([(&line, "no touch is detected in any of the 1 sequences")]);
    std::fs::remove_dir_all(folder.path("w.base")).unwrap();
    succeed(line.replace("--sequences 2 --frames 34", "--sequences 4 --frames 50"));
    let shape = weights(&net).shape;
    assert_eq!((shape.images, shape.conditions, shape.fold), (3, 2, 2));
    succeed(format!("simulate {scene} --frames 40 --nodes 900 --out {touched}"));
    let made = format!("{touched}/scene.toml");
    with_net(&made, &net);
    succeed(format!("reconstruct {made} --method gauss-newton --out {out}"));
    assert_ne!(read(format!("{out}/images.npy")), read(format!("{out}/raw.npy")));
    let line = format!("net apply {scene} --images {out}/raw.npy --weights {net} --out {applied}");
    refuse_each([(line, "this net sees the measurements too")]);
}

/// Two processes make the halves of a learning base in one folder: the bytes are those of one process.
#[test]
fn two_processes_make_one_base() {
    let (folder, scene) = Folder::with_scene(SMALL_IMAGES);
    let base = |out: &str| {
        let few = "--method gauss-newton --sequences 4 --frames 30 --threads 1";
        format!("net base {scene} {few} --out {out}")
    };
    let [shared, alone] = folder.paths(["shared", "alone"]);
    std::thread::scope(|scope| {
        for part in ["1/2", "2/2"] {
            let line = format!("{} --shard {part}", base(&shared));
            scope.spawn(move || says(&succeed(line), "is complete"));
        }
    });
    assert!(exists(format!("{shared}/manifest.1-of-2.json")));
    assert!(!exists(format!("{shared}/manifest.json")));
    [&shared, &alone].into_iter().for_each(|out| _ = succeed(base(out)));
    let shards = (0..4).map(|index| format!("shard-{index:05}.safetensors"));
    for name in shards.chain(["manifest.json".to_owned()]) {
        let [one, other] = [&shared, &alone].map(|folder| read(format!("{folder}/{name}")));
        assert_eq!(one, other, "{name}");
    }
    refuse_each([(format!("{} --shard 3/2", base(&shared)), "the number of a part")]);
}

/// A recording as it is and turned, nothing held out, and the images after the rule as the wanted ones.
#[test]
fn a_base_of_the_papers_rule() {
    let (folder, scene) = Folder::with_scene(SMALL_IMAGES);
    let [out, touched] = folder.paths(["paper", "touched"]);
    let script = "--script one-finger --frames 40 --nodes 900";
    succeed(format!("simulate {scene} {script} --out {touched}"));
    let how = format!("--recording {touched}/frames.npy --pairs 30 --method gauss-newton");
    let line = format!("net base {touched}/scene.toml --out {out} {how} --threads 1");
    succeed(&line);
    let base = eit_denoise::LearningBase::open(&out).unwrap();
    let recipe = &base.settings().recipe;
    assert!(recipe.contains("none held out, ThresholdRule"), "{recipe}");
    let shards = [0, 1].map(|index| base.read(index).unwrap());
    assert_eq!((base.settings().shards, shards[0].raw.dim().0, shards[1].raw.dim().0), (2, 40, 40));
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
    let built_in = format!("net base {scene} --out {out} --script one-finger --fingers 2");
    refuse_each([
        (format!("{line} --sequences 4"), "cannot be used with"),
        (built_in, "a built-in script has the fingers that it has"),
    ]);
}

/// A finger on another script and seed than they were made from: measured 0.3 for 140 frames (see
/// `crates/eit-denoise/weights/README.md`); the bound leaves room for other meshes.
#[test]
fn the_shipped_weights_serve_the_paper_disc() {
    let (folder, [touched, raw, out]) = Folder::with_paths(["touched", "raw", "out"]);
    succeed(format!("simulate paper-disc --out {touched} --frames 40 --nodes 3000 --seed 77"));
    succeed(format!("reconstruct {touched}/scene.toml --method gauss-newton --out {raw}"));
    let files = format!("--images {raw}/images.npy --truth {touched}/truth_conductivity.npy");
    let report = answer(format!("net apply paper-disc --weights default {files} --out {out}"));
    let ratio = number(&report["against_truth"], "net_over_raw");
    assert!(ratio < 0.7, "{ratio}");
    foreign_frames_are_put_aside(&folder, &touched);
}

/// Frames as they are, and turned about the quiet ones: in no training a finger lowered the conductivity.
fn foreign_frames_are_put_aside(folder: &Folder, touched: &str) {
    let frames: Array2<f64> = read_array(format!("{touched}/frames.npy"));
    let quiet = frames.select(Axis(0), &(0..20).collect::<Vec<_>>());
    let quiet = quiet.mean_axis(Axis(0)).unwrap();
    folder.write_array("touched/turned.npy", &(2.0 * &quiet - &frames));
    let content = read_text(format!("{touched}/scene.toml"));
    let aside = |name: &str| {
        let content = content.replace("frames.npy", &format!("{name}.npy"));
        let scene = folder.write(&format!("touched/{name}.toml"), content);
        with_net(&scene, "default");
        let out = folder.path(name);
        let report = answer(format!("reconstruct {scene} --method st-tv --out {out}"));
        let check = &report["denoise"]["check"];
        assert_eq!(check["scores"].as_array().unwrap().len(), 40);
        let [raw, made] = ["raw", "images"]
            .map(|file| read_array::<Ix3>(format!("{out}/{file}.npy")).mapv(f64::to_bits));
        let frames = numbers(check, "raw_frames");
        for f in frames.iter().map(|f| *f as usize) {
            assert_eq!(raw.index_axis(Axis(0), f), made.index_axis(Axis(0), f), "frame {f}");
        }
        // the finger is there from frame 22 on
        frames.into_iter().filter(|f| *f >= 25.0).count()
    };
    // 2 % of known frames may look foreign
    let (known, foreign) = (aside("frames"), aside("turned"));
    assert!(known <= 1 && foreign == 15, "{known} {foreign}");
}

/// As it is and turned, by the paper's rule; what a recording cannot be asked for is refused.
#[cfg(feature = "train")]
#[test]
fn a_net_learns_from_a_recording() {
    let (folder, scene) = Folder::with_scene(SMALL_IMAGES);
    let [touched, net] = folder.paths(["touched", "w.safetensors"]);
    succeed(format!("simulate {scene} --frames 45 --nodes 900 --out {touched}"));
    let train = |recording: &str, more: &str| {
        let from = format!("{touched}/scene.toml --recording {touched}/{recording}");
        format!("net train {from} --out {net} {more}")
    };
    let few = "--method gauss-newton --sequences 4 --epochs 1 --width 2 --force";
    // 38 of its 45 frames, three times; the last 7 are held out
    assert!(succeed(train("frames.npy", few)).contains("121 frames of 4 sequences"));
    says(&read_text(folder.path("w.base/manifest.json")), "recorded: …ThresholdRule");
    let shard = |k: usize| read(folder.path(&format!("w.base/shard-{k:05}.safetensors")));
    // the recording itself, then turned by one of the 32 symmetries: not the same bytes
    assert!((1..4).any(|k| shard(k) != shard(0)));
    // as in the paper: some 24 of 45 frames have a finger, away from the rim, the others are of the turned copy
    let [held, pairs] = folder.paths(["held", "pairs.safetensors"]);
    let script = "--script press-and-hold --frames 45 --nodes 900";
    succeed(format!("simulate {scene} {script} --out {held}"));
    let as_paper = |count: usize| {
        let from = format!("{held}/scene.toml --recording {held}/frames.npy --out {pairs}");
        let how = "--method gauss-newton --images 1 --epochs 1 --width 2 --force";
        format!("net train {from} {how} --pairs {count}")
    };
    assert!(succeed(as_paper(30)).contains("30 frames of 2 sequences"));
    assert_eq!(weights(&pairs).about["examples"], "30");
    let few = "--pairs: 1000, but the recordings and a turned copy of each have";
    let own = "--fingers: a recording has the fingers that it has";
    let tips = "--usual-tips: a built-in script and a recording have";
    refuse_each([
        (as_paper(1000), few),
        (train("frames.npy", "--fingers 2"), own),
        (train("frames.npy", "--usual-tips 0.5"), tips),
        (train("absent.npy", ""), "absent.npy"),
    ]);
}
