//! The check of an instrument against the model of its skin.

use crate::common::*;
use eit_skin::Skin;
use eit_skin::eit_fem::fabric::Random;
use eit_skin::eit_hw::driver::Event;
use eit_skin::eit_hw::{Frame, HealthReport, Trouble, Verdict, measure_reference_frames};
use eit_skin::health;
use eit_skin::scene::{InstrumentSettings, Scene};
use std::time::Duration;

const FRAMES: usize = 40;

/// Nodes of the mesh that measures; the model has the scene's own.
const NODES: usize = 2500;

/// Checks noisy frames of these voltages against a model; returns the correlation if it is too low, too.
fn check(model: &Skin, scene: &Scene, voltages: &[f64]) -> (HealthReport, Option<f64>) {
    let mut random = Random::new(5);
    let largest = voltages.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    let noisy = |k| Event::Frame(Frame::new(k, random.noisy(voltages, 1e-5 * largest)));
    let mut board = Listed::new((0..FRAMES as u64).map(noisy));
    let quiet = measure_reference_frames(&mut board, FRAMES, Duration::from_secs(60)).unwrap();
    let mut report = health::check(&quiet, &scene.instrument().unwrap()).unwrap();
    assert_eq!(report.verdict(), Verdict::Good, "without the model: {:?}", report.findings);
    health::check_model(&mut report, &quiet, model).unwrap();
    let correlation = report.findings.iter().find_map(|finding| match finding.trouble {
        Trouble::Model { correlation } => Some(correlation),
        _ => None,
    });
    (report, correlation)
}

/// The right order is accepted at any level and sign, and as magnitudes; electrodes counted from another one are not.
#[test]
fn a_wrong_order_is_found() {
    for (name, wrong) in [("paper-disc", 1..1), ("plate-with-hole", 1..12), ("patches", 1..16)] {
        let mut scene = Scene::load(name).unwrap();
        let driver = "eits1".to_owned();
        scene.instrument = Some(InstrumentSettings { driver, ..Default::default() });
        let model = Skin::from_scene(scene.clone()).unwrap();
        let measured = meshed(&scene, NODES);
        let measured_v = measured.model.forward(&measured.background_s()).unwrap().to_vec();
        let scaled = |factor: f64| -> Vec<f64> { measured_v.iter().map(|v| factor * v).collect() };
        let magnitudes = measured_v.iter().map(|v| v.abs()).collect();
        for voltages in [scaled(1.0), scaled(30.0), scaled(-1.0), magnitudes] {
            let (report, _) = check(&model, &scene, &voltages);
            assert_eq!(report.verdict(), Verdict::Good, "{name}: {:?}", report.findings);
        }
        let quadruples = model.protocol.quadruples().unwrap();
        let electrodes = model.protocol.electrodes() as u32;
        for first in wrong {
            let of = |quadruple: &[u32; 4]| {
                let wired = quadruple.map(|electrode| (electrode + first) % electrodes);
                measured_v[quadruples.iter().position(|known| *known == wired).unwrap()]
            };
            let counted_from: Vec<f64> = quadruples.iter().map(of).collect();
            let (report, correlation) = check(&model, &scene, &counted_from);
            assert!(correlation.is_some_and(|c| c < 0.9), "{name}, {first}: {:?}", report.findings);
            assert_eq!(report.verdict(), Verdict::Faulty);
            let line = report.findings[0].to_string();
            assert!(line.starts_with("the voltages are not those of this skin's"), "{line}");
        }
    }
}
