//! `eit learn --live` as its user sees it: an emulated board, a finger that presses where it is asked to, Ctrl-C, a
//! broken line, and files from which everything can be learnt again. The board's voltages come from another mesh
//! than the command's, solved with the press in it (no linearisation), in steps of a converter.
#![cfg(unix)]
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "tests"
)]

use crate::common::{eit, text};
use eit_fem::fabric::Random;
use eit_hw::emulator::{Device, Emulator, FaultPlan, Listen};
use eit_skin::scene::Scene;
use eit_skin::{Progress, Skin};
use serde_json::Value;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, LazyLock, Mutex};
use std::time::{Duration, Instant};

/// Frame rate, hertz.
const RATE_HZ: f64 = 60.0;
/// Radius of the finger, metres.
const RADIUS_M: f64 = 0.012;
/// Longest time that a session with the command may take: it takes 20 s on an idle computer.
const LIMIT: Duration = Duration::from_secs(240);
/// Volts of a step of the converter.
const STEP_V: f64 = 1e-5;

const SCENE: &str = r#"
[skin]
shape = "disc"
radius_m = 0.1
conductivity_s = 1e-5
[electrodes]
count = 16
width_m = 0.0196
contact_impedance_ohm_m = 1e3
[protocol]
drive = "adjacent"
measure = "adjacent"
current_a = 1e-4
[mesh]
edge_m = 0.009
[recording]
scale = 1e-5
[instrument]
driver = "csv"
port = "PORT"
"#;

/// The true skin, on a finer mesh.
static TRUTH: LazyLock<Skin> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("truth.toml");
    std::fs::write(&file, SCENE).unwrap();
    let skin = Skin::from_scene(Scene::load(text(&file)).unwrap()).unwrap();
    skin.with_nodes(3000, &mut Progress::silent()).unwrap()
});

/// Frame of the true skin in converter steps, pressed with a force; more force has a larger effect, by a power of
/// 1.25.
fn frame(press: Option<([f64; 2], f64)>) -> Vec<f64> {
    let skin = &*TRUTH;
    let mut conductivity_s = skin.background_s();
    for (value, [cx, cy, _]) in conductivity_s.iter_mut().zip(skin.mesh.surface().centroids()) {
        if let Some(([x, y], force_n)) = press {
            let square = (cx - x).powi(2) + (cy - y).powi(2);
            let strength = 0.5 * force_n.powf(0.8);
            *value *= 1.0 + strength * (-square / RADIUS_M.powi(2)).exp();
        }
    }
    skin.model.forward(&conductivity_s).unwrap().iter().map(|v| v / STEP_V).collect()
}

/// A board that prints the current frame, in converter steps; `noise` is in the same.
struct Board {
    now: Arc<Mutex<Vec<f64>>>,
    noise: Arc<Mutex<f64>>,
    sent: u64,
    random: Random,
}

impl Device for Board {
    fn receive(&mut self, _: &[u8], _: Duration, _: &mut Vec<u8>) {}

    fn poll(&mut self, now: Duration, out: &mut Vec<u8>) {
        while (self.sent as f64) < now.as_secs_f64() * RATE_HZ {
            let (frame, noise) = (self.now.lock().unwrap(), *self.noise.lock().unwrap());
            let mut cell = |value: &f64| match (value + noise * self.random.normal()).round() {
                step if step.is_nan() => "nan".to_owned(),
                step => (step as i64).to_string(),
            };
            let line: Vec<String> = frame.iter().map(&mut cell).collect();
            out.extend(format!("{}\r\n", line.join(",")).bytes());
            self.sent += 1;
        }
    }

    fn power_cycle(&mut self) {}
}

/// A board, and the folder with its scene.
struct Bench {
    folder: tempfile::TempDir,
    now: Arc<Mutex<Vec<f64>>>,
    noise: Arc<Mutex<f64>>,
    _emulator: Emulator,
}

impl Bench {
    fn new() -> Self {
        let now = Arc::new(Mutex::new(frame(None)));
        let noise = Arc::new(Mutex::new(1.0));
        let (shown, level) = (Arc::clone(&now), Arc::clone(&noise));
        let board = Board { now: shown, noise: level, sent: 0, random: Random::new(5) };
        let listen = Listen::Tcp("127.0.0.1:0".into());
        let emulator = Emulator::start(Box::new(board), &listen, FaultPlan::default()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let scene = SCENE.replace("PORT", &emulator.endpoint().to_string());
        std::fs::write(folder.path().join("skin.toml"), scene).unwrap();
        Self { folder, now, noise, _emulator: emulator }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn start(&self, arguments: &[&str]) -> Child {
        let (scene, out) = (self.path("skin.toml"), self.path("skin.learned"));
        Command::new(env!("CARGO_BIN_EXE_eit"))
            .args([
                "--json",
                "learn",
                text(&scene),
                "--live",
                "--out",
                text(&out),
                "--hold-s",
                "0.15",
            ])
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap()
    }

    /// Presses where the command asks, until it ends or `at` says to stop; returns answer, exit code and all that it
    /// said. `force_n` is the force of a press; with `ask`, it is typed when asked for. A press that is refused is
    /// released. Fails if the command takes longer than [`LIMIT`].
    fn teach(
        &self,
        arguments: &[&str],
        force_n: impl Fn(usize) -> f64,
        ask: bool,
        mut at: impl FnMut(usize, &Child),
    ) -> (Option<Value>, i32, String) {
        let mut child = self.start(arguments);
        let mut typed = child.stdin.take().unwrap();
        let (mut said, mut made) = (String::new(), 0);
        let (sender, lines) = std::sync::mpsc::channel();
        let stderr = BufReader::new(child.stderr.take().unwrap());
        std::thread::spawn(move || stderr.lines().try_for_each(|line| sender.send(line.unwrap())));
        let end = Instant::now() + LIMIT;
        loop {
            let line = match lines.recv_timeout(end.saturating_duration_since(Instant::now())) {
                Ok(line) => line,
                Err(std::sync::mpsc::RecvTimeoutError::Disconnected) => break,
                Err(std::sync::mpsc::RecvTimeoutError::Timeout) => {
                    child.kill().unwrap();
                    panic!("still waiting after {LIMIT:?}: {said}");
                }
            };
            println!("{line}");
            if let Some(rest) = line.strip_prefix("press ") {
                let number: usize = rest.split(' ').next().unwrap().parse().unwrap();
                let place = place_of(&line);
                *self.now.lock().unwrap() = frame(Some((place, force_n(number - 1))));
                at(number - 1, &child);
            } else if line.starts_with("detected") {
                if ask {
                    writeln!(typed, "{}", force_n(made)).unwrap();
                }
                made += 1;
                *self.now.lock().unwrap() = frame(None);
            } else if line.starts_with("this press cannot be used") {
                *self.now.lock().unwrap() = frame(None);
            }
            said += &format!("{line}\n");
        }
        *self.now.lock().unwrap() = frame(None);
        let mut answer = String::new();
        child.stdout.take().unwrap().read_to_string(&mut answer).unwrap();
        let code = child.wait().unwrap().code().unwrap();
        (serde_json::from_str(&answer).ok(), code, said)
    }
}

/// "press 3 of 12 with 1 N at (20.0, -31.0) mm: ..." to metres.
fn place_of(line: &str) -> [f64; 2] {
    let inner = line.split('(').nth(1).unwrap().split(')').next().unwrap();
    let numbers: Vec<f64> = inner.split(", ").map(|x| x.parse::<f64>().unwrap() / 1e3).collect();
    [numbers[0], numbers[1]]
}

fn lines_of(path: &Path) -> usize {
    std::fs::read_to_string(path).unwrap().lines().count()
}

fn interrupt(child: &Child) {
    assert!(
        Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success()
    );
}

/// Twelve presses with two known weights, stopped by Ctrl-C after seven and continued: positions and forces are
/// learnt, the error is shown, and the stored files teach the same.
#[test]
fn twelve_presses_interrupted_and_continued() {
    let bench = Bench::new();
    let weights = ["--number", "12", "--force-n", "0.5,2"];
    let force = |k: usize| [0.5, 2.0][k % 2];
    let (answer, code, said) = bench.teach(&weights, force, false, |k, child| {
        if k == 7 {
            interrupt(child);
        }
    });
    assert_eq!(code, 0, "{said}");
    let answer = answer.unwrap();
    let first = answer["presses"].as_u64().unwrap();
    assert!(first == 7 || first == 8, "{answer}");
    assert!(said.contains("5 presses: error of held-out presses "), "{said}");
    let (table, recording) = (bench.path("skin.presses.csv"), bench.path("skin.presses.mcap"));
    assert_eq!(lines_of(&table) as u64, first + 1);
    // without --append nothing is overwritten
    let (_, code, said) = bench.teach(&weights, force, false, |_, _| {});
    assert!(code == 2 && said.contains("--append"), "{code}: {said}");
    // a line and a frame that a killed program left incomplete
    let mut file = std::fs::OpenOptions::new().append(true).open(&table).unwrap();
    file.write_all(b"0.01,0.0").unwrap();
    let mut file = std::fs::OpenOptions::new().append(true).open(&recording).unwrap();
    file.write_all(&[6, 200, 1, 0, 0, 0, 0, 0, 0, 1, 2, 3]).unwrap();
    let more = [&weights[..], &["--append"]].concat();
    let (answer, code, said) = bench.teach(&more, force, false, |_, _| {});
    assert_eq!(code, 0, "{said}");
    assert!(said.contains("incomplete last line") && said.contains("incomplete record"), "{said}");
    assert!(
        said.contains(&format!("press {} of 12", first + 1)) && !said.contains("press 1 of"),
        "{said}"
    );
    let answer = answer.unwrap();
    assert_eq!(answer["presses"], 12);
    let error_m = |answer: &Value, way: &str| answer["errors"][way]["median_m"].as_f64().unwrap();
    assert!(error_m(&answer, "map") < 5e-3, "{answer}");
    let force_error = answer["force"]["relative_error"].as_f64().unwrap();
    assert!(force_error < 0.15, "{answer}");
    // the stored table and recording teach the same
    let again = bench.path("again.learned");
    let scene = bench.path("skin.toml");
    let output = eit(&[
        "--json",
        "learn",
        text(&scene),
        "--presses",
        text(&table),
        "--frames",
        text(&recording),
        "--reference",
        "0..40",
        "--out",
        text(&again),
    ]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let offline: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(offline["presses"], 12);
    for way in ["map", "regression"] {
        let [one, other] = [&answer, &offline].map(|answer| error_m(answer, way));
        assert!((one - other).abs() < 1e-6, "{way}: {one} {other}");
    }
}

/// Forces typed after each press; too few presses are kept but not learnt.
#[test]
fn forces_that_are_typed() {
    let bench = Bench::new();
    let force = |k: usize| 0.4 + 0.5 * k as f64;
    let (answer, code, said) =
        bench.teach(&["--number", "6", "--ask-force"], force, true, |k, child| {
            if k == 2 {
                interrupt(child);
            }
        });
    assert!(
        code == 1 && answer.is_none() && said.contains("continue with --append"),
        "{code}: {said}"
    );
    let table = std::fs::read_to_string(bench.path("skin.presses.csv")).unwrap();
    assert!(table.lines().nth(2).unwrap().contains(",0.9,"), "{table}");
    assert!(!bench.path("skin.learned").exists());
}

/// A press with missing values is refused, with the reason, and asked for again once it is released.
#[test]
fn a_refused_press_is_asked_for_again() {
    let bench = Bench::new();
    let mut spoilt = 0;
    let (_, code, said) = bench.teach(
        &["--number", "4", "--all"],
        |_| 1.0,
        false,
        |k, _| {
            if k == 2 && spoilt < 2 {
                spoilt += 1;
                bench.now.lock().unwrap()[7] = f64::NAN;
            }
        },
    );
    assert!(code == 0 || code == 1, "{code}: {said}");
    let count = |words: &str| said.lines().filter(|line| line.starts_with(words)).count();
    assert_eq!(
        [count("this press cannot be used"), count("press 3 of 4"), count("press 4 of 4")],
        [2, 3, 1]
    );
    // the refused ones are not among those that are stored
    assert_eq!(lines_of(&bench.path("skin.presses.csv")), 5, "{said}");
}

/// Something that looks like a touch and is never held is named, with what to do: nothing waits without a word.
#[test]
fn a_touch_that_is_never_held_is_named() {
    let bench = Bench::new();
    let mut is_asked = false;
    let (_, code, said) = bench.teach(
        &["--number", "4"],
        |_| 1.0,
        false,
        |k, child| {
            assert_eq!(k, 0);
            *bench.now.lock().unwrap() = frame(None);
            if std::mem::replace(&mut is_asked, true) {
                // asked again after the touch was named
                return interrupt(child);
            }
            // far above the noise of the untouched skin, and never the same
            *bench.noise.lock().unwrap() = 2000.0;
            let noise = Arc::clone(&bench.noise);
            std::thread::spawn(move || {
                std::thread::sleep(Duration::from_secs(13));
                *noise.lock().unwrap() = 1.0;
            });
        },
    );
    assert_eq!(code, 1, "{said}");
    assert!(
        said.contains("the touch has changed for 10 s: hold it still, or release it"),
        "{said}"
    );
    assert!(said.contains("interrupted: 0 presses made now"), "{said}");
}

/// Ctrl-C while a force is to be typed ends the command, and keeps the press without its force.
#[test]
fn ctrl_c_ends_the_wait_for_a_force() {
    let bench = Bench::new();
    let mut child = bench.start(&["--number", "4", "--ask-force"]);
    // held open: otherwise its end would answer
    let typed = child.stdin.take().unwrap();
    let (sender, lines) = std::sync::mpsc::channel();
    let stderr = BufReader::new(child.stderr.take().unwrap());
    std::thread::spawn(move || stderr.lines().try_for_each(|line| sender.send(line.unwrap())));
    let end = Instant::now() + LIMIT;
    while let Ok(line) = lines.recv_timeout(end.saturating_duration_since(Instant::now())) {
        if line.starts_with("press ") {
            *bench.now.lock().unwrap() = frame(Some((place_of(&line), 1.0)));
        } else if line.starts_with("force of this press") {
            interrupt(&child);
        }
    }
    while child.try_wait().unwrap().is_none() {
        assert!(Instant::now() < end, "it does not end");
        std::thread::sleep(Duration::from_millis(20));
    }
    drop(typed);
    assert_eq!(child.wait().unwrap().code(), Some(1));
    assert_eq!(lines_of(&bench.path("skin.presses.csv")), 2);
}

/// Flags that belong together, and numbers out of range.
#[test]
fn wrong_arguments() {
    let refused = |arguments: &[&str], word: &str| {
        let output = eit(&[&["learn", "paper-disc", "--out", "x.learned"], arguments].concat());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains(word) && said.lines().count() == 1, "{arguments:?}: {said}");
    };
    refused(&[], "--presses");
    refused(&["--live", "--frames", "f.mcap"], "--frames");
    refused(&["--presses", "p.csv", "--force-n", "1"], "--live");
    refused(&["--live", "--number", "3"], "--number 3");
    refused(&["--live", "--force-n", "0"], "force_n is 0");
    refused(&["--live", "--hold-s", "1000"], "hold_s is 1000");
    refused(&["--live"], "instrument");
}
