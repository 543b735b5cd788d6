//! Forward problem and Jacobian: error of the voltages over time, mesh by mesh.
//!
//! The error is that of the untouched skin's voltages, the largest over the largest value, against
//! the mesh-free series where there is one (a disc with equal contacts), else against a mesh of
//! [`REFERENCE_NODES`] nodes, whose own error the table cannot tell.

use super::Size;
use super::floor::Floors;
use super::point::Spread;
use crate::error::CliError;
use crate::pipeline::{self, series};
use crate::progress::Progress;
use crate::scene::Scene;
use ndarray::Array1;
use std::time::Instant;

/// Nodes of the mesh that stands for the truth where no series does.
const REFERENCE_NODES: usize = 80_000;

/// Degree of the series: four digits more than the finest mesh.
const SERIES_DEGREE: usize = 24;

/// A mesh and what its voltages cost.
#[derive(Debug, Clone)]
pub(super) struct ForwardPoint {
    pub nodes: usize,
    pub elements: usize,
    /// Factorisation, voltages and Jacobian, seconds.
    pub time: Spread,
    pub floor_s: f64,
    /// Largest error of a voltage over the largest voltage.
    pub error: f64,
}

/// A scene's meshes.
#[derive(Debug, Clone)]
pub(super) struct ForwardCourse {
    /// What the error is against.
    pub reference: String,
    pub points: Vec<ForwardPoint>,
}

/// Runs all meshes of a scene.
pub(super) fn course(
    scene: &Scene,
    size: &Size,
    floors: &Floors,
    bar: &indicatif::ProgressBar,
) -> Result<ForwardCourse, CliError> {
    let mut silent = Progress::silent();
    let coarse = pipeline::setup(scene, None, None, &mut silent)?;
    let (exact, reference) = match series::disc_voltages(scene, &coarse, SERIES_DEGREE)? {
        Some(voltages) => (voltages, "the mesh-free series".to_owned()),
        None => {
            let nodes = REFERENCE_NODES.min(20 * size.nodes.iter().max().unwrap_or(&1));
            let fine = pipeline::setup(scene, None, Some(nodes), &mut silent)?;
            let background = vec![scene.skin.conductivity_s; fine.model.elements()];
            let voltages = fine.model.forward(&background)?;
            let count = fine.mesh.surface().nodes().len();
            (voltages, format!("a mesh of {count} nodes"))
        }
    };
    let largest = exact.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let mut points = Vec::new();
    for &nodes in size.nodes {
        bar.inc(1);
        let setup = match pipeline::setup(scene, None, Some(nodes), &mut silent) {
            Ok(setup) => setup,
            // too coarse for the electrodes of this scene
            Err(CliError::Input(_)) => continue,
            Err(error) => return Err(error),
        };
        let background = vec![scene.skin.conductivity_s; setup.model.elements()];
        let mut workspace = setup.model.workspace()?;
        let (mut seconds, mut voltages) = (Vec::new(), Array1::zeros(0));
        for _ in 0..size.forward_runs {
            let start = Instant::now();
            let mut solution = setup.model.solve(&background, &mut workspace)?;
            voltages = solution.measurements();
            let jacobian = solution.jacobian();
            seconds.push(start.elapsed().as_secs_f64());
            drop(jacobian);
        }
        let off = voltages.iter().zip(&exact).fold(0.0_f64, |m, (v, e)| m.max((v - e).abs()));
        let sizes = [setup.protocol.measurements(), setup.model.elements()];
        points.push(ForwardPoint {
            nodes: setup.mesh.surface().nodes().len(),
            elements: setup.model.elements(),
            time: Spread::of(seconds, 1),
            floor_s: floors.forward(&setup.model.cost(), sizes),
            error: off / largest,
        });
    }
    Ok(ForwardCourse { reference, points })
}
