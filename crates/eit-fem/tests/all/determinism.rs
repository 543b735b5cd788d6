//! The same input gives bit-identical results: repeated, in reused memory, on other threads.

use crate::common::{BOTH, adjacent, model_of, random_conductivity, round_disc, uneven};
use eit_fem::{ElementOrder, ForwardModel, Protocol, Solution, Workspace};
use ndarray::{Array1, Array2};

fn model(order: ElementOrder) -> ForwardModel {
    model_of(&round_disc(4), &adjacent(12), &uneven(7, 12, 0.01), order)
}

fn everything(
    model: &ForwardModel,
    seed: u64,
    workspace: &mut Workspace,
) -> (Array1<f64>, Array2<f64>, Array2<f64>) {
    let mut solution = model.solve(&random_conductivity(model, seed), workspace).unwrap();
    (solution.measurements(), solution.node_potentials(), solution.jacobian())
}

/// Reused memory and a model that is rebuilt or copied give the same bits.
#[test]
fn a_used_workspace_gives_the_bits_of_a_fresh_one() {
    for order in BOTH {
        let (model, rebuilt) = (model(order), model(order));
        let copy = model.clone();
        let mut used = model.workspace().unwrap();
        for seed in [1, 2, 1] {
            let fresh = everything(&model, seed, &mut model.workspace().unwrap());
            assert_eq!(everything(&model, seed, &mut used), fresh);
            assert_eq!(everything(&rebuilt, seed, &mut used), fresh);
            assert_eq!(everything(&copy, seed, &mut used), fresh);
        }
    }
}

#[test]
fn answers_do_not_depend_on_the_questions_before_them() {
    let model = model(ElementOrder::Linear);
    let mut workspace = model.workspace().unwrap();
    let wanted = everything(&model, 3, &mut workspace);
    let mut solution = model.solve(&random_conductivity(&model, 3), &mut workspace).unwrap();
    let first = solution.report();
    assert_eq!(solution.jacobian(), wanted.2);
    assert_eq!(solution.measurements(), wanted.0);
    let mut voltages = vec![f64::NAN; wanted.0.len()];
    solution.measurements_into(&mut voltages).unwrap();
    assert_eq!(voltages, wanted.0.to_vec());
    let mut transposed = Array2::from_elem((model.elements(), voltages.len()), f64::NAN);
    solution.jacobian_into(transposed.view_mut().reversed_axes()).unwrap();
    assert_eq!(transposed.t(), wanted.2);
    assert_eq!(solution.report(), first);
}

#[test]
fn threads_that_share_a_model_give_the_bits_of_one_thread() {
    fn shared<T: Send + Sync>() {}
    fn sent<T: Send>() {}
    shared::<(ForwardModel, Protocol)>();
    sent::<(Workspace, Solution<'_>)>();
    let model = &model(ElementOrder::Linear);
    let alone: Vec<_> =
        (0..8).map(|seed| everything(model, seed, &mut model.workspace().unwrap())).collect();
    let together: Vec<_> = std::thread::scope(|scope| {
        let work = |part: u64| {
            move || -> Vec<_> {
                let mut workspace = model.workspace().unwrap();
                (4 * part..4 * part + 4).map(|s| everything(model, s, &mut workspace)).collect()
            }
        };
        let threads = [0, 1].map(|part| scope.spawn(work(part)));
        threads.into_iter().flat_map(|t| t.join().unwrap()).collect()
    });
    assert_eq!(together, alone);
}
