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
use eit_mesh::{Mesh, MeshSettings, RimElectrodes, SkinShape, generate};
use ndarray::Array2;
use std::cell::RefCell;
use std::io::{self, Write};
use std::sync::Once;
use tracing_subscriber::filter::LevelFilter;

thread_local! {
    /// Lines of the events of this thread, and so of one test.
    static LINES: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
}

struct Lines;

impl Write for Lines {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        LINES.with_borrow_mut(|lines| lines.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Runs a task; returns its result and the events of this crate.
fn events<T>(task: impl FnOnce() -> T) -> (T, String) {
    static SUBSCRIBER: Once = Once::new();
    SUBSCRIBER.call_once(|| {
        tracing_subscriber::fmt()
            .with_max_level(LevelFilter::DEBUG)
            .with_ansi(false)
            .with_writer(|| Lines)
            .init();
    });
    LINES.take();
    let result = task();
    let text = String::from_utf8(LINES.take()).unwrap();
    let ours = |line: &&str| line.contains("eit_inverse");
    (result, text.lines().filter(ours).collect::<Vec<_>>().join("\n"))
}

const CONDUCTIVITY_S: f64 = 1e-5;

fn skin() -> (Mesh, ForwardModel) {
    let electrodes = RimElectrodes::equally_spaced(8, 0.02);
    let skin = SkinShape::Disc { radius_m: 0.1 };
    let mesh = generate(&skin, &electrodes, &MeshSettings::with_edge(0.017)).unwrap();
    let protocol = PairProtocol { electrodes: 8, ..Default::default() }.protocol().unwrap();
    let model = ForwardModel::new(&mesh, &protocol, &[1e3; 8]).unwrap();
    (mesh, model)
}

/// Two untouched frames around a touched one, as changes of the voltages.
fn differences(model: &ForwardModel, background: &[f64]) -> Array2<f64> {
    let reference = model.forward(background).unwrap().to_vec();
    let touched: Vec<f64> = background
        .iter()
        .enumerate()
        .map(|(element, s)| if element % 7 == 3 { 5.0 * s } else { *s })
        .collect();
    let frame = model.forward(&touched).unwrap().to_vec();
    Array2::from_shape_fn(
        (3, reference.len()),
        |(t, i)| {
            if t == 1 { frame[i] - reference[i] } else { 0.0 }
        },
    )
}

#[test]
fn absolute_images_that_did_not_converge() {
    let (mesh, model) = skin();
    let background = vec![CONDUCTIVITY_S; model.elements()];
    let values = differences(&model, &background);
    let prior = Tikhonov::new(mesh.surface());
    let run = |max_iterations: usize| {
        let one_step = OneStepSettings { hyperparameter: 0.01, ..Default::default() };
        let settings = AbsoluteSettings { one_step, max_iterations, ..Default::default() };
        let mut method = AbsoluteGaussNewton::new(&model, &background, &prior, settings).unwrap();
        method.reconstruct_sequence(&DifferenceFrames::all_good(values.view())).unwrap()
    };
    let (sequence, lines) = events(|| run(1));
    assert_eq!(sequence.report.status, SequenceStatus::IterationCap);
    assert!(lines.contains("WARN"), "{lines}");
    assert!(lines.contains("absolute Gauss-Newton stopped before it converged"), "{lines}");
    assert!(lines.contains("frames=3") && lines.contains("wanted_decrease=0.001"), "{lines}");
    let (sequence, lines) = events(|| run(30));
    assert_eq!(sequence.report.status, SequenceStatus::Converged);
    assert!(lines.contains("absolute Gauss-Newton converged"), "{lines}");
    assert!(!lines.contains("WARN"), "{lines}");
}

#[test]
fn a_calibration_that_did_not_converge() {
    let (_, model) = skin();
    let frame = model.forward(&vec![CONDUCTIVITY_S; model.elements()]).unwrap().to_vec();
    let run = |max_iterations: usize| {
        let start = CalibrationSettings::starting_at(40.0 * CONDUCTIVITY_S, &[5e3; 8]);
        let settings = CalibrationSettings { max_iterations, ..start };
        Calibration::of_frame(&model, &frame, &settings).unwrap()
    };
    let (found, lines) = events(|| run(1));
    assert_eq!(found.status, CalibrationStatus::IterationCap);
    assert!(lines.contains("WARN"), "{lines}");
    assert!(lines.contains("calibration stopped before it converged"), "{lines}");
    assert!(lines.contains("stalled=false") && lines.contains("max_iterations=1"), "{lines}");
    let (found, lines) = events(|| run(50));
    assert_eq!(found.status, CalibrationStatus::Converged);
    assert!(lines.contains("calibration converged"), "{lines}");
    assert!(!lines.contains("WARN"), "{lines}");
}
