//! `eit learn --live` with an emulated board and a finger that presses where it is asked to. The voltages come from another
//! mesh than the command's, solved with the press in it (no linearisation), in converter steps.
#![cfg(unix)]

use crate::common::emulated::{Board, converse, signal};
use crate::common::*;
use eit_skin::scene::Scene;
use eit_skin::{Progress, Skin};
use std::io::Write as _;
use std::sync::{Arc, LazyLock};

/// Volts of a step of the converter.
const STEP_V: f64 = 1e-5;

fn scene(folder: &Folder, port: &str) -> String {
    let sixteen = altered("count = 8\nwidth_m = 0.02", "count = 16\nwidth_m = 0.0196");
    let instrument = format!("[instrument]\ndriver = \"csv\"\nport = \"{port}\"\n");
    let more = format!("{instrument}[recording]\nscale = {STEP_V}\n");
    folder.write("skin.toml", sixteen.replace("0.012", "0.009") + &more)
}

/// The true skin, on a finer mesh.
static TRUTH: LazyLock<Skin> = LazyLock::new(|| {
    let scene = Scene::load(&scene(&Folder::new(), "unused")).unwrap();
    Skin::from_scene(scene).unwrap().with_nodes(3000, &mut Progress::silent()).unwrap()
});

/// Frame of the true skin in converter steps, pressed by a finger of 12 mm with a force, whose effect is its power of 0.8.
fn frame(press: Option<([f64; 2], f64)>) -> Vec<f64> {
    let ([x, y], force_n) = press.unwrap_or_default();
    let voltages_v = voltages(&TRUTH, |[cx, cy, _]| {
        let square = (cx - x).powi(2) + (cy - y).powi(2);
        1.0 + 0.5 * force_n.powf(0.8) * (-square / 0.012_f64.powi(2)).exp()
    });
    (voltages_v / STEP_V).to_vec()
}

/// A board, and the folder with its scene.
struct Bench {
    folder: Folder,
    board: Board,
    scene: String,
}

impl Bench {
    fn new() -> Self {
        let (folder, board) = (Folder::new(), Board::start(60.0, frame(None)));
        let scene = scene(&folder, &board.port);
        Self { folder, board, scene }
    }

    /// Presses where the command asks, each with a force; returns answer, exit code and all that it said. A press that is
    /// refused is released. `at` is called at each press.
    fn teach(
        &self,
        options: &str,
        force_n: impl Fn(usize) -> f64,
        mut at: impl FnMut(usize, &Child),
    ) -> (Option<Value>, i32, String) {
        let (scene, out) = (&self.scene, self.folder.path("skin.learned"));
        let line = format!("--json learn {scene} --live --out {out} --hold-s 0.15 {options}");
        let mut number = 0;
        let (answer, code, said) = converse(line, |line, child, _| {
            if let Some(rest) = line.strip_prefix("press ") {
                number = rest.split(' ').next().unwrap().parse::<usize>().unwrap() - 1;
                self.board.show(frame(Some((place_of(line), force_n(number)))));
                at(number, child);
            } else if line.starts_with("detected") || line.starts_with("this press cannot be used")
            {
                self.board.show(frame(None));
            }
        });
        self.board.show(frame(None));
        (serde_json::from_str(&answer).ok(), code, said)
    }

    fn lines_of_the_table(&self) -> usize {
        read_text(self.folder.path("skin.presses.csv")).lines().count()
    }
}

/// "press 3 of 12 with 1 N at (20.0, -31.0) mm: ..." to metres.
fn place_of(line: &str) -> [f64; 2] {
    let inner = line.split('(').nth(1).unwrap().split(')').next().unwrap();
    let (x, y) = inner.split_once(", ").unwrap();
    [x, y].map(|mm| mm.parse::<f64>().unwrap() / 1e3)
}

/// With two known weights: positions and forces are learnt, the error is shown, and the stored files teach the same.
#[test]
fn twelve_presses_interrupted_and_continued() {
    let bench = Bench::new();
    let weights = "--number 12 --force-n 0.5,2";
    let force = |k: usize| [0.5, 2.0][k % 2];
    let (learnt, code, said) = bench.teach(weights, force, |k, child| {
        if k == 7 {
            signal(child, "-INT");
        }
    });
    assert_eq!(code, 0, "{said}");
    let first = number(&learnt.unwrap(), "presses") as usize;
    assert!(first == 7 || first == 8, "{said}");
    assert!(said.contains("5 presses: error of held-out presses "), "{said}");
    let [table, recording] = bench.folder.paths(["skin.presses.csv", "skin.presses.mcap"]);
    assert_eq!(bench.lines_of_the_table(), first + 1);
    // without --append nothing is overwritten
    let (_, code, said) = bench.teach(weights, force, |_, _| {});
    assert!(code == 2 && said.contains("--append"), "{code}: {said}");
    // a line and a frame that a killed program left incomplete
    let incomplete: [(&str, &[u8]); 2] =
        [(&table, b"0.01,0.0"), (&recording, &[6, 200, 1, 0, 0, 0, 0, 0, 0, 1, 2, 3])];
    for (file, more) in incomplete {
        std::fs::write(file, [&read(file)[..], more].concat()).unwrap();
    }
    let (learnt, code, said) = bench.teach(&format!("{weights} --append"), force, |_, _| {});
    assert_eq!(code, 0, "{said}");
    let next = format!("press {} of 12", first + 1);
    says(&said, format!("incomplete last line…incomplete record…{next}"));
    assert!(!said.contains("press 1 of"), "{said}");
    let learnt = learnt.unwrap();
    assert_eq!(learnt["presses"], 12);
    let error_m = |answer: &Value| number(&answer["held_out"]["presses"], "median_m");
    assert!(error_m(&learnt) < 5e-3, "{learnt}");
    assert!(number(&learnt["force"], "relative_error") < 0.15, "{learnt}");
    // the stored table and recording teach the same
    let (scene, again) = (&bench.scene, bench.folder.path("again.learned"));
    let files = format!("--presses {table} --frames {recording}");
    let offline = answer(format!("learn {scene} {files} --reference 0..40 --out {again}"));
    assert_eq!(offline["presses"], 12);
    let [one, other] = [&learnt, &offline].map(error_m);
    assert!((one - other).abs() < 1e-6, "{one} {other}");
}

/// Both with what to do; a press with missing values is asked for again once it is released.
#[test]
fn a_touch_that_is_never_held_and_a_refused_press_are_named() {
    let bench = Bench::new();
    let (mut is_asked, mut spoilt) = (false, 0);
    let at = |k: usize, _: &Child| {
        if k == 0 && !std::mem::replace(&mut is_asked, true) {
            // far above the noise of the untouched skin, and never the same
            bench.board.show(frame(None));
            *bench.board.noise.lock().unwrap() = 2000.0;
            let noise = Arc::clone(&bench.board.noise);
            std::thread::spawn(move || {
                std::thread::sleep(Duration::from_secs(13));
                *noise.lock().unwrap() = 1.0;
            });
        } else if k == 2 && spoilt < 2 {
            spoilt += 1;
            bench.board.frame.lock().unwrap()[7] = f64::NAN;
        }
    };
    let (_, code, said) = bench.teach("--number 4 --all", |_| 1.0, at);
    assert!(code == 0 || code == 1, "{code}: {said}");
    says(&said, "the touch has changed for 10 s: hold it still, or release it");
    let count = |words: &str| said.lines().filter(|line| line.starts_with(words)).count();
    // the first one again after the touch was named
    let words = ["press 1 of 4", "this press cannot be used", "press 3 of 4", "press 4 of 4"];
    assert_eq!(words.map(count), [2, 2, 3, 1], "{said}");
    // the refused ones are not among those that are stored
    assert_eq!(bench.lines_of_the_table(), 5, "{said}");
}

/// Ctrl-C while one is to be typed keeps the press without its force; too few presses are kept but not learnt.
#[test]
fn forces_that_are_typed() {
    let bench = Bench::new();
    let out = bench.folder.path("skin.learned");
    let line = format!("learn {} --live --out {out} --hold-s 0.15 --number 6", bench.scene);
    let mut typed = 0;
    let (answer, code, said) = converse(format!("{line} --ask-force"), |line, child, input| {
        if line.starts_with("press ") {
            bench.board.show(frame(Some((place_of(line), 0.4 + 0.5 * typed as f64))));
        } else if line.starts_with("detected") {
            bench.board.show(frame(None));
        } else if line.starts_with("force of this press") && typed == 2 {
            signal(child, "-INT");
        } else if line.starts_with("force of this press") {
            writeln!(input, "{}", 0.4 + 0.5 * typed as f64).unwrap();
            typed += 1;
        }
    });
    assert!(code == 1 && said.contains("continue with --append"), "{code}: {said}");
    assert!(answer.is_empty() && !exists(out), "{answer}");
    assert!(said.contains("interrupted: "), "{said}");
    let table = rows(bench.folder.path("skin.presses.csv"));
    let forces: Vec<&str> = table.iter().map(|row| &*row["force_n"]).collect();
    assert_eq!(forces, ["0.4", "0.9", ""], "{table:?}");
}

/// Flags that belong together, and numbers out of range.
#[test]
fn wrong_arguments() {
    let cases = [
        ("", "--presses"),
        ("--live --frames f.mcap", "--frames"),
        ("--presses p.csv --force-n 1", "--live"),
        ("--live --number 3", "--number 3"),
        ("--live --force-n 0", "force_n is 0"),
        ("--live --hold-s 1000", "hold_s is 1000"),
        ("--live", "instrument"),
    ];
    let line = |options: &str| format!("learn paper-disc --out x.learned {options}");
    refuse_each(cases.map(|(options, words)| (line(options), words)));
}
