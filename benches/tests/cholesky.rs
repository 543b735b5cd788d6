//! Our factorisation and faer's give the same solutions.
#![allow(clippy::unwrap_used, reason = "tests")]

use benches::faer_cholesky::{COLUMNS, FaerCholesky, Order};
use benches::problem::{self, currents};
use eit_fem::SystemMatrix;
use eit_fem::sparse::Cholesky;
use eit_mesh::generate;
use faer::Mat;

fn matrix(nodes: usize) -> SystemMatrix {
    let (shape, electrodes) = problem::disc();
    let mesh = generate(&shape, &electrodes, &problem::mesh_settings(nodes).unwrap()).unwrap();
    let model = problem::model(&mesh).unwrap();
    model.system_matrix(&problem::conductivity(model.elements())).unwrap()
}

fn ours(matrix: &SystemMatrix) -> Vec<f64> {
    let cholesky = Cholesky::new(&matrix.pattern, matrix.nodes).unwrap();
    let mut factor = cholesky.memory().unwrap();
    cholesky.factorise(&matrix.values, &mut factor, 1.0).unwrap();
    let mut x = vec![0.0; matrix.pattern.unknowns() * COLUMNS];
    let rows = x[matrix.nodes * COLUMNS..].chunks_exact_mut(COLUMNS);
    rows.zip(currents()).for_each(|(row, currents)| row.copy_from_slice(&currents));
    cholesky.solve(&mut factor, &mut x, COLUMNS).unwrap();
    x
}

fn faers(matrix: &SystemMatrix, order: Order) -> Mat<f64> {
    let mut faer = FaerCholesky::new(matrix, order).unwrap();
    faer.factorise(&matrix.values).unwrap();
    let mut x = Mat::zeros(matrix.pattern.unknowns(), COLUMNS);
    for (k, currents) in currents().enumerate() {
        (0..COLUMNS).for_each(|c| x[(matrix.nodes + k, c)] = currents[c]);
    }
    faer.solve(x.as_mut());
    x
}

/// Largest difference divided by the largest potential.
fn difference(ours: &[f64], faers: &Mat<f64>) -> f64 {
    let pairs = || {
        let rows = ours.chunks_exact(COLUMNS).enumerate();
        rows.flat_map(|(i, row)| row.iter().enumerate().map(move |(c, x)| (*x, faers[(i, c)])))
    };
    let largest = pairs().fold(0.0_f64, |m, (x, _)| m.max(x.abs()));
    pairs().fold(0.0_f64, |m, (x, y)| m.max((x - y).abs())) / largest
}

/// The condition numbers are 4.8e4 and 4.3e5 (power iteration with the matrix and its inverse). A
/// backward stable factorisation has an error of the condition number times the roundoff, half of
/// `EPSILON`, and two of them differ by at most twice that. The measured difference is 1.3e-13.
#[test]
fn solutions_agree_with_those_of_faer() {
    for (nodes, condition) in [(2000, 4.8e4), (20000, 4.3e5)] {
        let matrix = matrix(nodes);
        let ours = ours(&matrix);
        for order in [Order::Own, Order::Given] {
            let found = difference(&ours, &faers(&matrix, order));
            assert!(found < condition * f64::EPSILON, "{nodes} nodes, {order:?}: {found:e}");
        }
    }
}
