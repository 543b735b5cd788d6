//! Against solutions in 400-bit interval arithmetic, computed by others.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "tests")]

mod common;

use eit_fem::{ForwardModel, PairProtocol};

/// The plain case to 1e-12 of the largest voltage: textbook assembly with sparse Cholesky loses
/// 2e-14 on it, so 1e-12 leaves room for another ordering, none for a wrong formula.
#[test]
fn plain_case_to_1e_12() {
    let Some(extreme) = fixtures::extreme::load().unwrap() else { return };
    let protocol = PairProtocol { current_a: 1.0, ..Default::default() }.protocol().unwrap();
    for case in &extreme.cases {
        let mesh = common::mesh_of(&extreme.mesh_of(case));
        let model = ForwardModel::new(&mesh, &protocol, &case.contact_impedance.to_vec()).unwrap();
        let conductivity = case.conductivity.to_vec();
        let found = match model.forward(&conductivity) {
            Ok(v) => v,
            Err(e) => {
                println!("{:>12}: {e}", case.name);
                continue;
            }
        };
        let largest = case.voltages.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let error = (&found - &case.voltages).iter().fold(0.0_f64, |m, d| m.max(d.abs()));
        println!("{:>12}: {:.1e} of the largest voltage", case.name, error / largest);
        if case.name == "plain" {
            assert!(error < 1e-12 * largest, "{error:e} of {largest:e}");
        }
    }
}
