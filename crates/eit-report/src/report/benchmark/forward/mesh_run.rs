//! The forward problem on one mesh, solved by this program and by the peers.

use super::super::peers::{self, PeerForwardProblem, PeerVoltages};
use super::super::roofline::Roofline;
use super::super::work_precision::Spread;
use super::problem::{ForwardProblem, MeshFamily};
use super::reference::ReferenceVoltages;
use super::results::{ForwardPoint, OURS};
use crate::error::ReportError;
use eit_fem::{ElementOrder, ForwardModel};
use eit_mesh::{Mesh, MeshSettings};
use eit_skin::scene::element_words;
use ndarray::{Array1, Array2};
use std::path::Path;
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
    /// Solves with this program and an element order, timed over up to `runs` runs.
    pub fn own(&self, elements: ElementOrder, runs: usize) -> Result<ForwardPoint, ReportError> {
        let model = self.problem.model(self.mesh, elements)?;
        let sigma = self.problem.conductivity_s(self.mesh);
        let TimedSolution { voltages, voltages_time, time } = timed(&model, &sigma, runs)?;
        let error = self.reference.error_of(&voltages);
        let point = self.point(OURS.to_owned(), &model, time, error);
        Ok(ForwardPoint { voltages_time: Some(voltages_time), ..point })
    }

    fn point(
        &self,
        solver: String,
        model: &ForwardModel,
        time: Spread,
        error: f64,
    ) -> ForwardPoint {
        let cost = model.cost();
        let sizes = [model.protocol().measurements(), model.elements()];
        ForwardPoint {
            solver,
            elements: element_words(model.element_order()),
            mesh: self.family.name(),
            edge_m: self.settings.edge_m,
            electrode_edge_m: self.settings.electrode_edge_m,
            nodes: self.mesh.surface().nodes().len(),
            triangles: model.elements(),
            unknowns: cost.unknowns,
            time,
            voltages_time: None,
            floor_s: self.roofline.forward(&cost, sizes),
            voltages_floor_s: self.roofline.voltages(&cost),
            error,
        }
    }

    /// Solves with the peers' linear elements.
    pub fn peers(&self, python: impl AsRef<Path>) -> Result<Vec<ForwardPoint>, ReportError> {
        let python = python.as_ref();
        let model = self.problem.model(self.mesh, ElementOrder::Linear)?;
        let electrodes = self.mesh.electrodes().len();
        let found = peers::forward(
            python,
            &PeerForwardProblem {
                mesh: self.mesh,
                protocol: model.protocol(),
                contact_impedance: &self.problem.scene.contact_impedance(electrodes)?,
                conductivity_s: &self.problem.conductivity_s(self.mesh),
            },
        )?;
        let one = |PeerVoltages { name, time, voltages }: PeerVoltages| {
            let of = |voltages: &Array1<f64>| self.reference.error_of(voltages);
            // use the sign convention of voltages that the peer uses
            let error = of(&voltages).min(of(&voltages.mapv(|v| -v)));
            self.point(name, &model, time, error)
        };
        Ok(found.into_iter().map(one).collect())
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
