//! `eit learn`: from a table of presses on a simulated fabric to newtons in `touches.csv`.

use crate::common::*;

const RATE_HZ: f64 = 20.0;
const QUIET: usize = 40;
/// First frame of a press, and frames between presses: 4 rising, 14 steady, 4 falling.
const FIRST: usize = 42;
const EACH: usize = 32;
const PRESSES: usize = 13;

/// Position and force of a press, anywhere within 0.75 of the radius.
fn press(k: usize) -> ([f64; 2], f64) {
    let (sin, cos) = (2.4 * k as f64).sin_cos();
    let radius = 0.075 * ((k as f64 + 0.5) / PRESSES as f64).sqrt();
    ([radius * cos, radius * sin], 0.3 * 8.0_f64.powf((5 * k % PRESSES) as f64 / PRESSES as f64))
}

/// A simulated recording in a folder, and the table of its presses except the last.
fn recorded(folder: &Folder) -> (String, String) {
    let frames = FIRST + PRESSES * EACH;
    let head = format!("frame_rate_hz = {RATE_HZ:?}\nframes = {frames}\nquiet_frames = {QUIET}");
    let mut script = format!("{head}\n[[finger]]\nid = 1\n");
    let mut table = "x_m,y_m,force_n,first_frame,last_frame,before_first,before_last\n".to_owned();
    for k in 0..PRESSES {
        let ([x, y], force) = press(k);
        let begin = FIRST + k * EACH;
        for (after, part) in [(0.0, 0.0), (0.2, 1.0), (0.9, 1.0), (1.1, 0.0)] {
            let (time_s, force_n) = (begin as f64 / RATE_HZ + after, part * force);
            script += &format!("[[finger.key]]\ntime_s = {time_s:?}\nforce_n = {force_n:?}\n");
            script += &format!("position_m = [{x:?}, {y:?}]\nradius_m = 0.01\n");
        }
        if k + 1 < PRESSES {
            let [a, b, c, d] = [begin + 11, begin + 16, begin - 4, begin - 1];
            table += &format!("{x},{y},{force},{a},{b},{c},{d}\n");
        }
    }
    let (script, out) = (folder.write("s.toml", script), folder.path("touched"));
    succeed(format!("simulate paper-disc --script {script} --nodes 2500 --out {out}"));
    (format!("{out}/scene.toml"), folder.write("presses.csv", table))
}

#[test]
fn presses_become_newtons() {
    let folder = Folder::new();
    let (scene, table) = recorded(&folder);
    let [learned, out] = folder.paths(["skin.learned", "images"]);
    let [curve, picture] = folder.paths(["skin.curve.csv", "skin.curve.png"]);
    let json = answer(format!("learn {scene} --presses {table} --out {learned}"));
    // the model is correct on a simulated skin: learning must not make positions worse
    has(&json, json!({ "presses": PRESSES - 1, "places_by": "model", "curve": curve }));
    assert_eq!(json["learning_curve"][0]["learnt"], 5, "{json}");
    assert!(exists(&picture) && exists(&curve));
    // places that belong to other presses teach nothing
    let text = read_text(&table);
    let (head, lines) = text.split_once('\n').unwrap();
    let lines: Vec<Vec<&str>> = lines.lines().map(|line| line.splitn(3, ',').collect()).collect();
    let others = lines.iter().cycle().skip(lines.len() / 2);
    let wrong = lines.iter().zip(others).map(|(l, o)| format!("{},{},{}\n", o[0], o[1], l[2]));
    let wrong = folder.write("wrong.csv", format!("{head}\n{}", wrong.collect::<String>()));
    let line = format!("learn {scene} --presses {wrong} --out {}", folder.path("w.learned"));
    refuse_each([(line, "nothing is learnt from these")]);
    // the scene that names it
    let content = read_text(&scene);
    assert!(!content.contains("[touch]"));
    let named = format!("{content}\n[touch]\nlearned = {learned:?}\n");
    let scene = folder.write("touched/named.toml", &named);
    succeed(format!("reconstruct {scene} --method gauss-newton --out {out}"));
    let last = FIRST + (PRESSES - 1) * EACH;
    let ([x, y], force) = press(PRESSES - 1);
    let mut held = 0;
    for row in rows(format!("{out}/touches.csv")) {
        let value = |name: &str| row[name].parse::<f64>().unwrap();
        if (last + 11..last + 17).contains(&(value("frame") as usize)) {
            held += 1;
            assert!((value("x_m") - x).hypot(value("y_m") - y) < 5e-3, "{row:?}");
            // a press that was not learnt: 10 % in 85 % of them, at most 26 % (docs/validation/learning.md)
            assert!((value("force_n") / force - 1.0).abs() < 0.26, "{row:?}: {force} N");
            assert!(value("force_std_n") > 0.0 && row["unlike"] == "false", "{row:?}");
        }
    }
    assert_eq!(held, 6);
    // every force is spread over the image of its touch
    let images: Array3<f64> = read_array(format!("{out}/pressure.npy"));
    let pressures = read_text(format!("{out}/pressure.csv"));
    let side_m = 0.2 / images.dim().1 as f64;
    for line in pressures.lines().skip(1) {
        // no net has restored the width of the contact: the pressure is a lower bound without an error
        let values = line.strip_suffix(',').unwrap().split(',');
        let values: Vec<f64> = values.map(|v| v.parse().unwrap()).collect();
        let [frame, force_n, area_m2, mean_pa] = [0, 3, 5, 6].map(|k| values[k]);
        let image = images.index_axis(Axis(0), frame as usize);
        let sum_n: f64 = image.iter().filter(|pa| pa.is_finite()).sum::<f64>() * side_m.powi(2);
        // a pixel at the rim is covered in part
        assert!((sum_n / force_n - 1.0).abs() < 0.15, "{line}: {sum_n} N");
        assert!((mean_pa * area_m2 / force_n - 1.0).abs() < 1e-3, "{line}");
    }
    // 13 presses of 14 steady frames and some more
    assert!(pressures.lines().count() > 13 * 14, "{pressures}");
    assert!(exists(format!("{out}/pressure.gif")));
    let report = parse(&read_text(format!("{out}/report.json")));
    assert!(number(&report["pressure"], "median_pa") > 0.0, "{report}");
    // rejected for another skin, and if damaged
    let frames = folder.path("touched/frames.npy");
    let reconstruct = |scene: &str| format!("reconstruct {scene} --frames {frames} --out {out}");
    for (key, other, words) in [
        ("radius_m = 0.1\n", "radius_m = 0.11\n", "learnt on another skin"),
        ("\"counterclockwise\"", "\"clockwise\"", "learnt on another skin"),
        ("first_angle_deg = 90.0", "first_angle_deg = 67.5", "learnt on another skin"),
        // another drive has another number of measurements than the frames
        ("drive = \"adjacent\"", "drive = \"opposite\"", "192"),
    ] {
        assert!(named.contains(key), "{named}");
        let elsewhere = folder.write("elsewhere.toml", named.replace(key, other));
        refuse_each([(reconstruct(&elsewhere), words)]);
    }
    let bytes = read_text(&learned);
    for (content, wanted) in [
        (bytes.replacen("\"sign\":1.0", "\"sign\":-1.0", 1), "damaged: its checksum is"),
        (bytes.replacen("\"version\":2", "\"version\":7", 1), "version 7 of the format"),
        ("x_m,y_m\n".into(), "not a file of `eit learn`"),
    ] {
        std::fs::write(&learned, content).unwrap();
        refuse_each([(reconstruct(&scene), wanted)]);
    }
}

#[test]
fn bad_tables_are_one_line() {
    let folder = Folder::new();
    let frames = folder.write("f.csv", table(&Array2::ones((6, 208))));
    for (content, out, wanted) in [
        ("x_m\n0.0\n", "f.learned", "y_m"),
        ("x_m,y_m,colour\n0,0,1\n", "f.learned", "colour"),
        ("x_m,y_m\n", "f.learned", "no press"),
        ("x_m,y_m\n0,NaN\n", "f.learned", "line 2: y_m is NaN"),
        ("x_m,y_m,force_n\n0,0,1\n0,0,-2\n", "f.learned", "line 3: force_n is -2"),
        ("x_m,y_m,first_frame,last_frame\n0,0,5,3\n", "f.learned", "line 2: last_frame is 3"),
        ("x_m,y_m\n0,0\n", "f.learned", "1 presses"),
        ("x_m,y_m,first_frame\n0,0,9\n", "f.learned", "frames 0 to 5"),
        ("x_m,y_m,first_frame\n0,0,0\n\n0,0,9\n", "f.learned", "line 4, frame 9"),
        ("x_m,y_m\n0,0\n", "f.toml", "must end in .learned"),
    ] {
        let (table, out) = (folder.write("p.csv", content), folder.path(out));
        let data = format!("--presses {table} --frames {frames} --reference 0");
        refuse_each([(format!("learn paper-disc {data} --out {out}"), wanted)]);
    }
}

/// No input is overwritten, whatever its name, and nothing is left behind after a rejection.
#[test]
fn inputs_are_not_written_over() {
    let folder = Folder::new();
    for name in ["presses.csv", "a.curve.csv", "b.learned", "frames.csv"] {
        folder.write(name, "x_m,y_m\n0,0\n");
    }
    let contents = || folder.names().iter().map(|name| read(folder.path(name))).collect::<Vec<_>>();
    let before = (folder.names(), contents());
    let with = format!("--with {}", folder.path("b.learned"));
    let reference = format!("--reference {}", folder.path("a.curve.csv"));
    for (presses, frames, out, more, wanted) in [
        ("a.curve.csv", "frames.csv", "a.learned", "", "a.curve.csv: …overwrite the presses"),
        ("presses.csv", "a.curve.csv", "a.learned", "", "overwrite the frames"),
        ("presses.csv", "frames.csv", "b.learned", &with, "overwrite the earlier file"),
        ("presses.csv", "frames.csv", "a.learned", &reference, "overwrite the reference"),
        // the curve of presses.learned is not presses.csv: the run stops at the frames
        ("presses.csv", "frames.csv", "presses.learned", "", "2 values per frame"),
    ] {
        let [presses, frames, out] = folder.paths([presses, frames, out]);
        let data = format!("--presses {presses} --frames {frames} --out {out}");
        refuse_each([(format!("learn paper-disc {data} {more}"), wanted)]);
    }
    assert_eq!((folder.names(), contents()), before);
}
