//! The forward problem on one mesh.

use super::super::roofline::Roofline;
use super::super::work_precision::Spread;
use super::problem::{ForwardProblem, MeshFamily};
use super::reference::ReferenceVoltages;
use super::results::ForwardPoint;
use crate::error::ReportError;
use eit_fem::{ElementOrder, ForwardModel};
use eit_mesh::{Mesh, MeshSettings};
use eit_skin::scene::element_text;
use ndarray::{Array1, Array2};
use std::time::Instant;

/// Minimum number of runs per mesh, and the time after which no further runs start.
const LEAST_RUNS: usize = 3;
const ENOUGH_S: f64 = 0.4;

/// A mesh with everything needed to solve on it.
pub(super) struct MeshRun<'a> {
    pub problem: &'a ForwardProblem,
    pub family: MeshFamily,
    pub settings: &'a MeshSettings,
    pub mesh: &'a Mesh,
    pub roofline: &'a Roofline,
    pub reference: &'a ReferenceVoltages,
}

impl MeshRun<'_> {
    /// Solves with an element order, timed over up to `runs` runs.
    pub(crate) fn solve(
        &self,
        elements: ElementOrder,
        runs: usize,
    ) -> Result<ForwardPoint, ReportError> {
        let model = self.problem.model(self.mesh, elements)?;
        let sigma = self.problem.conductivity_s(self.mesh);
        let TimedSolution { voltages, voltages_time, time } = timed(&model, &sigma, runs)?;
        let cost = model.cost();
        let sizes = [model.protocol().measurements(), model.elements()];
        Ok(ForwardPoint {
            elements: element_text(elements),
            mesh: self.family.name(),
            edge_m: self.settings.edge_m,
            electrode_edge_m: self.settings.electrode_edge_m,
            nodes: self.mesh.surface().nodes().len(),
            triangles: model.elements(),
            unknowns: cost.unknowns,
            time,
            voltages_time,
            floor_s: self.roofline.forward(&cost, sizes),
            voltages_floor_s: self.roofline.voltages(&cost),
            error: self.reference.error_of(&voltages),
        })
    }
}

/// Voltages, and the times of some solves up to the voltages and up to the Jacobian.
struct TimedSolution {
    voltages: Array1<f64>,
    voltages_time: Spread,
    time: Spread,
}

/// Solves repeatedly, reusing memory.
fn timed(model: &ForwardModel, sigma: &[f64], runs: usize) -> Result<TimedSolution, ReportError> {
    let mut workspace = model.workspace()?;
    let measurements = model.protocol().measurements();
    let mut voltages = vec![0.0; measurements];
    let mut jacobian = Array2::zeros((measurements, model.elements()));
    let mut seconds = [Vec::new(), Vec::new()];
    let begin = Instant::now();
    for run in 0..runs.max(LEAST_RUNS) {
        if run >= LEAST_RUNS && begin.elapsed().as_secs_f64() > ENOUGH_S {
            break;
        }
        let start = Instant::now();
        let mut solution = model.solve(sigma, &mut workspace)?;
        solution.measurements_into(&mut voltages)?;
        seconds[0].push(start.elapsed().as_secs_f64());
        solution.jacobian_into(jacobian.view_mut())?;
        seconds[1].push(start.elapsed().as_secs_f64());
    }
    let [voltages_time, time] = seconds.map(|seconds| Spread::of(seconds, 1));
    Ok(TimedSolution { voltages: Array1::from(voltages), voltages_time, time })
}
