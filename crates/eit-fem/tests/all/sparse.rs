//! Public interface of the sparse factorisation, on the matrix of a model.

use crate::common::{adjacent, ring_disc};
use eit_fem::sparse::{Cholesky, Factor, SparseError};
use eit_fem::{FemError, ForwardModel, SystemMatrix};

const ELECTRODES: usize = 12;

fn model(rings: usize, impedance: f64) -> ForwardModel {
    ForwardModel::new(&ring_disc(rings), &adjacent(ELECTRODES), &[impedance; ELECTRODES]).unwrap()
}

fn matrix(model: &ForwardModel) -> SystemMatrix {
    model.system_matrix(&vec![1.0; model.elements()]).unwrap()
}

/// `A x` with the full symmetric matrix.
fn product(matrix: &SystemMatrix, x: &[f64]) -> Vec<f64> {
    let (starts, rows) = (matrix.pattern.column_starts(), matrix.pattern.rows());
    let mut y = vec![0.0; x.len()];
    for column in 0..matrix.pattern.unknowns() {
        let entries = starts[column] as usize..starts[column + 1] as usize;
        for (&row, value) in rows[entries.clone()].iter().zip(&matrix.values[entries]) {
            let row = row as usize;
            y[row] += value * x[column];
            if row != column {
                y[column] += value * x[row];
            }
        }
    }
    y
}

/// All unknowns, against faer's solution of the same matrix: `solutions_agree_with_those_of_faer` of the
/// benches.
#[test]
fn solves_the_matrix_of_a_model_as_the_model_does() {
    let model = model(8, 0.01);
    let matrix = matrix(&model);
    let unknowns = matrix.pattern.unknowns();
    assert_eq!(unknowns - matrix.nodes, ELECTRODES - 1);
    let cholesky = Cholesky::new(&matrix.pattern, matrix.nodes).unwrap();
    let mut factor = cholesky.memory().unwrap();
    cholesky.factorise(&matrix.values, &mut factor, 1.0).unwrap();
    // the first stimulation: current in at electrode 1, out at electrode 2
    let mut x = vec![f64::NAN; unknowns];
    x[matrix.nodes..].fill(0.0);
    (x[matrix.nodes], x[matrix.nodes + 1]) = (1.0, -1.0);
    cholesky.solve(&mut factor, &mut x, 1).unwrap();
    for (k, value) in product(&matrix, &x).iter().enumerate() {
        let wanted = k.checked_sub(matrix.nodes).map_or(0.0, |l| [1.0, -1.0, 0.0][l.min(2)]);
        // contact terms are about 100: a few roundings of them
        assert!((value - wanted).abs() < 1e-12, "{k}: {value}, not {wanted}");
    }
    let mut workspace = model.workspace().unwrap();
    let conductivity_s = vec![1.0; model.elements()];
    let potentials_v = model.solve(&conductivity_s, &mut workspace).unwrap().electrode_potentials();
    // rows of the model sum to zero; here the last electrode is at zero
    let ground_v = potentials_v[[0, ELECTRODES - 1]];
    for (l, found) in x[matrix.nodes..].iter().enumerate() {
        let wanted = potentials_v[[0, l]] - ground_v;
        // two solve paths with the same factor
        assert!((found - wanted).abs() < 1e-12, "electrode {l}: {found}, not {wanted}");
    }
}

#[test]
fn names_what_does_not_fit() {
    let (small, large) = (matrix(&model(4, 0.01)), matrix(&model(8, 0.01)));
    let unknowns = small.pattern.unknowns();
    let none_left = Cholesky::new(&small.pattern, unknowns).map(|_| ());
    assert_eq!(none_left, Err(SparseError::NoTrailingUnknowns { leading: unknowns, unknowns }));
    let cholesky = Cholesky::new(&small.pattern, small.nodes).unwrap();
    let mut factor: Factor = cholesky.memory().unwrap();
    let wrong =
        |found: Result<(), SparseError>| matches!(found, Err(SparseError::WrongLength { .. }));
    assert!(wrong(cholesky.factorise(&large.values, &mut factor, 1.0)));
    assert!(wrong(cholesky.solve(&mut factor, &mut vec![0.0; unknowns + 1], 1)));
    let other = Cholesky::new(&large.pattern, large.nodes).unwrap();
    assert!(wrong(other.factorise(&large.values, &mut factor, 1.0)));
    assert!(wrong(other.solve(&mut factor, &mut vec![0.0; large.pattern.unknowns()], 1)));
}

#[test]
fn names_the_unknown_whose_pivot_is_not_positive() {
    let mut matrix = matrix(&model(4, 0.01));
    let unknowns = matrix.pattern.unknowns();
    let cholesky = Cholesky::new(&matrix.pattern, matrix.nodes).unwrap();
    let mut factor = cholesky.memory().unwrap();
    *matrix.values.last_mut().unwrap() = -1.0;
    let error = SparseError::BadPivot { unknown: unknowns - 1, unknowns };
    assert_eq!(cholesky.factorise(&matrix.values, &mut factor, 1.0), Err(error));
    let of_a_model = FemError::NotPositiveDefinite { unknown: unknowns - 1, unknowns };
    assert_eq!(FemError::from(error), of_a_model);
}

#[test]
fn shunts_and_wrong_counts_have_no_system_matrix() {
    let shunt = model(4, 0.0);
    let found = shunt.system_matrix(&vec![1.0; shunt.elements()]);
    assert!(matches!(found, Err(FemError::OutOfRange { value: 0.0, .. })), "{found:?}");
    let found = model(4, 0.01).system_matrix(&[1.0]);
    assert!(matches!(found, Err(FemError::WrongLength { found: 1, .. })), "{found:?}");
}
