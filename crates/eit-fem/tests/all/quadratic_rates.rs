//! Orders of convergence of linear and quadratic elements against mesh-free solutions.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests")]

use crate::common::{largest, paper_series, series_voltages};
use eit_fem::{ElementOrder, ForwardModel, PairProtocol, Protocol};
use eit_mesh::{Direction, Mesh, MeshSettings, Placement, RimElectrodes, SkinShape, generate};
use ndarray::Array1;

const RADIUS_M: f64 = 0.1;
const WIDTH_M: f64 = 0.0196;
const CONDUCTIVITY_S: f64 = 1e-5;

/// Unequal contact impedances, with a ratio of three to one.
fn impedance() -> Vec<f64> {
    (0..16).map(|l| 500.0 + 1000.0 * f64::from(l * 7 % 16) / 15.0).collect()
}

fn electrodes() -> RimElectrodes {
    let direction = Direction::Counterclockwise;
    let placement = Placement::EquallySpaced { count: 16, first_angle_deg: 0.0, direction };
    RimElectrodes { width_m: WIDTH_M, placement }
}

/// Level `k` of a family of meshes of the paper's disc or a hemisphere, with edges `h = h0 / 2^k`.
/// At electrode ends, where the potential behaves like r log r, edges scale with `h^2` and the
/// grading with `h`: elements at distance r are at most about `h r` in size, as order four
/// requires.
fn graded(shape: &SkinShape, level: i32) -> Mesh {
    let h = 0.5_f64.powi(level);
    // on a hemisphere: the edge length at the pole, twice that of the disc it is mapped from
    let stretch = if matches!(shape, SkinShape::Hemisphere { .. }) { 2.0 } else { 1.0 };
    let settings = MeshSettings {
        edge_m: Some(0.02 * stretch * h),
        electrode_edge_m: Some(0.005 * h * h),
        grading: 0.4 * h,
        ..Default::default()
    };
    generate(shape, &electrodes(), &settings).unwrap()
}

fn protocol() -> Protocol {
    PairProtocol::default().protocol().unwrap()
}

fn voltages(mesh: &Mesh, elements: ElementOrder) -> Array1<f64> {
    let model =
        ForwardModel::with_element_order(mesh, &protocol(), &impedance(), elements).unwrap();
    model.forward(&vec![CONDUCTIVITY_S; model.elements()]).unwrap()
}

/// Checks the convergence orders of linear and quadratic elements on levels 0, 1, 2 and so on;
/// returns the last error of the quadratic elements.
fn check_orders(meshes: &[Mesh], exact: &Array1<f64>) -> f64 {
    let mut last = 0.0;
    for (elements, least) in [(ElementOrder::Linear, 1.8), (ElementOrder::Quadratic, 3.8)] {
        let error = |mesh| largest(&(voltages(mesh, elements) - exact)) / largest(exact);
        let errors: Vec<f64> = meshes.iter().map(error).collect();
        let orders: Vec<f64> = errors.windows(2).map(|e| (e[0] / e[1]).log2()).collect();
        println!("{elements:?}: errors {errors:?}, orders {orders:?}");
        // the coarsest mesh has one edge between electrode ends, so its error may not follow the
        // others
        assert!(orders.iter().all(|order| *order > least), "{elements:?}: {orders:?}");
        last = errors[errors.len() - 1];
    }
    last
}

#[test]
fn paper_disc_with_uneven_contacts() {
    let series = |degree, harmonics| {
        series_voltages(&paper_series(degree, harmonics), &protocol(), &impedance())
    };
    let exact = series_voltages(&paper_series(20, 8_000), &protocol(), &impedance());
    let change = largest(&(series(16, 4_000) - &exact)) / largest(&exact);
    let disc = SkinShape::Disc { radius_m: RADIUS_M };
    let meshes: Vec<Mesh> = (0..3).map(|level| graded(&disc, level)).collect();
    let error = check_orders(&meshes, &exact);
    println!("change of the series: {change:.1e}");
    assert!(change < 0.1 * error, "the series is the better one: {change:e}");
}

/// Stereographic projection preserves angles, and on the equator lengths. So a hemisphere with
/// electrodes on its equator has the voltages of the flat disc, if elements follow the sphere.
#[test]
fn hemisphere_has_the_voltages_of_the_disc() {
    let exact = series_voltages(&paper_series(20, 8_000), &protocol(), &impedance());
    let dome = SkinShape::Hemisphere { radius_m: RADIUS_M };
    let meshes: Vec<Mesh> = (0..3).map(|level| graded(&dome, level)).collect();
    check_orders(&meshes, &exact);
}
