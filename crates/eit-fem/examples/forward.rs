//! Voltages of the paper's disc before and after a touch, and their prediction by the Jacobian.
//!
//! Run with `cargo run --release -p eit-fem --example forward`.
#![allow(missing_docs, reason = "an example is read, not linked against")]
#![allow(clippy::print_stdout, reason = "an example shows its result")]

use eit_fem::{ForwardModel, PairProtocol};
use eit_mesh::{MeshSettings, RimElectrodes, SkinShape, generate};
use ndarray::aview1;
use std::error::Error;

const CONDUCTIVITY_S: f64 = 1e-5;

/// Returns the largest change of a voltage by the touch, volt, and the fraction of the changes that
/// the Jacobian does not explain.
pub(crate) fn run() -> Result<(f64, f64), Box<dyn Error>> {
    let skin = SkinShape::Disc { radius_m: 0.1 };
    let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
    let mesh = generate(&skin, &electrodes, &MeshSettings::default())?;
    let model = ForwardModel::new(&mesh, &PairProtocol::default().protocol()?, &[1e3; 16])?;

    // conductivity raised by 1 % within 0.015 m of (0.04, 0.03) m
    let near = |c: [f64; 3]| (c[0] - 0.04).hypot(c[1] - 0.03) < 0.015;
    let centroids = mesh.surface().centroids();
    let added: Vec<f64> =
        centroids.into_iter().map(|c| if near(c) { 0.01 * CONDUCTIVITY_S } else { 0.0 }).collect();
    let touched: Vec<f64> = added.iter().map(|a| CONDUCTIVITY_S + a).collect();

    // one workspace serves every solve; after the first, solves do not allocate
    let mut workspace = model.workspace()?;
    let mut solution = model.solve(&vec![CONDUCTIVITY_S; added.len()], &mut workspace)?;
    let (reference, jacobian) = (solution.measurements(), solution.jacobian());
    let report = solution.report();
    let mut voltages = vec![0.0; reference.len()];
    model.solve(&touched, &mut workspace)?.measurements_into(&mut voltages)?;

    let change = &aview1(&voltages) - &reference;
    let predicted = jacobian.dot(&aview1(&added));
    let largest = |v: &ndarray::Array1<f64>| v.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let unexplained = largest(&(&change - &predicted)) / largest(&change);
    println!(
        "{} voltages from {} unknowns in {:.1} ms, backward error {:.0e}",
        voltages.len(),
        report.unknowns,
        1e3 * report.time_s,
        report.backward_error
    );
    println!("the touch changes them by up to {:.1} mV", 1e3 * largest(&change));
    println!("of which the Jacobian leaves {:.2} % unexplained", 100.0 * unexplained);
    Ok((largest(&change), unexplained))
}

fn main() -> Result<(), Box<dyn Error>> {
    run().map(|_| ())
}
