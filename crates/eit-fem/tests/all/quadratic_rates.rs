//! Orders of convergence of linear and quadratic elements against mesh-free solutions.

use crate::common::{
    CONDUCTIVITY_S, RADIUS_M, even, halving_orders, model_of, paper_electrodes, paper_protocol,
    paper_series, relative, series_voltages,
};
use eit_fem::ElementOrder;
use eit_mesh::{Mesh, MeshSettings, SkinShape, generate};

/// Unequal contact impedances, with a ratio of three to one.
fn impedance() -> Vec<f64> {
    (0..16).map(|l| 500.0 + 1000.0 * f64::from(l * 7 % 16) / 15.0).collect()
}

/// Level `k` of a family of meshes of the paper's disc or a hemisphere, with edges `h = h0 / 2^k`.
/// At electrode ends, where the potential behaves like r log r, edges scale with `h^2` and the grading
/// with `h`: elements at distance r are at most about `h r` in size, as order four requires.
fn graded(shape: &SkinShape, level: i32) -> Mesh {
    let h = 0.5_f64.powi(level);
    // on a hemisphere: the edge length at the pole, twice that of the disc it is mapped from
    let stretch = if matches!(shape, SkinShape::Hemisphere { .. }) { 2.0 } else { 1.0 };
    let edge = MeshSettings::with_edge(0.02 * stretch * h);
    let settings = MeshSettings { electrode_edge_m: Some(0.005 * h * h), grading: 0.4 * h, ..edge };
    generate(shape, &paper_electrodes(), &settings).unwrap()
}

/// Stereographic projection preserves angles, and on the equator lengths. So a hemisphere with
/// electrodes on its equator has the voltages of the flat disc, if elements follow the sphere.
#[test]
fn paper_disc_and_hemisphere_with_uneven_contacts() {
    let [fewer_terms, exact] = [(16, 4_000), (20, 8_000)].map(|(degree, harmonics)| {
        series_voltages(&paper_series(degree, harmonics), &paper_protocol(), &impedance())
    });
    let change = relative(&fewer_terms, &exact);
    for shape in
        [SkinShape::Disc { radius_m: RADIUS_M }, SkinShape::Hemisphere { radius_m: RADIUS_M }]
    {
        let meshes = [0, 1, 2].map(|level| graded(&shape, level));
        for (order, least) in [(ElementOrder::Linear, 1.8), (ElementOrder::Quadratic, 3.8)] {
            let errors = meshes.each_ref().map(|mesh| {
                let model = model_of(mesh, &paper_protocol(), &impedance(), order);
                relative(&even(&model, CONDUCTIVITY_S), &exact)
            });
            let orders = halving_orders(&errors);
            println!("{shape:?}, {order:?}: errors {errors:?}, orders {orders:?}");
            // the coarsest mesh has one edge between electrode ends: its error may be too large
            assert!(orders.iter().all(|order| *order > least), "{order:?}: {orders:?}");
            assert!(change < 0.1 * errors[2], "the series is the better one: {change:e}");
        }
    }
}
