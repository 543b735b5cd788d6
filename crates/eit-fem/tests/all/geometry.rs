//! A solve on moved nodes and changed contacts equals that of a model built on the moved mesh.

use crate::common::{
    BOTH, adjacent, deformed, even, model_of, moved, noise, patched_disc, random_conductivity,
    refused, relative, ring_disc, round_disc, uneven,
};
use eit_fem::ForwardModel;

/// Voltages, Jacobian and fields are bit-identical: both perform the same operations, because the
/// ordering depends only on the triangles. Moved back, the geometry is the model's own.
#[test]
fn a_deformed_solve_is_that_of_a_fresh_model_on_the_moved_mesh() {
    for mesh in [ring_disc(8), patched_disc()] {
        let model = ForwardModel::new(&mesh, &adjacent(12), &[0.05; 12]).unwrap();
        let shifts = noise(7, 3 * mesh.surface().nodes().len());
        let mut shifts = shifts.chunks_exact(3);
        // by up to 2 % of the radius in all three directions
        let there = moved(&mesh, |p| {
            let shift = shifts.next().unwrap();
            std::array::from_fn(|k| p[k] + 0.02 * (2.0 * shift[k] - 1.0))
        });
        let (impedance, sigma) = (uneven(3, 12, 0.02), random_conductivity(&model, 5));
        let fresh = ForwardModel::new(&there, &adjacent(12), &impedance).unwrap();

        let mut geometry = model.geometry();
        model.deform(there.surface().nodes(), &impedance, &mut geometry).unwrap();
        let mut workspace = model.workspace().unwrap();
        let mut solution = model.solve_deformed(&geometry, &sigma, &mut workspace).unwrap();
        let mut other = fresh.workspace().unwrap();
        let mut wanted = fresh.solve(&sigma, &mut other).unwrap();
        assert_eq!(solution.measurements(), wanted.measurements());
        assert_eq!(solution.jacobian(), wanted.jacobian());
        assert_eq!(solution.node_potentials(), wanted.node_potentials());
        assert!(solution.report().backward_error < 1e-13, "rounding of one solve");
        // the effect is not negligible: voltages change by some per cent
        let still = model.forward(&sigma).unwrap();
        let change = (&solution.measurements() - &still).mapv(f64::abs).sum();
        assert!(change > 1e-2 * still.mapv(f64::abs).sum());

        model.deform(mesh.surface().nodes(), &[0.05; 12], &mut geometry).unwrap();
        assert_eq!(geometry, model.geometry());
        let back = model.solve_deformed(&geometry, &sigma, &mut workspace).unwrap().measurements();
        assert_eq!(back, still);
    }
}

/// Moving and tilting a skin in space changes nothing; a sheet scaled by t keeps its resistances if
/// contact impedances in ohm metre are scaled by t.
#[test]
fn turning_and_blowing_up() {
    let mesh = round_disc(8);
    let (sin, cos) = 0.7_f64.sin_cos();
    for order in BOTH {
        let model = model_of(&mesh, &adjacent(12), &[0.05; 12], order);
        let still = even(&model, 1.0);
        // one more rounding of positions, at a distance of 3, or three times the size; condition 1e4
        for (scale, away, bound) in [(1.0, 3.0, 1e-12), (3.0, 0.0, 1e-11)] {
            let turned = moved(&mesh, |p| {
                [p[0] + away, cos * p[1] - sin * p[2], sin * p[1] + cos * p[2]].map(|x| scale * x)
            });
            let (nodes, sigma) = (turned.surface().nodes(), vec![1.0; model.elements()]);
            let error = relative(&deformed(&model, nodes, &[0.05 * scale; 12], &sigma), &still);
            assert!(error < bound, "{order:?} {scale}: {error:e}");
        }
    }
}

#[test]
fn what_cannot_be_is_refused() {
    let mesh = ring_disc(8);
    let model = ForwardModel::new(&mesh, &adjacent(12), &[0.05; 12]).unwrap();
    let nodes = mesh.surface().nodes().to_vec();
    let mut geometry = model.geometry();
    let mut says = |nodes: &[[f64; 3]], impedance: &[f64], wanted: &str| {
        refused(model.deform(nodes, impedance, &mut geometry), wanted);
    };
    says(&nodes[1..], &[0.05; 12], "node positions (one per node): 216 values given, 217 needed");
    says(&nodes, &[0.05; 11], "contact impedance");
    let mut impedance = [0.05; 12];
    impedance[4] = f64::NAN;
    says(&nodes, &impedance, "electrode 5 is NaN");
    let mut broken = nodes.clone();
    broken[9][1] = f64::INFINITY;
    says(&broken, &[0.05; 12], "node 9 is moved to");
    let mut flat = nodes.clone();
    let [a, b, _] = mesh.surface().triangles()[20].map(|n| n as usize);
    flat[a] = flat[b];
    says(&flat, &[0.05; 12], "has the area 0e0 m^2");

    let other = ForwardModel::new(&ring_disc(4), &adjacent(12), &[0.05; 12]).unwrap();
    let sigma = vec![1.0; model.elements()];
    let mut workspace = model.workspace().unwrap();
    refused(model.solve_deformed(&other.geometry(), &sigma, &mut workspace), "values given, ");
}
