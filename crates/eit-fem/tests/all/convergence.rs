//! Convergence on generated meshes, graded towards electrode ends.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "tests")]

use crate::common::{largest, paper_voltages};
use eit_fem::{ForwardModel, PairProtocol, Protocol};
use eit_mesh::{Direction, Mesh, MeshSettings, Placement, RimElectrodes, SkinShape, generate};
use ndarray::Array1;

const RADIUS_M: f64 = 0.1;
const WIDTH_M: f64 = 0.0196;
const CONDUCTIVITY_S: f64 = 1e-5;
const IMPEDANCE_OHM_M: f64 = 1e3;
const PITCH_DEG: f64 = 22.5;

fn electrodes(first_angle_deg: f64) -> RimElectrodes {
    let direction = Direction::Counterclockwise;
    let placement = Placement::EquallySpaced { count: 16, first_angle_deg, direction };
    RimElectrodes { width_m: WIDTH_M, placement }
}

fn mesh(nodes: usize, first_angle_deg: f64) -> Mesh {
    let (skin, electrodes) = (SkinShape::Disc { radius_m: RADIUS_M }, electrodes(first_angle_deg));
    // edges at the electrode ends shrink with the others, so the meshes form a similar family
    let ends = WIDTH_M / 4.0 * (500.0 / nodes as f64).sqrt();
    let graded = MeshSettings { electrode_edge_m: Some(ends), ..Default::default() };
    let settings = graded.for_nodes(&skin, &electrodes, nodes).unwrap();
    generate(&skin, &electrodes, &settings).unwrap()
}

fn protocol() -> Protocol {
    PairProtocol::default().protocol().unwrap()
}

fn voltages(mesh: &Mesh, conductivity: impl Fn([f64; 3]) -> f64) -> Array1<f64> {
    let model = ForwardModel::new(mesh, &protocol(), &[IMPEDANCE_OHM_M; 16]).unwrap();
    let values: Vec<f64> = mesh.surface().centroids().into_iter().map(conductivity).collect();
    model.forward(&values).unwrap()
}

/// The paper's disc: errors of all 208 voltages against the mesh-free series.
#[test]
fn voltages_converge_to_the_series_on_generated_meshes() {
    let exact = paper_voltages(16, 4000);
    let change = largest(&((paper_voltages(12, 2000) - &exact) / &exact));
    println!("change of the series: {change:.1e}");
    let (mut nodes, mut errors) = (Vec::new(), Vec::new());
    for wanted in [500, 2000, 8000, 32000] {
        let mesh = mesh(wanted, 0.0);
        let error = (voltages(&mesh, |_| CONDUCTIVITY_S) - &exact) / &exact;
        let count = mesh.surface().nodes().len();
        let span = error.iter().fold([0.0_f64; 2], |[l, h], &e| [l.min(e), h.max(e)]);
        println!("{count} nodes: relative errors from {:.2e} to {:.2e}", span[0], span[1]);
        nodes.push(count as f64);
        errors.push(largest(&error));
    }
    // order in the edge length, which is 1 / sqrt(nodes)
    let orders: Vec<f64> = (1..errors.len())
        .map(|k| 2.0 * (errors[k - 1] / errors[k]).ln() / (nodes[k] / nodes[k - 1]).ln())
        .collect();
    println!("orders {orders:.2?}");
    // P1 voltages converge with order 2. At electrode ends (r log r) a factor log(1/h) reduces the
    // order by 0.1 to 0.2, and meshes of one family differ by chance in how they resolve the ends.
    // The coarsest mesh has gaps of four edges and errors of both signs, so it is left out.
    assert!(orders[1..].iter().all(|o| (o - 2.0).abs() < 0.3), "{orders:?}");
    assert!(errors.is_sorted_by(|a, b| a > b), "{errors:?}");
    assert!(change < 0.05 * errors[3], "the series is the better one: {change:e}");
}

/// A touched skin rotated by one electrode, with its own mesh, has the same voltages one drive
/// later, up to discretisation error.
#[test]
fn turning_the_scene_changes_only_discretisation_error() {
    let touched = |angle_deg: f64| {
        let (sin, cos) = angle_deg.to_radians().sin_cos();
        let centre = [0.05 * cos, 0.05 * sin];
        move |c: [f64; 3]| {
            let square = (c[0] - centre[0]).powi(2) + (c[1] - centre[1]).powi(2);
            CONDUCTIVITY_S * (1.0 + 0.5 * (-square / 4e-4).exp())
        }
    };
    let exact = paper_voltages(12, 2000);
    for nodes in [2000, 8000] {
        let (here, turned) = (mesh(nodes, 0.0), mesh(nodes, PITCH_DEG));
        let error = largest(&(voltages(&here, |_| CONDUCTIVITY_S) - &exact)) / largest(&exact);
        let v = voltages(&here, touched(10.0));
        // electrode 1 of the rotated skin is where electrode 2 was; the touch is rotated too
        let w = voltages(&turned, touched(10.0 + PITCH_DEG));
        let change = largest(&(&w - &v)) / largest(&v);
        println!("{nodes} nodes: turning changes {change:.2e}, error {error:.2e}");
        // without rotating the touch, the voltages differ
        let other = largest(&(voltages(&turned, touched(10.0)) - &v)) / largest(&v);
        println!("   touch left behind: {other:.2e}");
        assert!(change < 2.0 * error, "{change:e} {error:e}");
        assert!(other > 10.0 * change, "{other:e} {change:e}");
    }
}
