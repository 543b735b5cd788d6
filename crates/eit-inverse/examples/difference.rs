//! A finger on the paper's disc: simulated on one mesh, reconstructed on another with every prior
//! and every rule for the hyperparameter.
//!
//! Run with `cargo run --release -p eit-inverse --example difference`.
#![allow(missing_docs, reason = "an example is read, not linked against")]
#![allow(clippy::print_stdout, reason = "an example shows its result")]

use eit_fem::{ForwardModel, PairProtocol};
use eit_inverse::{
    Gaussian, GaussianSettings, HyperparameterChoice, Laplace, LaplaceSettings, NoiseTarget, Noser,
    OneStepGaussNewton, OneStepSettings, Prior, Tikhonov, metrics,
};
use eit_mesh::{Mesh, MeshSettings, RimElectrodes, SkinShape, generate};
use ndarray::Array2;
use std::error::Error;

const RADIUS_M: f64 = 0.1;
const CONDUCTIVITY_S: f64 = 1e-5;
const FINGER_M: [f64; 3] = [0.04, 0.03, 0.0];
/// Noise of each voltage, volts; the smallest voltages of this skin are about 0.1 V.
const NOISE_V: f64 = 1e-4;

/// One reconstruction.
pub struct Outcome {
    pub prior: &'static str,
    pub rule: &'static str,
    pub hyperparameter: f64,
    /// Distance of the image's centre to the finger, metres.
    pub position_error_m: f64,
    /// Correlation of image and truth.
    pub correlation: f64,
}

fn model(edge_m: f64) -> Result<(Mesh, ForwardModel), Box<dyn Error>> {
    let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
    let skin = SkinShape::Disc { radius_m: RADIUS_M };
    let mesh = generate(&skin, &electrodes, &MeshSettings::with_edge(edge_m))?;
    let model = ForwardModel::new(&mesh, &PairProtocol::default().protocol()?, &[1e3; 16])?;
    Ok((mesh, model))
}

/// Conductivity, increased by half within 0.015 m of the finger.
fn touched(mesh: &Mesh) -> Vec<f64> {
    let near = |c: [f64; 3]| (c[0] - FINGER_M[0]).hypot(c[1] - FINGER_M[1]) < 0.015;
    let centroids = mesh.surface().centroids();
    centroids.into_iter().map(|c| CONDUCTIVITY_S * if near(c) { 1.5 } else { 1.0 }).collect()
}

/// Twenty noisy frames of the finger and a reference frame, volts.
fn measure() -> Result<(Array2<f64>, Vec<f64>), Box<dyn Error>> {
    let (mesh, model) = model(0.004)?;
    let reference = model.forward(&vec![CONDUCTIVITY_S; model.elements()])?;
    let frame = model.forward(&touched(&mesh))?;
    // a congruential generator and sums of twelve numbers: nearly normal, and the same on every machine
    let mut state = 1_u64;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut normal = || (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
    let frames = Array2::from_shape_fn((20, frame.len()), |(_, i)| frame[i] + NOISE_V * normal());
    Ok((frames, reference.to_vec()))
}

/// Reconstructs the finger; returns one outcome per prior and rule.
pub fn run() -> Result<Vec<Outcome>, Box<dyn Error>> {
    let (frames, reference_frame) = measure()?;
    let first = frames.row(0).to_vec();
    let (mesh, model) = model(0.006)?;
    let background = vec![CONDUCTIVITY_S; model.elements()];
    let jacobian = model.jacobian(&background)?;
    let surface = mesh.surface();
    let truth: Vec<f64> =
        touched(&mesh).iter().zip(&background).map(|(after, before)| after - before).collect();

    let target = NoiseTarget::central(surface, &jacobian)?;
    let data = || (frames.view(), reference_frame.as_slice());
    let (frames, reference_frame) = data();
    let rules = [
        ("fixed", HyperparameterChoice::Fixed(0.03)),
        ("noise figure", HyperparameterChoice::NoiseFigure { figure: 1.0, target: &target }),
        ("L-curve", HyperparameterChoice::LCurve { frames, reference_frame }),
        ("GCV", HyperparameterChoice::Gcv { frames, reference_frame }),
    ];
    let priors: [&dyn Prior; 4] = [
        &Tikhonov::new(surface),
        &Noser::default(),
        &Laplace::new(surface, &LaplaceSettings::default())?,
        &Gaussian::new(surface, &GaussianSettings::default())?,
    ];
    let mut outcomes = Vec::new();
    println!("prior      rule            lambda  position error  correlation  set-up");
    for prior in priors {
        let mut inverse = OneStepGaussNewton::new(&jacobian, prior, OneStepSettings::default())?;
        for (rule, choice) in &rules {
            inverse.choose_hyperparameter(choice)?;
            let image = inverse.reconstruct(&first, reference_frame)?.to_vec();
            let position_error_m = metrics::position_error_m(&image, surface, FINGER_M)?;
            let correlation = metrics::correlation_coefficient(&image, &truth, surface.areas_m2())?;
            let report = inverse.report();
            let hyperparameter = report.hyperparameter;
            println!(
                "{:10} {rule:12} {hyperparameter:9.4}  {:11.1} mm  {correlation:11.2}  {:3.0} ms",
                report.prior,
                1e3 * position_error_m,
                1e3 * (report.prior_s + report.spectrum_s + report.basis_s),
            );
            let prior = report.prior;
            outcomes.push(Outcome { prior, rule, hyperparameter, position_error_m, correlation });
        }
    }
    Ok(outcomes)
}

fn main() -> Result<(), Box<dyn Error>> {
    run().map(|_| ())
}
