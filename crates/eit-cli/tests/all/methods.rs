//! Every method from frames to images, on a small simulated skin.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "tests")]

use crate::common::{SMALL, refuse, succeed, text, write_scene};
use fixtures::Random;
use ndarray::{Array1, Array2, Array3, Axis};
use serde_json::Value;
use std::path::{Path, PathBuf};

const METHODS: [&str; 5] = ["st-tv", "tv", "gauss-newton", "time-prior", "gauss-newton-absolute"];

/// Standard deviation of the simulated noise, volt; the largest voltages are a few volts.
const NOISE_V: f64 = 1e-4;
/// Quiet frames, then frames with a finger.
const QUIET: usize = 8;
const TOUCHED: usize = 4;

/// Position of the finger in a touched frame, metres.
fn finger(frame: usize) -> [f64; 2] {
    [0.04, 0.02 - 0.01 * frame as f64]
}

/// Recorded frames of a finger and their scene.
struct Fixture {
    folder: tempfile::TempDir,
    frames: PathBuf,
}

/// Voltages of the finger on a finer mesh than the scene's, computed by the program itself.
fn fixture() -> Fixture {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let fine = write_scene(folder.path(), &SMALL.replace("edge_m = 0.012", "edge_m = 0.008"));
    let mesh_file = path("fine.msh");
    succeed(&["mesh", text(&fine), "--out", text(&mesh_file)]);
    let mesh = eit_mesh::read_gmsh(&mesh_file).unwrap();
    let solve = |sigma: &dyn Fn([f64; 3]) -> f64| -> Array1<f64> {
        let centroids = mesh.surface().centroids();
        let values: Vec<f64> = centroids.into_iter().map(sigma).collect();
        let conductivity = Array2::from_shape_vec((1, values.len()), values).unwrap();
        let (file, out) = (path("sigma.npy"), path("v.npy"));
        ndarray_npy::write_npy(&file, &conductivity).unwrap();
        let files = ["--mesh", text(&mesh_file), "--conductivity", text(&file)];
        succeed(&[&["forward", text(&fine), "--out", text(&out)], &files[..]].concat());
        ndarray_npy::read_npy(&out).unwrap()
    };
    let untouched = solve(&|_| 1e-5);
    let mut noise = Random::new(1);
    let mut frames = Array2::zeros((QUIET + TOUCHED, untouched.len()));
    for (f, mut row) in frames.rows_mut().into_iter().enumerate() {
        let clean = if f < QUIET {
            untouched.clone()
        } else {
            let [x, y] = finger(f - QUIET);
            solve(&|c| if (c[0] - x).hypot(c[1] - y) < 0.02 { 1.5e-5 } else { 1e-5 })
        };
        row.assign(&clean.mapv(|v| v + NOISE_V * noise.normal()));
    }
    let frames_file = path("frames.npy");
    ndarray_npy::write_npy(&frames_file, &frames).unwrap();
    Fixture { frames: frames_file, folder }
}

impl Fixture {
    /// A scene with more keys than [`SMALL`].
    fn scene(&self, more: &str) -> PathBuf {
        write_scene(self.folder.path(), &format!("{SMALL}\n{more}"))
    }

    /// Images and report of a run.
    fn run(&self, scene: &Path, more: &[&str]) -> (Array3<f64>, Value) {
        let out = self.folder.path().join("out");
        let fixed =
            ["reconstruct", text(scene), "--frames", text(&self.frames), "--out", text(&out)];
        let answer = succeed(&[&fixed[..], more, &["--json"]].concat());
        let images = ndarray_npy::read_npy(out.join("images.npy")).unwrap();
        for file in ["sheet.png", "movie.gif", "report.json"] {
            assert!(std::fs::metadata(out.join(file)).unwrap().len() > 500, "{file}");
        }
        (images, serde_json::from_str(&answer).unwrap())
    }
}

/// Centre of the region above half of the largest value of a frame, metres, on a raster over the disc of 0.1
/// m.
fn centre_m(images: &Array3<f64>, frame: usize) -> [f64; 2] {
    let image = images.index_axis(Axis(0), frame);
    let most = image.iter().filter(|v| v.is_finite()).fold(0.0, |m: f64, v| m.max(*v));
    let pixel = 0.2 / image.nrows() as f64;
    let (mut sum, mut moment) = (0.0, [0.0; 2]);
    for ((row, column), value) in image.indexed_iter().filter(|(_, v)| **v >= 0.5 * most) {
        sum += value;
        moment[0] += value * ((column as f64 + 0.5) * pixel - 0.1);
        moment[1] += value * (0.1 - (row as f64 + 0.5) * pixel);
    }
    moment.map(|m| m / sum)
}

fn distance([a, b]: [f64; 2], [c, d]: [f64; 2]) -> f64 {
    (a - c).hypot(b - d)
}

#[test]
fn every_method_finds_the_finger() {
    let fixture = fixture();
    let scene = fixture.scene("[reconstruction]\npixels = 24\n[noise]\nquiet_frames = \"0..8\"\n");
    for method in METHODS {
        let reference = ["--method", method, "--reference", "0..8"];
        let (images, report) = fixture.run(&scene, &reference);
        assert_eq!(images.dim(), (QUIET + TOUCHED, 24, 24), "{method}");
        assert_eq!(report["method"], method);
        for f in 0..TOUCHED {
            let error = distance(centre_m(&images, QUIET + f), finger(f));
            // half of the finger's radius of 20 mm
            assert!(error < 0.01, "{method}, frame {f}: {error}");
        }
        let status = report["status"].as_str().unwrap();
        assert!(["converged", "direct"].contains(&status), "{method}: {status}");
        if !["st-tv", "tv"].contains(&method) {
            assert!(report["hyperparameter"].as_f64().unwrap() > 0.0, "{method}");
            continue;
        }
        // nothing in the quiet frames is taken for a touch
        let quiet = report["quiet_frames"].as_u64().unwrap();
        assert_eq!(quiet, QUIET as u64, "{method}");
        assert!(images.index_axis(Axis(0), 0).iter().all(|v| v.is_nan() || *v == 0.0));
        let number = |key: &str| report[key].as_f64().unwrap();
        assert!(number("gap") <= number("target_gap") && number("gap") >= 0.0, "{method}");
        assert!(number("lower_bound") <= number("primal"), "{method}");
        let residual = report["residual"].as_array().unwrap();
        assert!(residual[..QUIET].iter().all(Value::is_null), "{method}");
        // a quarter of the weights of the discrepancy principle: the residual is below the noise
        for r in &residual[QUIET..] {
            let ratio = r.as_f64().unwrap() / number("residual_wanted");
            assert!((0.3..1.5).contains(&ratio), "{method}: {ratio}");
        }
        assert!(fixture.folder.path().join("out/hyperparameter.png").exists(), "{method}");
    }
}

/// Stated noise selects st-tv, its weights and the frames that it skips; bounds hold.
#[test]
fn the_scene_chooses() {
    let fixture = fixture();
    let noise = format!("[noise]\nadditive_v = {NOISE_V}\n");
    let reference = ["--reference", "0..8"];
    let scene = fixture.scene(&format!("[reconstruction]\npixels = 24\nlower_s = 0.0\n{noise}"));
    let (images, report) = fixture.run(&scene, &reference);
    assert_eq!(report["method"], "st-tv");
    assert_eq!(report["quiet_frames"], QUIET);
    assert!(images.iter().all(|v| v.is_nan() || *v >= 0.0), "the bound holds");
    assert!(report["noise"]["source"].as_str().unwrap().contains("from the scene"));
    let scene = fixture.scene("[reconstruction]\npixels = 24\n");
    assert_eq!(fixture.run(&scene, &reference).1["method"], "gauss-newton");
    // the paper's form: every frame within its noise
    let scene =
        fixture.scene(&format!("[reconstruction]\npixels = 24\ndelta = \"noise\"\n{noise}"));
    let (images, report) = fixture.run(&scene, &reference);
    let delta = report["weights"]["delta"].as_f64().unwrap();
    // the noise includes the model error, the stated delta refers to the noise alone, as numbers in scenes do
    let raised = report["noise"]["model_error_factor"].as_f64().unwrap();
    assert!(((delta / raised).powi(2) - 40.0).abs() < 1e-9, "40 measurements: {delta}, {raised}");
    let stated = format!("[reconstruction]\npixels = 24\ndelta = {delta:e}\n{noise}");
    let again = fixture.run(&fixture.scene(&stated), &reference).0;
    let pairs = || images.iter().zip(&again).filter(|(a, _)| a.is_finite());
    let apart = pairs().map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    let size = pairs().map(|(a, _)| a * a).sum::<f64>().sqrt();
    // both within 1e-2 of one optimum
    assert!(apart <= 0.1 * size, "{apart:e} of {size:e}: {report}");
    // weights from a report give the same images when stated in the scene: with known noise, which the model
    // error raised, and with unknown noise
    for noise in [noise.as_str(), ""] {
        let keys = "[reconstruction]\nmethod = \"st-tv\"\npixels = 24\ntarget_gap = 1e-4\n";
        let scene = fixture.scene(&format!("{keys}{noise}"));
        let (images, report) = fixture.run(&scene, &reference);
        let weight = |name: &str| report["weights"][name].as_f64().unwrap();
        let stated = format!(
            "lambda_space = {:e}\nlambda_time = {:e}\n",
            weight("lambda_space"),
            weight("lambda_time")
        );
        let again = fixture.run(&fixture.scene(&format!("{keys}{stated}{noise}")), &reference).0;
        let pairs = || images.iter().zip(&again).filter(|(a, _)| a.is_finite());
        let apart = pairs().map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        let size = pairs().map(|(a, _)| a * a).sum::<f64>().sqrt();
        // both within 1e-4 of one optimum, which determines the images to a few percent
        assert!(apart <= 0.05 * size, "{apart:e} of {size:e}: {report}");
    }
    let scene = fixture.scene("[reconstruction]\npixels = 24\nlambda_space = 1.0\n");
    let report = fixture.run(&scene, &reference).1;
    assert_eq!(report["weights"]["lambda_space"], 1.0);
    assert_eq!(report["weights"]["rule"], "fixed by the scene");
    // a gap that cannot be reached in a millisecond: the best image so far, with its certificate
    let keys = "pixels = 64\nlambda_space = 1e7\ntarget_gap = 1e-12\ndeadline_s = 1e-3\n";
    let scene = fixture.scene(&format!("[reconstruction]\n{keys}"));
    let (images, report) = fixture.run(&scene, &reference);
    assert_eq!(report["status"], "deadline", "{report}");
    assert!(report["gap"].as_f64().unwrap() > 1e-12);
    assert!(images.iter().any(|v| v.is_finite()));
}

/// One frame is plain total variation, equal frames are one, and quiet frames are none.
#[test]
fn what_a_recording_does_not_need_is_left_out() {
    let fixture = fixture();
    let frames: Array2<f64> = ndarray_npy::read_npy(&fixture.frames).unwrap();
    let scene = fixture.scene(&format!(
        "[reconstruction]\npixels = 16\n[noise]\nadditive_v = {NOISE_V}\n[recording]\nreference = \
         \"reference.npy\"\n"
    ));
    let write = |name: &str, rows: &[usize]| {
        let file = fixture.folder.path().join(name);
        ndarray_npy::write_npy(&file, &frames.select(Axis(0), rows)).unwrap();
        file
    };
    write("reference.npy", &[0, 1, 2, 3, 4, 5]);
    let run = |rows: &[usize]| -> Value {
        let file = write("part.npy", rows);
        let out = fixture.folder.path().join("part");
        let arguments = ["--frames", text(&file), "--out", text(&out), "--json"];
        let answer = succeed(&[&["reconstruct", text(&scene)], &arguments[..]].concat());
        serde_json::from_str(&answer).unwrap()
    };
    let one = run(&[QUIET]);
    assert_eq!(one["method"], "tv", "{one}");
    assert_eq!(one["weights"]["lambda_time"], 0.0);
    let nothing = run(&[6, 7]);
    assert_eq!(nothing["quiet_frames"], 2, "{nothing}");
    assert_eq!(nothing["status"], "nothing to solve");
    // the same touch with other noise: moving frames are not equal
    assert_eq!(run(&[8, 9, 10, 11])["still"], false);
    let mut noise = Random::new(11);
    let alike = Array2::from_shape_fn((5, frames.ncols()), |(_, i)| {
        frames[[QUIET, i]] + NOISE_V * noise.normal()
    });
    let file = fixture.folder.path().join("alike.npy");
    ndarray_npy::write_npy(&file, &alike).unwrap();
    let out = fixture.folder.path().join("alike");
    let arguments = ["--frames", text(&file), "--out", text(&out), "--json"];
    let answer = succeed(&[&["reconstruct", text(&scene)], &arguments[..]].concat());
    let still: Value = serde_json::from_str(&answer).unwrap();
    assert_eq!((&still["still"], &still["method"]), (&true.into(), &"st-tv".into()), "{still}");
    assert_eq!(still["weights"]["lambda_time"], 0.0, "one image has nothing to couple");
    // the plan reads the recording and agrees
    let noise = format!("[reconstruction]\npixels = 16\n[noise]\nadditive_v = {NOISE_V}\n");
    let told = |file: &str| {
        let recording = format!("[recording]\nfile = \"{file}\"\nreference = \"reference.npy\"\n");
        let scene = fixture.scene(&format!("{noise}{recording}"));
        succeed(&["plan", text(&scene)])
    };
    let plan = told("alike.npy");
    for words in
        ["time term: dropped, the 5 frames", "a static scene: one image", "mean of 5 frames"]
    {
        assert!(plan.contains(words), "{words}: {plan}");
    }
    let plan = told("frames.npy");
    assert!(plan.contains("time term: couples 12 frames"), "{plan}");
    let images: Array3<f64> = ndarray_npy::read_npy(out.join("images.npy")).unwrap();
    let same = |f: usize| {
        let pair = images.index_axis(Axis(0), 0).into_owned();
        pair.iter().zip(images.index_axis(Axis(0), f)).all(|(a, b)| a == b || a.is_nan())
    };
    assert!((1..5).all(same), "one image serves all");
}

/// Limits beyond what a clock can count are ignored; a frame is named by its number in the recording.
#[test]
fn numbers_out_of_reach() {
    let fixture = fixture();
    let noise = format!("[noise]\nadditive_v = {NOISE_V}\n");
    let keys = "pixels = 16\ndeadline_s = 1e300\n";
    let scene = fixture.scene(&format!("[reconstruction]\n{keys}{noise}"));
    assert_eq!(fixture.run(&scene, &["--reference", "0..8"]).1["status"], "converged");
    let scene = fixture.scene(&format!("[reconstruction]\npixels = 16\ndelta = 0.0\n{noise}"));
    let out = fixture.folder.path().join("none");
    let arguments = ["--frames", text(&fixture.frames), "--reference", "0..8", "--out", text(&out)];
    let found = refuse(&[&["reconstruct", text(&scene)], &arguments[..]].concat());
    // the first eight frames are quiet and not solved: the first one solved is number 8
    assert!(found.contains(&format!("frame {QUIET}: delta is 0")), "{found}");
    let scene = fixture.scene("[reconstruction]\ntarget_gap = 5.0\n");
    assert!(refuse(&["plan", text(&scene)]).contains("target_gap is 5: "));
}

/// Residuals of the element-based methods are in units of the noise of a difference, including the gain of
/// the recording against the model and the noise of the reference.
#[test]
fn residuals_are_in_units_of_the_noise() {
    let fixture = fixture();
    let frames: Array2<f64> = ndarray_npy::read_npy(&fixture.frames).unwrap();
    // a recording in another unit: everything, noise included, is ten times as large
    let file = fixture.folder.path().join("ten.npy");
    ndarray_npy::write_npy(&file, &(10.0 * &frames)).unwrap();
    let run = |file: &Path, noise_v: f64| -> Value {
        let keys = "pixels = 16\nmethod = \"time-prior\"\n";
        let noise = format!("[noise]\nadditive_v = {noise_v:e}\n");
        let scene = fixture.scene(&format!("[reconstruction]\n{keys}{noise}"));
        let out = fixture.folder.path().join("out");
        let recording = ["--frames", text(file), "--reference", "0..8", "--out", text(&out)];
        let answer =
            succeed(&[&["reconstruct", text(&scene)], &recording[..], &["--json"]].concat());
        serde_json::from_str(&answer).unwrap()
    };
    let [one, ten] = [run(&fixture.frames, NOISE_V), run(&file, 10.0 * NOISE_V)];
    let residual = |report: &Value, frame: usize| report["residual"][frame].as_f64().unwrap();
    for frame in 0..QUIET + TOUCHED {
        let ratio = residual(&ten, frame) / residual(&one, frame);
        // rounding of 10 v
        assert!((ratio - 1.0).abs() < 1e-6, "frame {frame}: {ratio}");
    }
    // a quiet frame only contains noise, of which the image follows some degrees of freedom; those just
    // before the finger contain some of its image, due to the prior in time
    let wanted = one["residual_wanted"].as_f64().unwrap();
    for frame in 0..QUIET - 4 {
        let ratio = residual(&one, frame) / wanted;
        // 40 measurements, up to 20 of them followed: the square root of a half, and a spread of a ninth
        assert!((0.4..1.4).contains(&ratio), "frame {frame}: {ratio}");
    }
}

/// Without known noise the weights come from the model error, and the user is told.
#[test]
fn unknown_noise_is_said() {
    let fixture = fixture();
    let scene = fixture.scene("[reconstruction]\npixels = 24\nmethod = \"st-tv\"\n");
    let (images, report) = fixture.run(&scene, &["--reference", "0"]);
    assert!(report["notes"].to_string().contains("additive_v"), "{}", report["notes"]);
    assert_eq!(report["quiet_frames"], 0, "without noise no frame is quiet");
    let error = distance(centre_m(&images, QUIET + 1), finger(1));
    assert!(error < 0.01, "{error}");
}

/// Touches are listed with their positions, independently of the image method, and only if the noise is
/// known.
#[test]
fn touches_are_written_where_the_noise_is_known() {
    let fixture = fixture();
    let out = fixture.folder.path().join("out");
    // the object is a disc of 20 mm: with a bell of 7 mm it would appear as two touches
    let known = fixture.scene(
        "[reconstruction]\npixels = 24\n[noise]\nadditive_v = 1e-4\n[touch]\nradius_m = 0.02\n",
    );
    for method in ["st-tv", "gauss-newton"] {
        let (_, report) = fixture.run(&known, &["--method", method, "--reference", "0..8"]);
        assert_eq!(report["touches"]["count"], 1, "{method}: {report}");
        assert_eq!(report["touches"]["most_at_once"], 1);
        assert_eq!(report["touches"]["frames_with_touch"], TOUCHED, "{report}");
        let csv = std::fs::read_to_string(out.join("touches.csv")).unwrap();
        let rows: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
        assert_eq!(
            rows[0].join(","),
            "frame,time_s,id,state,x_m,y_m,z_m,intensity,intensity_std,confidence,std_x,std_y,vx,vy,\
             valid,whole,force_n,force_std_n,unlike,nx,ny,nz"
        );
        assert!(rows.iter().all(|row| row.len() == rows[0].len()));
        // a touch this strong is accepted at once
        assert_eq!((rows.len(), rows[1][0], rows[1][3]), (TOUCHED + 1, "8", "begin"), "{csv}");
        for row in &rows[1..] {
            let number = |k: usize| row[k].parse::<f64>().unwrap();
            let error = distance([number(4), number(5)], finger(number(0) as usize - QUIET));
            // half of the finger's radius of 20 mm
            assert!(error < 0.01, "{method}: {row:?}");
            assert!(number(9) > 0.6 && row[2] == "1", "{row:?}");
            assert_eq!((row[14], row[15]), ("true", "true"), "{row:?}");
        }
    }
    // without noise no list, and none is left from the earlier run
    let unknown = fixture.scene("[reconstruction]\npixels = 24\n");
    let (_, report) = fixture.run(&unknown, &["--method", "gauss-newton", "--reference", "0"]);
    assert!(report["touches"].is_null());
    assert!(!out.join("touches.csv").exists());
    for (keys, name) in [
        ("max_touches = 0", "max_touches"),
        ("least_strength_m2 = -1.0", "touch.least_strength_m2"),
        ("birth_frames = 0", "birth_frames"),
        // of earlier versions
        ("false_alarms_per_hour = 1.0", "was removed"),
        ("birth_hits = 2", "birth_frames"),
        ("max_touch = 1", "max_touches"),
    ] {
        let scene = fixture.scene(&format!("[noise]\nadditive_v = 1e-4\n[touch]\n{keys}\n"));
        let frames = text(&fixture.frames);
        let said = refuse(&["reconstruct", text(&scene), "--frames", frames, "--out", text(&out)]);
        assert!(said.contains(name), "{keys}: {said}");
    }
}

#[test]
fn unknown_methods_list_the_names() {
    let fixture = fixture();
    let out = fixture.folder.path().join("none");
    let arguments = ["--frames", text(&fixture.frames), "--reference", "0", "--out", text(&out)];
    let scene = fixture.scene("");
    let wrong = [&["reconstruct", text(&scene), "--method", "st-tw"], &arguments[..]].concat();
    let found = refuse(&wrong);
    for method in METHODS {
        assert!(found.contains(&format!("\"{method}\"")), "{found}");
    }
    assert!(!out.exists(), "refused before anything is made");
    let found = refuse(&["plan", text(&fixture.scene("[reconstruction]\nmethod = \"TV\"\n"))]);
    assert!(found.contains("reconstruction.method = \"TV\"") && found.contains("\"time-prior\""));
    // quiet frames beyond the recording
    let scene = fixture.scene("[noise]\nquiet_frames = \"0..100\"\n");
    let found = refuse(&[&["reconstruct", text(&scene)], &arguments[..]].concat());
    assert!(found.contains("quiet_frames") && found.contains("0 to 11"), "{found}");
}

#[test]
fn plan_tells_the_method_and_why() {
    let folder = tempfile::tempdir().unwrap();
    let plan = |more: &str, arguments: &[&str]| {
        let scene = write_scene(folder.path(), &format!("{SMALL}\n{more}"));
        succeed(&[&["plan", text(&scene)], arguments].concat())
    };
    let told = plan("", &[]);
    assert!(told.contains("method gauss-newton") && told.contains("states no noise"), "{told}");
    let noise = "[noise]\nadditive_v = 1e-6\n";
    let told = plan(noise, &[]);
    for words in [
        "method st-tv: the scene states its noise",
        "static scene",
        "single one (plain total variation)",
        "discrepancy principle",
        "iterations to gap 1e-2",
        "iterations as on paper-disc-60",
        "Gflop/s effective",
        "20 frames assumed",
        "rank 20 at most",
    ] {
        assert!(told.contains(words), "{words}: {told}");
    }
    // the recording is read for its size: one frame is plain total variation
    let one = folder.path().join("one.csv");
    std::fs::write(&one, vec!["1"; 40].join(",")).unwrap();
    let told = plan(&format!("{noise}[recording]\nfile = \"one.csv\"\nreference = 0\n"), &[]);
    assert!(told.contains("method tv: one frame"), "{told}");
    assert!(told.contains("time term: dropped, one frame is plain total variation"), "{told}");
    assert!(told.contains("pixels, one frame"), "{told}");
    // without a weight in time nothing is coupled, whatever the frames
    let told = plan(&format!("{noise}[reconstruction]\nlambda_time = 0.0\n"), &[]);
    assert!(told.contains("time term: none") && !told.contains("couples"), "{told}");
    for method in METHODS {
        assert!(plan("", &["--method", method]).contains(&format!("method {method}: requested")));
    }
}

/// A resistive skin and one frame need no complex numbers, no time term, no U-net and no instrument, whatever
/// the method; each is added if the scene asks for it. `eit-inverse`'s test `one_frame` shows the same for a
/// program.
#[test]
fn plan_of_one_frame_leaves_out_what_it_does_not_need() {
    let folder = tempfile::tempdir().unwrap();
    let row = |k: usize| (0..40).map(|i| (1 + k * i % 7).to_string()).collect::<Vec<_>>().join(",");
    std::fs::write(folder.path().join("one.csv"), row(0)).unwrap();
    std::fs::write(folder.path().join("many.csv"), [0, 1, 2, 3].map(row).join("\n")).unwrap();
    let left_out = |more: &str| {
        let scene = write_scene(folder.path(), &format!("{SMALL}\n{more}"));
        let json: Value =
            serde_json::from_str(&succeed(&["plan", text(&scene), "--json"])).unwrap();
        let list = json["left_out"].as_array().unwrap();
        let names: Vec<String> = list.iter().map(|l| l["what"].as_str().unwrap().into()).collect();
        assert!(list.iter().all(|l| !l["why"].as_str().unwrap().is_empty()), "{list:?}");
        (json["method"].as_str().unwrap().to_owned(), names)
    };
    let all = ["complex arithmetic", "time coupling", "U-net", "instrument"];
    let missing = |names: &[String]| all.map(|what| !names.iter().any(|name| name == what));
    let noise = "[noise]\nadditive_v = 1e-6\n";
    let recording = |file| format!("[recording]\nfile = \"{file}.csv\"\nreference = 0\n");
    for (scene, method) in
        [(recording("one"), "gauss-newton"), (format!("{noise}{}", recording("one")), "tv")]
    {
        let (chosen, names) = left_out(&scene);
        assert_eq!((chosen.as_str(), missing(&names)), (method, [false; 4]), "{names:?}");
    }
    let more =
        "[denoise]\nweights = \"default\"\nany_skin = true\n[instrument]\ndriver = \"emulator\"\n";
    let (chosen, names) = left_out(&format!("{noise}{}{more}", recording("many")));
    assert_eq!(
        (chosen.as_str(), missing(&names)),
        ("st-tv", [false, true, true, true]),
        "{names:?}"
    );
}

/// The whole comparison in seconds: it contains every method and every file.
#[test]
fn report_compares_every_method() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report");
    let race = ["report", "--scenes", "paper-disc-60", "--out", text(&out), "--json"];
    let json: Value = serde_json::from_str(&succeed(&race)).unwrap();
    let rows = json["scenes"][0]["solvers"].as_array().unwrap();
    for method in METHODS {
        let of = |r: &&Value| r["solver"].as_str().unwrap().trim_end_matches(" ≥ 0") == method;
        let errors: Vec<f64> =
            rows.iter().filter(of).map(|row| row["relative_error"].as_f64().unwrap()).collect();
        // an empty image has 1; measured 0.32 to 0.72
        assert!(!errors.is_empty() && errors.iter().all(|e| *e < 0.85), "{method}: {errors:?}");
    }
    let st_tv: Vec<&Value> =
        rows.iter().filter(|r| r["solver"] == "st-tv" && r["pixels"] == 32).collect();
    let gap = |row: &Value| row["proven_gap"].as_f64().unwrap();
    assert!(st_tv.len() == 2 && gap(st_tv[1]) < gap(st_tv[0]), "{st_tv:?}");
    let live = rows.iter().filter(|r| r["live"] == true).count();
    // one-step images and two streams on each of two rasters
    assert_eq!(live, 2 * 3);
    let files = ["error_paper_disc_60.png", "images_paper_disc_60_bell.png", "report.md"];
    for name in files {
        assert!(std::fs::metadata(out.join(name)).unwrap().len() > 1000, "{name}");
    }
}
