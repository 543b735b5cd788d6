//! Linear and quadratic elements on the paper's disc: error of the voltages against the mesh-free
//! series, over unknowns and over time, on three families of meshes. Writes the table of
//! `docs/PERFORMANCE.md`.
//!
//! Usage: `elements [--dry-run]`: prints the table instead.
#![allow(clippy::print_stdout, reason = "a program's output")]

use benches::document::{self, digits};
use benches::{Result, stopwatch};
use eit_fem::analytic::DiscSeries;
use eit_fem::{Elements, ForwardModel, PairProtocol, Protocol};
use eit_mesh::{Direction, Mesh, MeshSettings, Placement, RimElectrodes, SkinShape, generate};
use ndarray::{Array1, Array2};

const RADIUS_M: f64 = 0.1;
const WIDTH_M: f64 = 0.0196;
const CONDUCTIVITY_S: f64 = 1e-5;
const IMPEDANCE_OHM_M: f64 = 1e3;

/// A family of meshes; each is finer than the one before by the root of two.
struct Family {
    name: &'static str,
    /// Settings for the scale `2^(-k/2)`.
    settings: fn(f64) -> MeshSettings,
    /// Kinds of elements, and how many meshes of the family they are tried on.
    tried: &'static [(Elements, i32)],
}

const FAMILIES: [Family; 3] = [
    Family {
        name: "even",
        settings: |h| MeshSettings {
            edge_m: Some(0.0098 * h),
            electrode_edge_m: Some(0.0098 * h),
            ..Default::default()
        },
        tried: &[(Elements::Linear, 7), (Elements::Quadratic, 6)],
    },
    Family {
        name: "graded",
        settings: |h| MeshSettings {
            edge_m: Some(0.02 * h),
            electrode_edge_m: Some(0.005 * h),
            ..Default::default()
        },
        tried: &[(Elements::Linear, 8), (Elements::Quadratic, 7)],
    },
    Family {
        name: "graded more",
        settings: |h| MeshSettings {
            edge_m: Some(0.02 * h),
            electrode_edge_m: Some(0.005 * h * h),
            grading: 0.4 * h,
            ..Default::default()
        },
        tried: &[(Elements::Linear, 6), (Elements::Quadratic, 6)],
    },
];

fn main() -> Result<()> {
    let protocol = PairProtocol::default().protocol()?;
    let exact = series(&protocol, 28, 16_000)?;
    let change = largest(&(series(&protocol, 24, 12_000)? - &exact)) / largest(&exact);
    let mut rows = Vec::new();
    for family in &FAMILIES {
        for &(elements, count) in family.tried {
            for k in 0..count {
                rows.push(row(family, elements, k, &protocol, &exact)?);
            }
        }
    }
    let load = document::load().map_or_else(String::new, |l| format!("; load average {l:.1}"));
    let body = format!(
        "{}{load}. One thread, CPU time, medians of 9 runs; error: the largest over the largest \
         voltage, against the series (which changes by {change:.0e} with more terms).\n\n\
         | elements | mesh | nodes | unknowns | factor, MFLOP | forward, ms | with Jacobian, ms | \
         error |\n|---|---|---|---|---|---|---|---|\n{}",
        document::machine(),
        rows.concat()
    );
    if std::env::args().any(|a| a == "--dry-run") {
        println!("{body}");
        return Ok(());
    }
    document::write("elements", &body)
}

fn row(
    family: &Family,
    elements: Elements,
    k: i32,
    protocol: &Protocol,
    exact: &Array1<f64>,
) -> Result<String> {
    let settings = (family.settings)(0.5_f64.powf(0.5 * f64::from(k)));
    let mesh = disc(&settings)?;
    let model = ForwardModel::with_elements(&mesh, protocol, &[IMPEDANCE_OHM_M; 16], elements)?;
    let sigma = vec![CONDUCTIVITY_S; model.elements()];
    let mut workspace = model.workspace()?;
    let mut voltages = vec![0.0; protocol.measurements()];
    let forward = stopwatch::median(9, || {
        Ok(model.solve(&sigma, &mut workspace)?.measurements_into(&mut voltages)?)
    })?;
    let mut jacobian = Array2::zeros((protocol.measurements(), model.elements()));
    let both = stopwatch::median(9, || {
        Ok(model.solve(&sigma, &mut workspace)?.jacobian_into(jacobian.view_mut())?)
    })?;
    let error = largest(&(Array1::from(voltages) - exact)) / largest(exact);
    let cost = model.cost();
    Ok(format!(
        "| {} | {} | {} | {} | {} | {} | {} | {error:.1e} |\n",
        match elements {
            Elements::Linear => "linear",
            Elements::Quadratic => "quadratic",
        },
        family.name,
        mesh.surface().nodes().len(),
        cost.unknowns,
        digits(1e-6 * cost.factor_flops),
        digits(1e3 * forward.cpu_s),
        digits(1e3 * both.cpu_s),
    ))
}

fn disc(settings: &MeshSettings) -> Result<Mesh> {
    let direction = Direction::Counterclockwise;
    let placement = Placement::EquallySpaced { count: 16, first_angle_deg: 0.0, direction };
    let electrodes = RimElectrodes { width_m: WIDTH_M, placement };
    Ok(generate(&SkinShape::Disc { radius_m: RADIUS_M }, &electrodes, settings)?)
}

fn series(protocol: &Protocol, degree: usize, harmonics: usize) -> Result<Array1<f64>> {
    let series = DiscSeries {
        radius_m: RADIUS_M,
        conductivity_s: CONDUCTIVITY_S,
        electrode_angles_rad: (0..16).map(|l| (22.5 * f64::from(l)).to_radians()).collect(),
        electrode_width_m: WIDTH_M,
        contact_impedance_ohm_m: IMPEDANCE_OHM_M,
        degree,
        harmonics,
    };
    let potentials = series.electrode_potentials(protocol.stimulations_a())?;
    let patterns = protocol.measurement_patterns();
    let voltage = |&[s, m]: &[u32; 2]| potentials.row(s as usize).dot(&patterns.row(m as usize));
    Ok(protocol.data().iter().map(voltage).collect())
}

fn largest(values: &Array1<f64>) -> f64 {
    values.iter().fold(0.0, |m, v| m.max(v.abs()))
}
