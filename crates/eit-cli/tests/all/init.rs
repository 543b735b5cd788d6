//! `eit init` with an emulated board that prints lines of numbers and a finger that presses on request. The voltages come
//! from another mesh than the command's, solved with the press in it (no linearisation), in converter steps.
#![cfg(unix)]

use crate::common::emulated::{Board, converse, side_by_side};
use crate::common::*;
use eit_fem::{DrivenElectrodes, ForwardModel, Protocol};
use eit_skin::first_scene::{FirstScene, Outline};
use eit_skin::scene::{ChangeSign, Direction, Position, Scene};
use eit_skin::{Progress, Skin};

/// Radius of the finger, metres; a tenth more than the command assumes.
const RADIUS_M: f64 = 0.008;

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
    let place = |k: usize| {
        let off = wiring.uneven * [0.0, 1.0, -0.5, -1.0, 0.7][k % 5];
        // along the rim from the middle of the right edge: half of it, then the others and the first again
        let rim_m = 2.0 * (width_m + height_m);
        let mut left = (k as f64 + off) / count as f64 * rim_m + height_m / 2.0;
        let [mut x, mut y, mut dx, mut dy] = [width_m / 2.0, -height_m / 2.0, 0.0, 1.0];
        for long in [height_m, width_m, height_m, width_m, height_m] {
            let step = left.min(long);
            (x, y, left) = (x + step * dx, y + step * dy, left - step);
            (dx, dy) = (-dy, dx);
        }
        [x, y]
    };
    let mut places_m: Vec<[f64; 2]> = (0..count).map(place).collect();
    if let Some(electrode) = wiring.swapped {
        places_m.swap(electrode, (electrode + 1) % count);
    }
    let positions = places_m.into_iter().map(|[x, y]| Position([x, y, 0.0]));
    scene.electrodes.positions_m = Some(positions.collect());
    (scene.electrodes.first_angle_deg, scene.electrodes.count) = (None, None);
    scene
}

/// Untouched, and pressed at each place so that the conductivity is `times` as large; in steps of a 16-bit converter.
fn frames(truth: &FirstScene, wiring: Wiring, places_m: &[[f64; 2]], times: f64) -> Vec<Vec<f64>> {
    let skin = Skin::from_scene(scene(truth, wiring)).unwrap();
    let skin = skin.with_nodes(5000, &mut Progress::silent()).unwrap();
    let mut quadruples = skin.protocol.quadruples().unwrap().to_vec();
    if truth.ground.is_some() {
        quadruples = against_sink(&quadruples, truth.electrodes as u32);
    }
    let protocol = Protocol::from_quadruples(truth.electrodes, &quadruples, skin.current_a);
    let contacts = &skin.contact_impedance;
    let model = ForwardModel::new(&skin.mesh, &protocol.unwrap(), contacts).unwrap();
    let voltages = |place: Option<&[f64; 2]>| {
        let mut conductivity_s = skin.background_s();
        for (value, [cx, cy, _]) in conductivity_s.iter_mut().zip(skin.mesh.surface().centroids()) {
            if let Some([x, y]) = place {
                let square = (cx - x).powi(2) + (cy - y).powi(2);
                *value *= times.powf((-square / RADIUS_M.powi(2)).exp());
            }
        }
        model.forward(&conductivity_s).unwrap()
    };
    let untouched = voltages(None);
    // differences of potentials are formed of larger values, and need a finer converter
    let step_v = largest(&untouched) / if truth.ground.is_some() { 8e6 } else { 30_000.0 };
    let all = std::iter::once(untouched).chain(places_m.iter().map(|place| voltages(Some(place))));
    all.map(|frame| (frame / step_v).to_vec()).collect()
}

/// Potentials of undriven electrodes against the sink, for the drives of these measurements.
fn against_sink(quadruples: &[[u32; 4]], electrodes: u32) -> Vec<[u32; 4]> {
    let drives = quadruples.chunk_by(|p, q| p[..2] == q[..2]).map(|of| [of[0][0], of[0][1]]);
    let of_drive = |[a, b]: [u32; 2]| {
        (0..electrodes).filter(move |e| ![a, b].contains(e)).map(move |e| [a, b, e, b])
    };
    drives.flat_map(of_drive).collect()
}

/// Runs `eit init` on the board and presses when asked; returns the folder of `my.toml`, stdout and stderr.
fn init(truth: &FirstScene, wiring: Wiring, times: f64, options: &str) -> (Folder, String, String) {
    let frames = frames(truth, wiring, &truth.outline.press_places_m(), times);
    let (board, folder) = (Board::start(40.0, frames[0].clone()), Folder::new());
    let file = folder.path("my.toml");
    let line = format!("init {file} --port {} --listen-s 1.5 {options}", board.port);
    let (answer, code, said) = converse(line, |line, _, _| {
        for (words, frame) in [("press 1", 1), ("press 2", 2), ("detected", 0)] {
            if line.starts_with(words) {
                board.show(frames[frame].clone());
            }
        }
    });
    assert_eq!(code, 0, "{said}");
    (folder, answer, said)
}

/// The scene that is written is the true one.
fn check(truth: &FirstScene, times: f64, options: &str) {
    let (folder, answer, said) = init(truth, Wiring::default(), times, options);
    let scene = Scene::load(folder.path("my.toml")).unwrap();
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

/// The paper's disc, wired clockwise from the upper left, values in the order of the electrodes; as potentials against the
/// sink; a rectangle whose touches lower the conductivity; eight electrodes with opposite drive.
#[test]
fn the_scene_of_a_board_is_found() {
    let disc = || FirstScene::new(Outline::Disc { radius_m: 0.1 }, 16);
    let mut clockwise = FirstScene { first_angle_deg: 135.0, ..disc() };
    clockwise.direction = Direction::Clockwise;
    clockwise.protocol.order = eit_fem::Order::Ascending;
    let mut against_sink = FirstScene { first_angle_deg: 45.0, ..disc() };
    against_sink.ground = Some(DrivenElectrodes::Drop);
    let losing = FirstScene { first_angle_deg: 180.0, sign: ChangeSign::Decrease, ..rectangle() };
    let mut opposite = FirstScene::new(Outline::Disc { radius_m: 0.06 }, 8);
    opposite.first_angle_deg = 45.0;
    opposite.protocol.drive = eit_fem::PairPattern::Opposite;
    let cases = [
        (clockwise, 1.5, "--radius-mm 100 --electrodes 16"),
        (against_sink, 1.5, "--radius-mm 100 --electrodes 16"),
        (losing, 0.6, RECTANGLE),
        (opposite, 1.5, "--radius-mm 60 --electrodes 8"),
    ];
    side_by_side(cases, |(truth, times, options)| check(&truth, times, options));
}

const RECTANGLE: &str = "--width-mm 120 --height-mm 80 --electrodes 16";

fn rectangle() -> FirstScene {
    FirstScene::new(Outline::Rectangle { width_m: 0.12, height_m: 0.08 }, 16)
}

/// With and without presses, and the rest is found as if they were not.
#[test]
fn exchanged_wires_are_named() {
    side_by_side([(4, ""), (15, ""), (9, " --no-presses")], |(swapped, more)| {
        let wiring = Wiring { swapped: Some(swapped), ..Wiring::default() };
        let options = format!("{RECTANGLE}{more}");
        let (folder, answer, said) = init(&rectangle(), wiring, 1.5, &options);
        let file = folder.path("my.toml");
        let (all, written) = (format!("{said}{answer}"), read_text(&file));
        let next = (swapped + 1) % 16;
        let words = format!("electrodes {} and {} look exchanged", swapped + 1, next + 1);
        assert!(all.contains(&words) && written.contains(&words), "{all}{written}");
        // told before the presses, and with the answer
        let times = if more.is_empty() { 2 } else { 1 };
        assert_eq!(all.matches("The board prints").count(), times, "{all}");
        if more.is_empty() {
            let electrodes = Scene::load(&file).unwrap().electrodes;
            assert_eq!(electrodes.first_angle_deg, Some(0.0), "{all}");
            assert_eq!(electrodes.direction, Direction::Counterclockwise, "{all}");
        }
    });
}

/// Electrodes that are not equally spaced are reported; equally spaced ones are not, nor are any wires reported as exchanged.
#[test]
fn uneven_electrodes_are_noticed() {
    let options = format!("{RECTANGLE} --json --no-presses");
    side_by_side([(0.0, false), (0.05, false), (0.3, true)], |(uneven, is_reported)| {
        let wiring = Wiring { uneven, ..Wiring::default() };
        let answer = parse(&init(&rectangle(), wiring, 1.5, &options).1);
        let unsure = answer["unsure"].to_string();
        assert_eq!(unsure.contains("not equally spaced"), is_reported, "{uneven}: {answer}");
        assert!(answer["swapped_electrodes"].is_null(), "{uneven}: {answer}");
        let correlation = number(&answer, "model_correlation");
        assert!(is_reported || correlation > 0.98, "{uneven}: {correlation}");
    });
}

/// Invalid settings are rejected before anything is opened or written.
#[test]
fn wrong_arguments_are_reported_by_name() {
    let (_folder, [file]) = Folder::with_paths(["my.toml"]);
    let cases = [
        ("", "--shape"),
        ("--radius-mm 100", "--electrodes"),
        ("--radius-mm -1 --electrodes 16", "--radius-mm -1"),
        ("--radius-mm 0.1 --electrodes 16", "--radius-mm 0.1: it must be from 1 to 10000"),
        ("--radius-mm nan --electrodes 16", "--radius-mm NaN"),
        ("--radius-mm 100 --width-mm 5 --electrodes 16", "keep one shape"),
        ("--radius-mm 100 --electrodes 0", "electrode"),
        ("--radius-mm 100 --electrodes 16 --port tcp:nowhere", "tcp:host:port"),
        ("--radius-mm 5 --electrodes 16 --electrode-width-mm 9", "electrode"),
    ];
    refuse_each(cases.map(|(options, words)| (format!("init {file} {options}"), words)));
    assert!(!exists(&file));
    let good = format!("init {file} --radius-mm 100 --electrodes 16");
    succeed(&good);
    says(&refuse(&good), "exists…--force");
    succeed(format!("{good} --force"));
    succeed(format!("plan {file}"));
}

/// A board whose count does not match the electrodes: the answer names a number that would.
#[test]
fn another_number_of_electrodes_is_named() {
    let truth = FirstScene::new(Outline::Disc { radius_m: 0.1 }, 16);
    let board = Board::start(40.0, frames(&truth, Wiring::default(), &[], 1.0).remove(0));
    let (folder, port) = (Folder::new(), &board.port);
    let file = folder.path("my.toml");
    let size = "--radius-mm 100 --electrodes 12 --listen-s 1";
    let (_, code, said) = converse(format!("init {file} {size} --port {port}"), |_, _, _| {});
    assert_eq!(code, 2, "{said}");
    says(&said, "208…[16]…--electrodes");
    assert!(!exists(&file));
}
