//! Every method from frames to images, on a small simulated skin.

use crate::common::*;
use eit_skin::Skin;
use fixtures::Random;
use std::sync::LazyLock;

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

/// Recorded frames of a finger.
struct Fixture {
    folder: Folder,
    frames: String,
}

/// Frames of the finger on a finer mesh than the scene's.
static FRAMES: LazyLock<Array2<f64>> = LazyLock::new(|| {
    let skin = Skin::load(Folder::new().altered("edge_m = 0.012", "edge_m = 0.008")).unwrap();
    let clean = |frame: usize| {
        voltages(&skin, |[cx, cy, _]| match frame.checked_sub(QUIET).map(finger) {
            Some([x, y]) if (cx - x).hypot(cy - y) < 0.02 => 1.5,
            _ => 1.0,
        })
    };
    let frames: Vec<Array1<f64>> = (0..QUIET + TOUCHED).map(clean).collect();
    let mut noise = Random::new(1);
    Array2::from_shape_fn((frames.len(), frames[0].len()), |(frame, i)| {
        frames[frame][i] + NOISE_V * noise.normal()
    })
});

fn fixture() -> Fixture {
    let folder = Folder::new();
    Fixture { frames: folder.write_array("frames.npy", &*FRAMES), folder }
}

impl Fixture {
    /// Images and report of a run.
    fn run(&self, scene: &str, more: &str) -> (Array3<f64>, Value) {
        let (frames, out) = (&self.frames, self.folder.path("out"));
        let report = answer(format!("reconstruct {scene} --frames {frames} --out {out} {more}"));
        for file in ["sheet.png", "movie.gif", "report.json"] {
            assert!(std::fs::metadata(format!("{out}/{file}")).unwrap().len() > 500, "{file}");
        }
        (read_array(format!("{out}/images.npy")), report)
    }

    /// The same with frames 0 to 7 as reference, for keys of the scene.
    fn run_keys(&self, keys: &str) -> (Array3<f64>, Value) {
        self.run(&self.folder.scene(keys), "--reference 0..8")
    }
}

/// Distance of two images over the size of the first.
fn apart(one: &Array3<f64>, other: &Array3<f64>) -> f64 {
    let pairs = || one.iter().zip(other).filter(|(a, _)| a.is_finite());
    let apart = pairs().map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    apart / pairs().map(|(a, _)| a * a).sum::<f64>().sqrt()
}

/// Centre of the region above half of the largest value of a frame, metres, on a raster over the disc.
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

#[test]
fn every_method_finds_the_finger() {
    let fixture = fixture();
    let keys = "[reconstruction]\npixels = 24\n[noise]\nquiet_frames = \"0..8\"\n";
    let scene = fixture.folder.scene(keys);
    for method in METHODS {
        let (images, report) = fixture.run(&scene, &format!("--method {method} --reference 0..8"));
        assert_eq!(images.dim(), (QUIET + TOUCHED, 24, 24), "{method}");
        assert_eq!(report["method"], method);
        for f in 0..TOUCHED {
            let error = distance_m(centre_m(&images, QUIET + f), finger(f));
            // half of the finger's radius of 20 mm
            assert!(error < 0.01, "{method}, frame {f}: {error}");
        }
        let status = report["status"].as_str().unwrap();
        assert!(["converged", "direct"].contains(&status), "{method}: {status}");
        if !["st-tv", "tv"].contains(&method) {
            assert!(number(&report, "hyperparameter") > 0.0, "{method}");
            continue;
        }
        // nothing in the quiet frames is taken for a touch
        assert_eq!(report["quiet_frames"], QUIET, "{method}");
        assert!(images.index_axis(Axis(0), 0).iter().all(|v| v.is_nan() || *v == 0.0));
        let number = |key: &str| number(&report, key);
        assert!((0.0..=number("target_gap")).contains(&number("gap")), "{method}");
        assert!(number("lower_bound") <= number("primal"), "{method}");
        let residual = report["residual"].as_array().unwrap();
        assert!(residual[..QUIET].iter().all(Value::is_null), "{method}");
        // a quarter of the weights of the discrepancy principle: the residual is below the noise
        for r in &residual[QUIET..] {
            let ratio = r.as_f64().unwrap() / number("residual_wanted");
            assert!((0.3..1.5).contains(&ratio), "{method}: {ratio}");
        }
        assert!(exists(fixture.folder.path("out/hyperparameter.png")), "{method}");
    }
}

/// Stated noise selects st-tv, its weights and the frames that it skips; bounds hold.
#[test]
fn the_scene_chooses() {
    let fixture = fixture();
    let noise = format!("[noise]\nadditive_v = {NOISE_V}\n");
    let keys = "[reconstruction]\npixels = 24\n";
    let (images, report) = fixture.run_keys(&format!("{keys}lower_s = 0.0\n{noise}"));
    has(&report, json!({ "method": "st-tv", "quiet_frames": QUIET }));
    assert!(images.iter().all(|v| v.is_nan() || *v >= 0.0), "the bound holds");
    assert!(report["noise"]["source"].as_str().unwrap().contains("from the scene"));
    assert_eq!(fixture.run_keys(keys).1["method"], "gauss-newton");
    // the paper's form: every frame within its noise
    let (images, report) = fixture.run_keys(&format!("{keys}delta = \"noise\"\n{noise}"));
    let delta = number(&report["weights"], "delta");
    // the noise includes the model error, the stated delta refers to the noise alone, as numbers in scenes do
    let raised = number(&report["noise"], "model_error_factor");
    assert!(((delta / raised).powi(2) - 40.0).abs() < 1e-9, "40 measurements: {delta}, {raised}");
    let again = fixture.run_keys(&format!("{keys}delta = {delta:e}\n{noise}")).0;
    // both within 1e-2 of one optimum
    assert!(apart(&images, &again) <= 0.1, "{}: {report}", apart(&images, &again));
    // and its equation (7): sums over pixels of differences in space and in time have equal weights
    let (_, report) = fixture.run_keys(&format!("{keys}delta = \"paper\"\n{noise}"));
    let weights = &report["weights"];
    let weight = |name: &str| number(weights, name);
    // the disc of 0.1 m has 24 pixels across; 1e-3: its outline is a polygon
    let pixel_m = weight("lambda_space") / weight("lambda_time");
    assert!((pixel_m / (0.2 / 24.0) - 1.0).abs() < 1e-3, "{pixel_m}");
    assert_eq!(weight("delta"), delta);
    assert!(weights["rule"].as_str().unwrap().contains("equation (7)"), "{weights}");
    // weights of a report, stated in the scene, give its images, with noise known (raised by the model error) and unknown
    for noise in [noise.as_str(), ""] {
        let keys = format!("{keys}method = \"st-tv\"\ntarget_gap = 1e-4\n");
        let (images, report) = fixture.run_keys(&format!("{keys}{noise}"));
        let weight = |name| number(&report["weights"], name);
        let [space, time] = ["lambda_space", "lambda_time"].map(weight);
        let stated = format!("{keys}lambda_space = {space:e}\nlambda_time = {time:e}\n{noise}");
        let again = fixture.run_keys(&stated).0;
        // both within 1e-4 of one optimum, which determines the images to a few percent
        assert!(apart(&images, &again) <= 0.05, "{}: {report}", apart(&images, &again));
    }
    let report = fixture.run_keys(&format!("{keys}lambda_space = 1.0\n")).1;
    has(&report["weights"], json!({ "lambda_space": 1.0, "rule": "fixed by the scene" }));
    // a gap that cannot be reached in a millisecond: the best image so far, with its certificate
    let keys = "pixels = 64\nlambda_space = 1e7\ntarget_gap = 1e-12\ndeadline_s = 1e-3\n";
    let (images, report) = fixture.run_keys(&format!("[reconstruction]\n{keys}"));
    assert_eq!(report["status"], "deadline", "{report}");
    assert!(number(&report, "gap") > 1e-12);
    assert!(images.iter().any(|v| v.is_finite()));
    // a limit beyond what a clock can count is ignored
    let keys = format!("[reconstruction]\npixels = 16\ndeadline_s = 1e300\n{noise}");
    assert_eq!(fixture.run_keys(&keys).1["status"], "converged");
    // without known noise the weights come from the model error, and the user is told
    let scene = fixture.folder.scene("[reconstruction]\npixels = 24\nmethod = \"st-tv\"\n");
    let (images, report) = fixture.run(&scene, "--reference 0");
    assert!(report["notes"].to_string().contains("additive_v"), "{}", report["notes"]);
    assert_eq!(report["quiet_frames"], 0, "without noise no frame is quiet");
    let error = distance_m(centre_m(&images, QUIET + 1), finger(1));
    assert!(error < 0.01, "{error}");
}

/// One frame is plain total variation, equal frames are one, and quiet frames are none.
#[test]
fn what_a_recording_does_not_need_is_left_out() {
    let fixture = fixture();
    let folder = &fixture.folder;
    let frames = &*FRAMES;
    let select = |rows: &[usize]| frames.select(Axis(0), rows);
    folder.write_array("reference.npy", &select(&[0, 1, 2, 3, 4, 5]));
    let noise = format!("[reconstruction]\npixels = 16\n[noise]\nadditive_v = {NOISE_V}\n");
    let scene = folder.scene(&format!("{noise}[recording]\nreference = \"reference.npy\"\n"));
    let out = folder.path("part");
    let run = |name: &str, frames: Array2<f64>| {
        let file = folder.write_array(name, &frames);
        answer(format!("reconstruct {scene} --frames {file} --out {out}"))
    };
    let one = run("part.npy", select(&[QUIET]));
    assert_eq!(one["method"], "tv", "{one}");
    assert_eq!(one["weights"]["lambda_time"], 0.0);
    let nothing = run("part.npy", select(&[6, 7]));
    has(&nothing, json!({ "quiet_frames": 2, "status": "nothing to solve" }));
    // the same touch with other noise: moving frames are not equal
    assert_eq!(run("part.npy", select(&[8, 9, 10, 11]))["still"], false);
    let mut noisy = Random::new(11);
    let alike = Array2::from_shape_fn((5, frames.ncols()), |(_, i)| {
        frames[[QUIET, i]] + NOISE_V * noisy.normal()
    });
    let still = run("alike.npy", alike);
    has(&still, json!({ "still": true, "method": "st-tv" }));
    assert_eq!(still["weights"]["lambda_time"], 0.0, "one image has nothing to couple");
    let images: Array3<f64> = read_array(format!("{out}/images.npy"));
    let bits = |f: usize| images.index_axis(Axis(0), f).mapv(f64::to_bits);
    assert!((1..5).all(|f| bits(f) == bits(0)), "one image serves all");
    // the plan reads the recording and agrees
    let still = "time term: dropped, the 5 frames…a static scene: one image…mean of 5 frames";
    for (file, words) in [("alike.npy", still), ("frames.npy", "time term: couples 12 frames")] {
        let recording = format!("[recording]\nfile = \"{file}\"\nreference = \"reference.npy\"\n");
        let plan = succeed(format!("plan {}", folder.scene(&format!("{noise}{recording}"))));
        says(&plan, words);
    }
}

/// Residuals of the element-based methods are in units of the noise of a difference, including the gain of
/// the recording against the model and the noise of the reference.
#[test]
fn residuals_are_in_units_of_the_noise() {
    let mut fixture = fixture();
    let run = |fixture: &Fixture, noise_v: f64| {
        let keys = "[reconstruction]\npixels = 16\nmethod = \"time-prior\"\n";
        fixture.run_keys(&format!("{keys}[noise]\nadditive_v = {noise_v:e}\n")).1
    };
    let one = run(&fixture, NOISE_V);
    // a recording in another unit: everything, noise included, is ten times as large
    fixture.frames = fixture.folder.write_array("ten.npy", &(10.0 * &*FRAMES));
    let ten = run(&fixture, 10.0 * NOISE_V);
    let residual = |report: &Value, frame: usize| report["residual"][frame].as_f64().unwrap();
    for frame in 0..QUIET + TOUCHED {
        let ratio = residual(&ten, frame) / residual(&one, frame);
        // rounding of 10 v
        assert!((ratio - 1.0).abs() < 1e-6, "frame {frame}: {ratio}");
    }
    // a quiet frame only contains noise, of which the image follows some degrees of freedom; those just
    // before the finger contain some of its image, due to the prior in time
    let wanted = number(&one, "residual_wanted");
    for frame in 0..QUIET - 4 {
        let ratio = residual(&one, frame) / wanted;
        // 40 measurements, up to 20 of them followed: the square root of a half, and a spread of a ninth
        assert!((0.4..1.4).contains(&ratio), "frame {frame}: {ratio}");
    }
}

/// Independently of the image method, and only if the noise is known.
#[test]
fn touches_are_written_where_the_noise_is_known() {
    let fixture = fixture();
    let (folder, list) = (&fixture.folder, fixture.folder.path("out/touches.csv"));
    // the object is a disc of 20 mm: with a bell of 7 mm it would appear as two touches
    let keys = "[noise]\nadditive_v = 1e-4\n[touch]\nradius_m = 0.02\n";
    let known = folder.scene(&format!("[reconstruction]\npixels = 24\n{keys}"));
    for method in ["st-tv", "gauss-newton"] {
        let (_, report) = fixture.run(&known, &format!("--method {method} --reference 0..8"));
        let counts = ["count", "most_at_once", "frames_with_touch"]
            .map(|name| number(&report["touches"], name));
        assert_eq!(counts, [1.0, 1.0, TOUCHED as f64], "{report}");
        let csv = read_text(&list);
        let header = "frame,time_s,id,state,x_m,y_m,z_m,std_x_m,std_y_m,std_z_m,nx,ny,nz,vx_m_s,vy_m_s,\
                      vz_m_s,intensity_s_m2,intensity_std_s_m2,confidence,valid,whole,age_s,force_n,\
                      force_std_n,unlike,split_from,merged_into,skin";
        assert_eq!(csv.lines().next(), Some(header));
        let rows = rows(&list);
        // a touch this strong is accepted at once
        assert_eq!((rows.len(), &*rows[0]["frame"], &*rows[0]["state"]), (TOUCHED, "8", "begin"));
        for row in &rows {
            let [frame, x, y, confidence] =
                ["frame", "x_m", "y_m", "confidence"].map(|name| row[name].parse().unwrap());
            // half of the finger's radius of 20 mm
            let error_m = distance_m([x, y], finger(frame as usize - QUIET));
            assert!(error_m < 0.01 && confidence > 0.6, "{method}: {row:?}");
            let state = ["id", "skin", "valid", "whole"].map(|name| &*row[name]);
            assert_eq!(state, ["1", "sound", "true", "true"], "{row:?}");
        }
    }
    // frames and time are counted from the beginning of the file, whichever is the first that is searched
    let later = format!("{keys}[recording]\nfirst_frame = 8\nframe_rate_hz = 20.0\n");
    fixture.run(&folder.scene(&later), "--method gauss-newton --reference 0..8");
    assert!(read_text(&list).lines().nth(1).unwrap().starts_with("8,0.400000,1,begin,"));
    // without noise no list, and none is left from the earlier run
    let unknown = folder.scene("[reconstruction]\npixels = 24\n");
    let (_, report) = fixture.run(&unknown, "--method gauss-newton --reference 0");
    assert!(report["touches"].is_null() && !exists(&list));
}

/// Methods are listed.
#[test]
fn what_a_recording_cannot_be_asked_for_is_refused() {
    let fixture = fixture();
    let (folder, frames, out) = (&fixture.folder, &fixture.frames, fixture.folder.path("none"));
    let refused = |keys: &str, more: &str, wanted: &str| {
        let line = format!("reconstruct {} --frames {frames} --out {out}", folder.scene(keys));
        refuse_each([(format!("{line} {more}"), wanted)]);
    };
    METHODS.iter().for_each(|name| refused("", "--method st-tw", &format!("\"{name}\"")));
    assert!(!exists(&out), "refused before anything is made");
    // quiet frames beyond the recording
    let beyond = "quiet_frames…0 to 11";
    refused("[noise]\nquiet_frames = \"0..100\"\n", "--reference 0", beyond);
    // the first eight frames are quiet and not solved: the first one solved is number 8
    let keys = "[reconstruction]\ndelta = 0.0\n[noise]\nadditive_v = 1e-4\n";
    refused(keys, "--reference 0..8", &format!("frame {QUIET}: delta is 0"));
    for (key, name) in [
        ("max_touches = 0", "max_touches"),
        ("least_strength_m2 = -1.0", "touch.least_strength_m2"),
        ("birth_frames = 0", "birth_frames"),
        // of earlier versions
        ("birth_hits = 2", "birth_frames"),
        ("max_touch = 1", "max_touches"),
    ] {
        refused(&format!("[noise]\nadditive_v = 1e-4\n[touch]\n{key}\n"), "", name);
    }
}

#[test]
fn plan_tells_the_method_and_why() {
    let folder = Folder::new();
    // the recording is read for its size
    folder.write("one.csv", vec!["1"; 40].join(","));
    let noise = "[noise]\nadditive_v = 1e-6\n";
    let stated = "method st-tv: the scene states its noise…static scene…single one (plain total variation)…\
                  discrepancy principle…iterations to gap 1e-2…iterations as on paper-disc-60…\
                  Gflop/s effective…20 frames assumed…rank 20 at most";
    let one = format!("{noise}[recording]\nfile = \"one.csv\"\nreference = 0\n");
    let of_one = "method tv: one frame…time term: dropped, one frame is plain total variation…pixels, one frame";
    for (keys, wanted) in [
        ("", "method gauss-newton…states no noise"),
        (noise, stated),
        (&one, of_one),
        // without a weight in time nothing is coupled, whatever the frames
        (&format!("{noise}[reconstruction]\nlambda_time = 0.0\n"), "time term: none"),
    ] {
        let output = succeed(format!("plan {}", folder.scene(keys)));
        says(&output, wanted);
        assert!(!keys.contains("lambda_time") || !output.contains("couples"), "{output}");
    }
    let scene = folder.scene("");
    for method in METHODS {
        let output = succeed(format!("plan {scene} --method {method}"));
        assert!(output.contains(&format!("method {method}: requested")), "{output}");
    }
}

/// Whatever the method; each part is added if the scene asks for it.
#[test]
fn plan_of_one_frame_leaves_out_what_it_does_not_need() {
    let folder = Folder::new();
    let frames = |count| Array2::from_shape_fn((count, 40), |(k, i)| (1 + k * i % 7) as f64);
    folder.write("one.csv", table(&frames(1)));
    folder.write("many.csv", table(&frames(4)));
    let noise = "[noise]\nadditive_v = 1e-6\n";
    let recording = |file| format!("[recording]\nfile = \"{file}.csv\"\nreference = 0\n");
    let more =
        "[denoise]\nweights = \"default\"\nany_skin = true\n[instrument]\ndriver = \"emulator\"\n";
    for (keys, method, is_kept) in [
        (recording("one"), "gauss-newton", [false; 4]),
        (format!("{noise}{}", recording("one")), "tv", [false; 4]),
        (format!("{noise}{}{more}", recording("many")), "st-tv", [false, true, true, true]),
    ] {
        let json = answer(format!("plan {}", folder.scene(&keys)));
        let [left_out, why] = ["what", "why"].map(|name| texts(&json["left_out"], name));
        assert!(!why.contains(&""), "{left_out:?} {why:?}");
        let parts = ["complex arithmetic", "time coupling", "U-net", "instrument"];
        let kept = parts.map(|what| !left_out.contains(&what));
        assert_eq!((&json["method"], kept), (&method.into(), is_kept), "{left_out:?}");
    }
}

/// The whole comparison in seconds: it contains every method and every file.
#[test]
fn report_compares_every_method() {
    let (_folder, [out]) = Folder::with_paths(["report"]);
    let json = answer(format!("report --images --scenes paper-disc-60 --out {out}"));
    let rows = json["scenes"][0]["solvers"].as_array().unwrap();
    for method in METHODS {
        let of = |r: &&Value| r["solver"].as_str().unwrap().trim_end_matches(" ≥ 0") == method;
        let errors: Vec<f64> =
            rows.iter().filter(of).map(|row| number(row, "relative_error")).collect();
        // an empty image has 1; measured 0.32 to 0.72
        assert!(!errors.is_empty() && errors.iter().all(|e| *e < 0.85), "{method}: {errors:?}");
    }
    let st_tv = rows.iter().filter(|r| r["solver"] == "st-tv" && r["pixels"] == 32);
    let gaps: Vec<f64> = st_tv.map(|row| number(row, "proven_gap")).collect();
    assert!(gaps.len() == 2 && gaps[1] < gaps[0], "{gaps:?}");
    // one-step images and two streams on each of two rasters
    assert_eq!(rows.iter().filter(|r| r["live"] == true).count(), 2 * 3);
    // images alone: every solver in the table that plans read, and no forward problem
    has(&json, json!({ "forward": [] }));
    assert!(!exists(format!("{out}/forward.csv")));
    assert!(!read_text(format!("{out}/report.md")).contains("\n## Forward problem\n"));
    let table = read_text(format!("{out}/inverse.csv"));
    for method in METHODS {
        // alone or with the bound of images that do not fall below zero
        let rows = ["", " ≥ 0"].map(|bound| format!("paper-disc-60,{method}{bound},"));
        let is_row = |line: &str| rows.iter().any(|row| line.starts_with(row));
        assert!(table.lines().any(is_row), "{method}: {table}");
    }
    for name in ["error_paper_disc_60.png", "images_paper_disc_60_bell.png", "report.md"] {
        assert!(std::fs::metadata(format!("{out}/{name}")).unwrap().len() > 1000, "{name}");
    }
}
