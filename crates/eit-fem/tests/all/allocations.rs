//! After the first solve with a workspace, solves do not allocate, with elements of either order.

use crate::common::{BOTH, adjacent, model_of, random_conductivity, round_disc};
use allocation_counter::measure;
use ndarray::Array2;
use std::hint::black_box;

#[test]
fn solves_on_moved_nodes_allocate_nothing() {
    let (mesh, protocol) = (round_disc(8), adjacent(12));
    for elements in BOTH {
        let model = model_of(&mesh, &protocol, &[0.05; 12], elements);
        let (mut workspace, mut geometry) = (model.workspace().unwrap(), model.geometry());
        let mut nodes = mesh.surface().nodes().to_vec();
        let mut voltages = vec![0.0; protocol.measurements()];
        let mut jacobian = Array2::zeros((protocol.measurements(), model.elements()));
        let mut frame = |seed: u64| {
            let sigma = random_conductivity(&model, seed);
            nodes.iter_mut().for_each(|p| p[0] *= 1.001);
            measure(|| {
                model.deform(&nodes, &[0.06; 12], &mut geometry).unwrap();
                let mut solution = model.solve_deformed(&geometry, &sigma, &mut workspace).unwrap();
                solution.measurements_into(&mut voltages).unwrap();
                solution.jacobian_into(jacobian.view_mut()).unwrap();
            })
            .count_total
        };
        frame(1);
        assert_eq!((2..5).map(frame).collect::<Vec<_>>(), [0, 0, 0], "{elements:?}");
    }
    // check that the counter works
    assert!(measure(|| drop(black_box(vec![0_u8; 100]))).count_total > 0);
}
