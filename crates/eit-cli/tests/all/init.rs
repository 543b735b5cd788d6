//! `eit init` as the builder of a new skin uses it: a board that prints lines of numbers and whose wiring is
//! not documented, and a finger that presses on request. The board's voltages come from another mesh than the
//! command's, solved with the press in it (no linearisation), rounded to converter steps.
#![cfg(unix)]
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

use crate::common::{eit, text};
use eit_fem::fabric::Random;
use eit_hw::emulator::{Device, Emulator, FaultPlan, Listen};
use eit_skin::first_scene::{FirstScene, Outline};
use eit_skin::scene::{ChangeSign, Direction, Position, Scene};
use eit_skin::{Progress, Skin};
use serde_json::Value;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

/// Frame rate, hertz.
const RATE_HZ: f64 = 40.0;
/// Radius of the finger, metres; a tenth more than the command assumes.
const RADIUS_M: f64 = 0.008;

/// A board that prints a selected frame, in converter steps.
struct Board {
    frames: Vec<Vec<f64>>,
    which: Arc<AtomicUsize>,
    sent: u64,
    random: Random,
}

impl Device for Board {
    fn receive(&mut self, _: &[u8], _: Duration, _: &mut Vec<u8>) {}

    fn poll(&mut self, now: Duration, out: &mut Vec<u8>) {
        while (self.sent as f64) < now.as_secs_f64() * RATE_HZ {
            let frame = &self.frames[self.which.load(Ordering::Relaxed)];
            // one step of noise
            let steps = frame.iter().map(|value| (value + self.random.normal()).round() as i64);
            let line: Vec<String> = steps.map(|value| value.to_string()).collect();
            out.extend(format!("{}\r\n", line.join(",")).bytes());
            self.sent += 1;
        }
    }

    fn power_cycle(&mut self) {}
}

/// A board's wiring that is not as the scene of its skin says.
#[derive(Clone, Copy, Default)]
struct Wiring {
    /// This electrode's wire, from 0, is exchanged with the next one's.
    swapped: Option<usize>,
    /// Electrodes are off their places along the rim by up to this share of their spacing.
    uneven: f64,
}

/// The scene of the true skin.
fn scene(truth: &FirstScene, wiring: Wiring) -> Scene {
    let mut scene = truth.scene().unwrap();
    if wiring.swapped.is_none() && wiring.uneven == 0.0 {
        return scene;
    }
    let Outline::Rectangle { width_m, height_m } = truth.outline else { panic!("a rectangle") };
    let count = truth.electrodes;
    let mut places_m: Vec<[f64; 2]> = (0..count)
        .map(|k| {
            let off = wiring.uneven * [0.0, 1.0, -0.5, -1.0, 0.7][k % 5];
            // along the rim from the middle of the right edge
            let s = (k as f64 + off) / count as f64 * 2.0 * (width_m + height_m);
            let edges = [
                ([width_m / 2.0, 0.0], [0.0, 1.0], height_m / 2.0),
                ([width_m / 2.0, height_m / 2.0], [-1.0, 0.0], width_m),
                ([-width_m / 2.0, height_m / 2.0], [0.0, -1.0], height_m),
                ([-width_m / 2.0, -height_m / 2.0], [1.0, 0.0], width_m),
                ([width_m / 2.0, -height_m / 2.0], [0.0, 1.0], height_m / 2.0),
            ];
            let mut left = s;
            for ([x, y], [dx, dy], long) in edges {
                if left <= long {
                    return [x + left * dx, y + left * dy];
                }
                left -= long;
            }
            panic!("{s} m is beyond the rim")
        })
        .collect();
    if let Some(electrode) = wiring.swapped {
        places_m.swap(electrode, (electrode + 1) % count);
    }
    let positions = places_m.into_iter().map(|[x, y]| Position([x, y, 0.0]));
    scene.electrodes.positions_m = Some(positions.collect());
    (scene.electrodes.first_angle_deg, scene.electrodes.count) = (None, None);
    scene
}

/// Frames of the true skin, in steps of a 16-bit converter: untouched, and pressed at each of the places;
/// `times` is the factor of the conductivity under the finger.
fn frames(truth: &FirstScene, wiring: Wiring, places_m: &[[f64; 2]], times: f64) -> Vec<Vec<f64>> {
    let skin = Skin::from_scene(scene(truth, wiring)).unwrap();
    let skin = skin.with_nodes(5000, &mut Progress::silent()).unwrap();
    let voltages = |place: Option<&[f64; 2]>| {
        let mut conductivity_s = skin.background_s();
        for (value, [cx, cy, _]) in conductivity_s.iter_mut().zip(skin.mesh.surface().centroids()) {
            if let Some([x, y]) = place {
                let square = (cx - x).powi(2) + (cy - y).powi(2);
                *value *= times.powf((-square / RADIUS_M.powi(2)).exp());
            }
        }
        skin.model.forward(&conductivity_s).unwrap().to_vec()
    };
    let untouched = voltages(None);
    let largest = untouched.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    let all = std::iter::once(untouched).chain(places_m.iter().map(|place| voltages(Some(place))));
    all.map(|frame| frame.iter().map(|value| value / largest * 30_000.0).collect()).collect()
}

/// Runs `eit init` on the board and presses when asked; returns the answer.
fn init(
    truth: &FirstScene,
    wiring: Wiring,
    times: f64,
    folder: &Path,
    arguments: &[&str],
) -> (Value, String) {
    let places_m = truth.outline.press_places_m();
    let which = Arc::new(AtomicUsize::new(0));
    let board = Board {
        frames: frames(truth, wiring, &places_m, times),
        which: Arc::clone(&which),
        sent: 0,
        random: Random::new(11),
    };
    let emulator =
        Emulator::start(Box::new(board), &Listen::Tcp("127.0.0.1:0".into()), FaultPlan::default())
            .unwrap();
    let (port, scene) = (emulator.endpoint().to_string(), folder.join("my.toml"));
    let mut child = Command::new(env!("CARGO_BIN_EXE_eit"))
        .args(["init", text(&scene), "--port", &port, "--listen-s", "1.5"])
        .args(arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = String::new();
    for line in BufReader::new(child.stderr.take().unwrap()).lines() {
        let line = line.unwrap();
        if line.starts_with("press 1") {
            which.store(1, Ordering::Relaxed);
        } else if line.starts_with("press 2") {
            which.store(2, Ordering::Relaxed);
        } else if line.starts_with("detected") {
            which.store(0, Ordering::Relaxed);
        }
        said += &format!("{line}\n");
    }
    let mut answer = String::new();
    child.stdout.take().unwrap().read_to_string(&mut answer).unwrap();
    assert!(child.wait().unwrap().success(), "{said}");
    (Value::String(answer), said)
}

fn check(truth: &FirstScene, times: f64, arguments: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let (answer, said) = init(truth, Wiring::default(), times, folder.path(), arguments);
    let scene = Scene::load(text(&folder.path().join("my.toml"))).unwrap();
    let all = format!("{said}{answer}");
    assert!(!all.contains("nsure"), "{all}");
    let angle = scene.electrodes.first_angle_deg.unwrap();
    // half a degree: electrodes are at ends of edges of another mesh
    let off = (angle - truth.first_angle_deg + 180.0).rem_euclid(360.0) - 180.0;
    assert!(off.abs() < 0.5, "{angle} for {}: {all}", truth.first_angle_deg);
    assert_eq!(scene.electrodes.direction, truth.direction, "{all}");
    assert_eq!(scene.touch.sign, truth.sign, "{all}");
    let skin = Skin::from_scene(scene).unwrap();
    let measured = truth.protocol.quadruples().unwrap();
    assert_eq!(skin.protocol.quadruples().unwrap(), measured, "{all}");
}

/// The paper's disc, wired clockwise from the upper left, values in the order of the electrodes.
#[test]
fn a_disc_that_is_wired_clockwise() {
    let mut truth = FirstScene::new(Outline::Disc { radius_m: 0.1 }, 16);
    truth.first_angle_deg = 135.0;
    truth.direction = Direction::Clockwise;
    truth.protocol.order = eit_fem::Order::Ascending;
    check(&truth, 1.5, &["--radius-mm", "100", "--electrodes", "16"]);
}

/// A rectangle whose touches lower the conductivity, wired from the middle of its left edge.
#[test]
fn a_rectangle_that_loses_conductivity() {
    let mut truth = FirstScene::new(Outline::Rectangle { width_m: 0.12, height_m: 0.08 }, 16);
    truth.first_angle_deg = 180.0;
    truth.sign = ChangeSign::Decrease;
    let size = ["--width-mm", "120", "--height-mm", "80", "--electrodes", "16"];
    check(&truth, 0.6, &size);
}

/// Two neighbouring wires are exchanged: they are named, with and without presses, and the rest is found as if they were
/// not.
#[test]
fn exchanged_wires_are_named() {
    let truth = FirstScene::new(Outline::Rectangle { width_m: 0.12, height_m: 0.08 }, 16);
    let size = ["--width-mm", "120", "--height-mm", "80", "--electrodes", "16"];
    for (swapped, more) in [(4, &[][..]), (15, &[]), (9, &["--no-presses"])] {
        let folder = tempfile::tempdir().unwrap();
        let wiring = Wiring { swapped: Some(swapped), ..Wiring::default() };
        let (answer, said) = init(&truth, wiring, 1.5, folder.path(), &[&size, more].concat());
        let all = format!("{said}{answer}");
        let words =
            format!("electrodes {} and {} look exchanged", swapped + 1, (swapped + 1) % 16 + 1);
        let place = folder.path().join("my.toml");
        let written = std::fs::read_to_string(&place).unwrap();
        assert!(all.contains(&words) && written.contains(&words), "{all}{written}");
        // told before the presses, and with the answer
        let times = if more.is_empty() { 2 } else { 1 };
        assert_eq!(all.matches("The board prints").count(), times, "{all}");
        if more.is_empty() {
            let electrodes = Scene::load(text(&place)).unwrap().electrodes;
            assert_eq!(electrodes.first_angle_deg, Some(0.0), "{all}");
            assert_eq!(electrodes.direction, Direction::Counterclockwise, "{all}");
        }
    }
}

/// Electrodes that are not equally spaced are doubted; equally spaced ones are not, nor any wires taken for exchanged.
#[test]
fn uneven_electrodes_are_doubted() {
    let truth = FirstScene::new(Outline::Rectangle { width_m: 0.12, height_m: 0.08 }, 16);
    let size =
        ["--width-mm", "120", "--height-mm", "80", "--electrodes", "16", "--json", "--no-presses"];
    for (uneven, violates_reciprocity) in [(0.0, false), (0.05, false), (0.3, true)] {
        let folder = tempfile::tempdir().unwrap();
        let wiring = Wiring { uneven, ..Wiring::default() };
        let (answer, _) = init(&truth, wiring, 1.5, folder.path(), &size);
        let answer: Value = serde_json::from_str(answer.as_str().unwrap()).unwrap();
        let unsure = answer["unsure"].to_string();
        assert_eq!(
            unsure.contains("not equally spaced"),
            violates_reciprocity,
            "{uneven}: {answer}"
        );
        assert_eq!(answer["swapped_electrodes"], Value::Null, "{uneven}: {answer}");
        let correlation = answer["model_correlation"].as_f64().unwrap();
        assert!(violates_reciprocity || correlation > 0.98, "{uneven}: {correlation}");
    }
}

/// Eight electrodes with opposite drive, all pairs measured, of a disc.
#[test]
fn a_board_with_opposite_drive() {
    let mut truth = FirstScene::new(Outline::Disc { radius_m: 0.06 }, 8);
    truth.first_angle_deg = 45.0;
    truth.protocol.drive = eit_fem::PairPattern::Opposite;
    check(&truth, 1.5, &["--radius-mm", "60", "--electrodes", "8"]);
}

/// Invalid settings are rejected before anything is opened or written.
#[test]
fn wrong_arguments_are_told_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("my.toml");
    let refused = |arguments: &[&str], word: &str| {
        let all: Vec<&str> = ["init", text(&place)].iter().chain(arguments).copied().collect();
        let output = eit(&all);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains(word) && said.lines().count() == 1, "{arguments:?}: {said}");
        assert!(!place.exists());
    };
    refused(&[], "--shape");
    refused(&["--radius-mm", "100"], "--electrodes");
    refused(&["--radius-mm", "-1", "--electrodes", "16"], "--radius-mm -1");
    refused(
        &["--radius-mm", "0.1", "--electrodes", "16"],
        "--radius-mm 0.1: it must be from 1 to 10000",
    );
    refused(&["--radius-mm", "nan", "--electrodes", "16"], "--radius-mm NaN");
    refused(&["--radius-mm", "100", "--width-mm", "5", "--electrodes", "16"], "keep one shape");
    refused(&["--radius-mm", "100", "--electrodes", "0"], "electrode");
    refused(
        &["--radius-mm", "100", "--electrodes", "16", "--port", "tcp:nowhere"],
        "tcp:host:port",
    );
    refused(&["--radius-mm", "5", "--electrodes", "16", "--electrode-width-mm", "9"], "electrode");
    let good = ["init", text(&place), "--radius-mm", "100", "--electrodes", "16"];
    assert!(eit(&good).status.success());
    let again = eit(&good);
    let said = String::from_utf8_lossy(&again.stderr).into_owned();
    assert_eq!(again.status.code(), Some(2));
    assert!(said.contains("exists") && said.contains("--force"), "{said}");
    assert!(eit(&[&good[..], &["--force"]].concat()).status.success());
    assert!(eit(&["plan", text(&place)]).status.success());
}

/// A board whose count does not match the electrodes: the answer names a number that would.
#[test]
fn another_number_of_electrodes_is_named() {
    let truth = FirstScene::new(Outline::Disc { radius_m: 0.1 }, 16);
    let board = Board {
        frames: frames(&truth, Wiring::default(), &[], 1.0),
        which: Arc::default(),
        sent: 0,
        random: Random::new(3),
    };
    let listen = Listen::Tcp("127.0.0.1:0".into());
    let emulator = Emulator::start(Box::new(board), &listen, FaultPlan::default()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let (place, port) = (folder.path().join("my.toml"), emulator.endpoint().to_string());
    let size = ["--radius-mm", "100", "--electrodes", "12", "--listen-s", "1", "--port", &port];
    let output = eit(&[&["init", text(&place)], &size[..]].concat());
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains("208") && said.contains("[16]") && said.contains("--electrodes"),
        "{said}"
    );
    assert!(!place.exists());
}
