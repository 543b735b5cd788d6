//! The check of an instrument against the model of its skin.

#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test file: a panic is a failed test"
)]

use eit_skin::eit_fem::fabric::Random;
use eit_skin::eit_hw::driver::{Event, FrameSource, Identity, Limits, Setup, Statistics};
use eit_skin::eit_hw::{
    Frame, HealthReport, HwError, Layout, Quality, Trouble, Unit, Verdict, measure_reference_frames,
};
use eit_skin::health;
use eit_skin::scene::{InstrumentSettings, Scene};
use eit_skin::{MeshOverride, Progress, Skin};
use std::time::Duration;

const FRAMES: usize = 40;

/// Nodes of the mesh that measures; the model has the scene's own.
const NODES: usize = 2500;

struct Bench {
    scene: Scene,
    model: Skin,
    quadruples: Vec<[u32; 4]>,
    measured_v: Vec<f64>,
}

impl Bench {
    fn of(name: &str) -> Self {
        let mut scene = Scene::load(name).unwrap();
        let driver = "eits1".to_owned();
        scene.instrument = Some(InstrumentSettings { driver, ..Default::default() });
        let set_up = |mesh: &MeshOverride| Skin::set_up(&scene, mesh, &mut Progress::silent());
        let skin = set_up(&MeshOverride { nodes: Some(NODES), ..Default::default() }).unwrap();
        let mut workspace = skin.model.workspace().unwrap();
        let solution = skin.solve(&skin.background_s(), &mut workspace).unwrap();
        Self {
            quadruples: skin.protocol.quadruples().unwrap().to_vec(),
            measured_v: solution.measurements().to_vec(),
            model: set_up(&Default::default()).unwrap(),
            scene,
        }
    }

    /// The voltages if the board's first electrode is the skin's electrode `first`, from 0.
    fn counted_from(&self, first: u32) -> Vec<f64> {
        let electrodes = self.model.protocol.electrodes() as u32;
        let of = |quadruple: &[u32; 4]| {
            let wired = quadruple.map(|electrode| (electrode + first) % electrodes);
            let at = self.quadruples.iter().position(|known| *known == wired);
            self.measured_v[at.unwrap()]
        };
        self.quadruples.iter().map(of).collect()
    }

    /// Checks noisy frames of these voltages; returns the correlation with the model if it is too low.
    fn check(&self, voltages: &[f64]) -> (HealthReport, Option<f64>) {
        let mut random = Random::new(5);
        let largest = voltages.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        let mut board = Board {
            setup: Setup {
                identity: Identity { driver: "test", name: String::new(), serial: String::new() },
                layout: Layout::ProtocolOrder,
                value_count: voltages.len(),
                complex: false,
                unit: Unit::Volt,
                frame_rate_hz: None,
                limits: Limits::default(),
            },
            values: move |i: usize| voltages[i] + 1e-5 * largest * random.normal(),
            frames: FRAMES,
        };
        let quiet = measure_reference_frames(&mut board, FRAMES, Duration::from_secs(60)).unwrap();
        let mut report = health::check(&quiet, &self.scene.instrument().unwrap()).unwrap();
        assert_eq!(report.verdict(), Verdict::Good, "without the model: {:?}", report.findings);
        health::check_model(&mut report, &quiet, &self.model).unwrap();
        let correlation = report.findings.iter().find_map(|finding| match finding.trouble {
            Trouble::Model { correlation } => Some(correlation),
            _ => None,
        });
        (report, correlation)
    }
}

/// Gives frames of these values.
struct Board<F> {
    setup: Setup,
    values: F,
    frames: usize,
}

impl<F: FnMut(usize) -> f64> FrameSource for Board<F> {
    fn setup(&self) -> &Setup {
        &self.setup
    }

    fn next_event(&mut self, _: Duration) -> Result<Option<Event>, HwError> {
        self.frames -= 1;
        let values: Vec<f64> = (0..self.setup.value_count).map(&mut self.values).collect();
        Ok(Some(Event::Frame(Frame {
            quality: vec![Quality::GOOD; values.len()],
            values,
            imaginary: None,
            sequence: (FRAMES - self.frames) as u64,
            epoch: 0,
            device_time_s: None,
            host_time_s: None,
        })))
    }

    fn recycle(&mut self, _: Frame) {}

    fn statistics(&self) -> Statistics {
        Statistics::default()
    }

    fn is_over(&self) -> bool {
        self.frames == 0
    }
}

/// A right order is accepted at any level and sign, and as sizes.
#[test]
fn the_right_order_is_accepted() {
    for name in ["paper-disc", "plate-with-hole", "patches"] {
        let bench = Bench::of(name);
        let scaled =
            |factor: f64| -> Vec<f64> { bench.measured_v.iter().map(|v| factor * v).collect() };
        let sizes: Vec<f64> = bench.measured_v.iter().map(|v| v.abs()).collect();
        for voltages in [scaled(1.0), scaled(30.0), scaled(-1.0), sizes] {
            let (report, _) = bench.check(&voltages);
            assert_eq!(report.verdict(), Verdict::Good, "{name}: {:?}", report.findings);
        }
    }
}

/// Electrodes counted from another one do not violate reciprocity, only the model.
#[test]
fn a_wrong_order_is_found() {
    for (name, all) in [("plate-with-hole", 1..12), ("patches", 1..16)] {
        let bench = Bench::of(name);
        for first in all {
            let (report, correlation) = bench.check(&bench.counted_from(first));
            println!("{name} from electrode {}: {correlation:?}", first + 1);
            assert!(correlation.is_some_and(|c| c < 0.9), "{name}, {first}: {:?}", report.findings);
            assert_eq!(report.verdict(), Verdict::Faulty);
            let line = report.findings[0].to_string();
            assert!(line.starts_with("the voltages are not those of this skin's"), "{line}");
        }
    }
}
