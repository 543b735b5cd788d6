//! A solver that stops before it converges says so to a subscriber of `tracing`. A program of its own: `tracing` decides
//! once per process which events are wanted, so that the subscriber is set once, before any of them.
#![allow(clippy::unwrap_used, missing_docs, reason = "tests")]

use eit_fem::{ForwardModel, PairProtocol};
use eit_inverse::prior::Tikhonov;
use eit_inverse::sequence::{AbsoluteGaussNewton, AbsoluteSettings};
use eit_inverse::{
    Calibration, CalibrationSettings, CalibrationStatus, DifferenceFrames, OneStepSettings,
    SequenceSolver, SequenceStatus,
};
use eit_mesh::{MeshSettings, RimElectrodes, SkinShape, generate};
use ndarray::Array2;
use std::io::{self, Write};
use std::sync::Mutex;
use tracing_subscriber::filter::LevelFilter;

static LINES: Mutex<Vec<u8>> = Mutex::new(Vec::new());

struct Lines;

impl Write for Lines {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        LINES.lock().unwrap().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Runs a task that ends early, or not; checks the event of this crate about it and returns the task's result.
fn said<T>(task: impl FnOnce() -> T, what: &str, warning: &[&str]) -> T {
    LINES.lock().unwrap().clear();
    let result = task();
    let text = String::from_utf8(LINES.lock().unwrap().clone()).unwrap();
    let lines: String = text.lines().filter(|line| line.contains("eit_inverse")).collect();
    let is_early = !warning.is_empty();
    let end = if is_early { "stopped before it converged" } else { "converged" };
    assert!(lines.contains(&format!("{what} {end}")), "{lines}");
    assert_eq!(lines.contains("WARN"), is_early, "{lines}");
    assert!(warning.iter().all(|part| lines.contains(part)), "{lines}");
    result
}

const CONDUCTIVITY_S: f64 = 1e-5;

#[test]
fn what_did_not_converge_says_so() {
    tracing_subscriber::fmt()
        .with_max_level(LevelFilter::DEBUG)
        .with_ansi(false)
        .with_writer(|| Lines)
        .init();
    let electrodes = RimElectrodes::equally_spaced(8, 0.02);
    let skin = SkinShape::Disc { radius_m: 0.1 };
    let mesh = generate(&skin, &electrodes, &MeshSettings::with_edge(0.017)).unwrap();
    let protocol = PairProtocol { electrodes: 8, ..Default::default() }.protocol().unwrap();
    let model = ForwardModel::new(&mesh, &protocol, &[1e3; 8]).unwrap();
    let background = vec![CONDUCTIVITY_S; model.elements()];
    let reference = model.forward(&background).unwrap();

    // two untouched frames around a touched one
    let mut touched = background.clone();
    touched.iter_mut().skip(3).step_by(7).for_each(|s| *s *= 5.0);
    let mut values = Array2::zeros((3, reference.len()));
    values.row_mut(1).assign(&(model.forward(&touched).unwrap() - &reference));
    let prior = Tikhonov::new(mesh.surface());
    let run = |max_iterations: usize| {
        let one_step = OneStepSettings { hyperparameter: 0.01, ..Default::default() };
        let settings = AbsoluteSettings { one_step, max_iterations, ..Default::default() };
        let mut method = AbsoluteGaussNewton::new(&model, &background, &prior, settings).unwrap();
        let frames = DifferenceFrames::all_good(values.view());
        method.reconstruct_sequence(&frames).unwrap().report.status
    };
    let what = "absolute Gauss-Newton";
    let status = said(|| run(1), what, &["frames=3", "wanted_decrease=0.001"]);
    assert_eq!(status, SequenceStatus::IterationCap);
    assert_eq!(said(|| run(30), what, &[]), SequenceStatus::Converged);

    let run = |max_iterations: usize| {
        let start = CalibrationSettings::starting_at(40.0 * CONDUCTIVITY_S, &[5e3; 8]);
        let settings = CalibrationSettings { max_iterations, ..start };
        Calibration::of_frame(&model, &reference.to_vec(), &settings).unwrap().status
    };
    let status = said(|| run(1), "calibration", &["stalled=false", "max_iterations=1"]);
    assert_eq!(status, CalibrationStatus::IterationCap);
    assert_eq!(said(|| run(50), "calibration", &[]), CalibrationStatus::Converged);
}
