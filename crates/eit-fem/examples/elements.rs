//! Linear and quadratic elements on the paper's disc: error of the voltages against the mesh-free
//! series, with unknowns and time, on three families of meshes (the table in
//! `docs/performance/forward.md`).
//!
//! Run with `cargo run --release -p eit-fem --example elements`.
#![allow(missing_docs, reason = "an example is read, not linked against")]
#![allow(clippy::print_stdout, reason = "an example shows its result")]

use eit_fem::analytic::DiscSeries;
use eit_fem::{ElementOrder, ForwardModel, PairProtocol, Protocol};
use eit_mesh::{Direction, Mesh, MeshSettings, Placement, RimElectrodes, SkinShape, generate};
use ndarray::{Array1, Array2};
use std::error::Error;
use std::time::Instant;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

const RADIUS_M: f64 = 0.1;
const WIDTH_M: f64 = 0.0196;
const CONDUCTIVITY_S: f64 = 1e-5;
const IMPEDANCE_OHM_M: f64 = 1e3;

/// A family of meshes; the edge length falls by sqrt(2) from each to the next.
struct Family {
    name: &'static str,
    /// Settings for the scale `2^(-k/2)`.
    settings: fn(f64) -> MeshSettings,
    /// Element orders, and the number of meshes that each is tried on.
    tried: &'static [(ElementOrder, i32)],
}

const FAMILIES: [Family; 3] = [
    Family {
        name: "even",
        settings: |h| MeshSettings {
            edge_m: Some(0.0098 * h),
            electrode_edge_m: Some(0.0098 * h),
            ..Default::default()
        },
        tried: &[(ElementOrder::Linear, 7), (ElementOrder::Quadratic, 6)],
    },
    Family {
        name: "graded",
        settings: |h| MeshSettings {
            edge_m: Some(0.02 * h),
            electrode_edge_m: Some(0.005 * h),
            ..Default::default()
        },
        tried: &[(ElementOrder::Linear, 8), (ElementOrder::Quadratic, 7)],
    },
    Family {
        name: "graded more",
        settings: |h| MeshSettings {
            edge_m: Some(0.02 * h),
            electrode_edge_m: Some(0.005 * h * h),
            grading: 0.4 * h,
            ..Default::default()
        },
        tried: &[(ElementOrder::Linear, 6), (ElementOrder::Quadratic, 6)],
    },
];

/// Prints the table with at most `meshes` meshes per family and the shortest of `repeats` times.
/// Returns the smallest error of each element order.
pub(crate) fn run(meshes: i32, repeats: usize) -> Result<[f64; 2]> {
    let protocol = PairProtocol::default().protocol()?;
    let exact = series(&protocol)?;
    println!(
        "| elements | mesh | nodes | unknowns | factor, MFLOP | forward, ms | with Jacobian, ms | error |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    let mut least = [f64::INFINITY; 2];
    for family in &FAMILIES {
        for (&(elements, count), least) in family.tried.iter().zip(&mut least) {
            for k in 0..count.min(meshes) {
                let mesh = disc(&(family.settings)(0.5_f64.powf(0.5 * f64::from(k))))?;
                let impedance = [IMPEDANCE_OHM_M; 16];
                let model =
                    ForwardModel::with_element_order(&mesh, &protocol, &impedance, elements)?;
                let (voltages, [forward_s, both_s]) = solve(&model, repeats)?;
                let error = largest(&(&voltages - &exact)) / largest(&exact);
                *least = least.min(error);
                println!(
                    "| {elements:?} | {} | {} | {} | {:.2} | {:.2} | {:.2} | {error:.1e} |",
                    family.name,
                    mesh.surface().nodes().len(),
                    model.cost().unknowns,
                    1e-6 * model.cost().factor_flops,
                    1e3 * forward_s,
                    1e3 * both_s
                );
            }
        }
    }
    Ok(least)
}

/// Returns the voltages and the shortest times of a forward solve without and with the Jacobian,
/// seconds.
fn solve(model: &ForwardModel, repeats: usize) -> Result<(Array1<f64>, [f64; 2])> {
    let sigma = vec![CONDUCTIVITY_S; model.elements()];
    let mut workspace = model.workspace()?;
    let measurements = model.protocol().measurements();
    let mut voltages = vec![0.0; measurements];
    let mut jacobian = Array2::zeros((measurements, model.elements()));
    let mut times_s = [f64::INFINITY; 2];
    for _ in 0..repeats {
        let start = Instant::now();
        let mut solution = model.solve(&sigma, &mut workspace)?;
        solution.measurements_into(&mut voltages)?;
        times_s[0] = times_s[0].min(start.elapsed().as_secs_f64());
        solution.jacobian_into(jacobian.view_mut())?;
        times_s[1] = times_s[1].min(start.elapsed().as_secs_f64());
    }
    Ok((Array1::from(voltages), times_s))
}

fn main() -> Result<()> {
    run(8, 15).map(|_| ())
}

fn disc(settings: &MeshSettings) -> Result<Mesh> {
    let direction = Direction::Counterclockwise;
    let placement = Placement::EquallySpaced { count: 16, first_angle_deg: 0.0, direction };
    let electrodes = RimElectrodes { width_m: WIDTH_M, placement };
    Ok(generate(&SkinShape::Disc { radius_m: RADIUS_M }, &electrodes, settings)?)
}

fn series(protocol: &Protocol) -> Result<Array1<f64>> {
    let series = DiscSeries {
        radius_m: RADIUS_M,
        conductivity_s: CONDUCTIVITY_S,
        electrode_angles_rad: (0..16).map(|l| (22.5 * f64::from(l)).to_radians()).collect(),
        electrode_width_m: WIDTH_M,
        contact_impedance_ohm_m: IMPEDANCE_OHM_M,
        degree: 20,
        harmonics: 8_000,
    };
    let potentials = series.electrode_potentials(protocol.stimulations_a())?;
    let patterns = protocol.measurement_patterns();
    let voltage = |&[s, m]: &[u32; 2]| potentials.row(s as usize).dot(&patterns.row(m as usize));
    Ok(protocol.data().iter().map(voltage).collect())
}

fn largest(values: &Array1<f64>) -> f64 {
    values.iter().fold(0.0, |m, v| m.max(v.abs()))
}
