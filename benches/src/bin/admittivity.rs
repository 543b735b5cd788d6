//! Compares the times of the complex and the real forward problem, run alternately on one thread in
//! f64.
//!
//! Usage: `admittivity [ROUNDS] NODES...` with NODES of 500, 2000, 5000, 20000; five rounds unless
//! the first number is below 100. Prints one JSON object per mesh: medians of CPU time over the
//! rounds in seconds, and the minimum, median and maximum ratio within a round. The real problem is
//! that of `peers`; the complex one uses the same mesh with phases of 0 to 90 degrees across its
//! elements and contacts of 45 degrees.
#![allow(clippy::print_stdout, reason = "the table is this program's output")]

use benches::stopwatch::median;
use benches::{Result, problem};
use eit_fem::{AdmittivityModel, Complex64, PairProtocol};
use ndarray::Array2;
use serde_json::json;
use std::hint::black_box;

/// Repetitions of each timing per round.
const REPEATS: usize = 9;

fn main() -> Result<()> {
    let mut numbers = Vec::new();
    for argument in std::env::args().skip(1) {
        let number: usize = argument
            .parse()
            .map_err(|_| format!("'{argument}' is not a number of rounds or nodes"))?;
        numbers.push(number);
    }
    let rounds = match numbers.first() {
        Some(&rounds) if rounds < 100 => numbers.remove(0),
        _ => 5,
    };
    if numbers.is_empty() {
        return Err("give numbers of nodes: 500, 2000, 5000 or 20000".into());
    }
    numbers.into_iter().try_for_each(|target| compare(target, rounds.max(1)))
}

fn compare(target: usize, rounds: usize) -> Result<()> {
    let Some(mesh) = problem::peers_mesh(target)? else { return Ok(()) };
    let real = problem::model(&mesh)?;
    let protocol = PairProtocol { current_a: 1.0, ..PairProtocol::default() }.protocol()?;
    let contact = Complex64::from_polar(problem::CONTACT_IMPEDANCE, -std::f64::consts::FRAC_PI_4);
    let complex = AdmittivityModel::new(&mesh, &protocol, &[contact; problem::ELECTRODES])?;
    let sigma = problem::conductivity(real.elements());
    // values of 1 to 1.1 S: the excess over 1 is scaled to phases from 0 to 90 degrees
    let turned =
        |s: &f64| Complex64::from_polar(*s, std::f64::consts::FRAC_PI_2 * 10.0 * (s - 1.0));
    let gamma: Vec<Complex64> = sigma.iter().map(turned).collect();
    let (mut real_memory, mut complex_memory) = (real.workspace()?, complex.workspace()?);
    let shape = (protocol.measurements(), real.elements());
    let (mut real_jacobian, mut complex_jacobian) = (Array2::zeros(shape), Array2::zeros(shape));
    let mut times = [const { Vec::new() }; 4];
    for _ in 0..rounds {
        let found = [
            median(REPEATS, || {
                black_box(real.solve(&sigma, &mut real_memory)?.measurements());
                Ok(())
            })?,
            median(REPEATS, || {
                black_box(complex.solve(&gamma, &mut complex_memory)?.measurements());
                Ok(())
            })?,
            median(REPEATS, || {
                let mut solution = real.solve(&sigma, &mut real_memory)?;
                solution.jacobian_into(real_jacobian.view_mut())?;
                black_box(&real_jacobian);
                Ok(())
            })?,
            median(REPEATS, || {
                let mut solution = complex.solve(&gamma, &mut complex_memory)?;
                solution.jacobian_into(complex_jacobian.view_mut())?;
                black_box(&complex_jacobian);
                Ok(())
            })?,
        ];
        times.iter_mut().zip(found).for_each(|(list, t)| list.push(t.cpu_s));
    }
    let report = complex.solve(&gamma, &mut complex_memory)?.report();
    let [forward, complex_forward, both, complex_both] = times;
    let line = json!({
        "target": target,
        "nodes": mesh.surface().nodes().len(),
        "elements": real.elements(),
        "rounds": rounds,
        "forward_s": middle(&forward),
        "complex_forward_s": middle(&complex_forward),
        "forward_ratio": ratios(&complex_forward, &forward),
        "both_s": middle(&both),
        "complex_both_s": middle(&complex_both),
        "both_ratio": ratios(&complex_both, &both),
        "growth": report.growth,
        "backward_error": report.backward_error,
    });
    println!("{line}");
    Ok(())
}

/// Minimum, median and maximum ratio within a round.
fn ratios(complex: &[f64], real: &[f64]) -> [f64; 3] {
    let mut list: Vec<f64> = complex.iter().zip(real).map(|(c, r)| c / r).collect();
    list.sort_by(f64::total_cmp);
    [list[0], middle(&list), list[list.len() - 1]]
}

fn middle(list: &[f64]) -> f64 {
    eit_core::median(list.iter().copied()).unwrap_or(f64::NAN)
}
