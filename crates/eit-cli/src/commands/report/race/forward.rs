//! Forward problem and Jacobian: error of the voltages over time, mesh by mesh.
//!
//! The error is that of the untouched skin's voltages, the largest over the largest value, against
//! the mesh-free series where there is one (a disc with equal contacts), else against a mesh of
//! [`REFERENCE_NODES`] nodes, whose own error the table cannot tell.

use super::Size;
use super::floor::Floors;
use super::peers;
use super::point::Spread;
use crate::error::CliError;
use crate::pipeline::{self, series};
use crate::progress::Progress;
use crate::scene::Scene;
use ndarray::Array1;
use std::path::Path;
use std::time::Instant;

/// Nodes of the mesh that stands for the truth where no series does.
const REFERENCE_NODES: usize = 80_000;

/// Degree of the series: four digits more than the finest mesh.
const SERIES_DEGREE: usize = 24;

/// Largest mesh that the peers solve on: pyEIT takes seconds there.
const PEER_NODES: usize = 2_000;

/// A mesh and what its voltages cost.
#[derive(Debug, Clone)]
pub(super) struct ForwardPoint {
    /// Who solved.
    pub solver: String,
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
    /// Peers that did not run, and why.
    pub failures: Vec<String>,
}

/// Runs all meshes of a scene.
pub(super) fn course(
    scene: &Scene,
    (size, python): (&Size, Option<&Path>),
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
    let worst = |voltages: &Array1<f64>| {
        voltages.iter().zip(&exact).fold(0.0_f64, |m, (v, e)| m.max((v - e).abs()))
    };
    let (mut points, mut failures) = (Vec::new(), Vec::new());
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
        let sizes = [setup.protocol.measurements(), setup.model.elements()];
        let (nodes_found, elements) = (setup.mesh.surface().nodes().len(), setup.model.elements());
        let peers = match python {
            Some(python) if nodes <= PEER_NODES => peers::forward(python, scene, &setup)
                .unwrap_or_else(|error| {
                    failures.push(error.to_string());
                    Vec::new()
                }),
            _ => Vec::new(),
        };
        points.extend(peers.into_iter().map(|peer| ForwardPoint {
            solver: peer.name,
            nodes: nodes_found,
            elements,
            time: peer.time,
            floor_s: floors.forward(&setup.model.cost(), sizes),
            // of the two senses of a voltage, the one that the peer means
            error: worst(&peer.voltages).min(worst(&peer.voltages.mapv(|v| -v))) / largest,
        }));
        points.push(ForwardPoint {
            solver: "ours".to_owned(),
            nodes: nodes_found,
            elements,
            time: Spread::of(seconds, 1),
            floor_s: floors.forward(&setup.model.cost(), sizes),
            error: worst(&voltages) / largest,
        });
    }
    Ok(ForwardCourse { reference, points, failures })
}
