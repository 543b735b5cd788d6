//! Forward problem and Jacobian: error of the voltages over time, mesh by mesh, with linear and
//! quadratic elements on even and graded meshes.
//!
//! The error is the largest of a voltage over the largest voltage, against [`Reference`].

mod choice;
mod reference;
mod sheet;
mod tables;

pub(super) use choice::{TARGETS, cheapest};
pub(super) use tables::{choices, json, meshes};

use super::floor::Floors;
use super::peers;
use super::plots;
use super::point::Spread;
use super::skins::Skin;
use super::{How, Size};
use crate::error::ReportError;
use eit_fem::{ElementOrder, ForwardModel};
use eit_mesh::{Mesh, MeshSettings};
use ndarray::{Array1, Array2};
use reference::Reference;
use serde::Serialize;
use sheet::{Family, Sheet};
use std::path::Path;
use std::time::Instant;

/// [`ForwardPoint::solver`] of this program.
pub(super) const OURS: &str = "ours";

/// Kinds of elements, their names, and the most nodes of a mesh that each is tried on: about as much
/// time.
const ELEMENTS: [(ElementOrder, &str, usize); 2] =
    [(ElementOrder::Linear, "linear", 30_000), (ElementOrder::Quadratic, "quadratic", 15_000)];

/// Largest mesh that the peers solve on: pyEIT takes seconds there.
const PEER_NODES: usize = 2_000;

/// Runs on a mesh that are made at least, and the time after which there are no more.
const LEAST_RUNS: usize = 3;
const ENOUGH_S: f64 = 0.4;

/// A mesh and what its voltages cost.
#[derive(Debug, Clone, Serialize)]
pub(super) struct ForwardPoint {
    /// Who solved.
    pub solver: String,
    /// Kind of elements, "linear" or "quadratic".
    pub elements: &'static str,
    /// Kind of mesh, "even" or "graded".
    pub mesh: &'static str,
    /// `mesh.edge_m` and `mesh.electrode_edge_m` of a scene with this mesh, metres.
    pub edge_m: Option<f64>,
    pub electrode_edge_m: Option<f64>,
    pub nodes: usize,
    pub triangles: usize,
    /// Node, middle and electrode potentials.
    pub unknowns: usize,
    /// Factorisation, voltages and Jacobian, seconds.
    pub time: Spread,
    /// Without the Jacobian; peers make both at once.
    pub voltages_time: Option<Spread>,
    /// The two at this machine's best rates.
    pub floor_s: f64,
    pub voltages_floor_s: f64,
    /// Largest error of a voltage over the largest voltage.
    pub error: f64,
}

impl ForwardPoint {
    /// What its curve in a picture is called.
    pub fn curve(&self) -> String {
        match self.solver.as_str() {
            OURS => format!("{}, {}", self.elements, self.mesh),
            peer => peer.to_owned(),
        }
    }
}

/// A skin's meshes.
#[derive(Debug, Clone)]
pub(super) struct ForwardCourse {
    pub skin: Skin,
    /// What the error is against, and the error of that.
    pub reference: String,
    pub reference_error: f64,
    pub points: Vec<ForwardPoint>,
    /// Meshes whose error is too near to the reference's own.
    pub left_out: usize,
    /// Peers that did not run, and why.
    pub failures: Vec<String>,
    /// PNG; `None` where no error could be told.
    pub picture: Option<Vec<u8>>,
}

/// Number of meshes, kinds of elements counted, for a progress bar.
pub(super) fn steps(size: &Size) -> usize {
    size.mesh_steps.len() * Family::ALL.len() * ELEMENTS.len()
}

/// Runs all meshes of a skin; `None` if the user wants an end.
pub(super) fn course(
    skin: &Skin,
    How { args, size, floors, stop }: &How<'_>,
    bar: &eit_skin::Steps<'_>,
) -> Result<Option<ForwardCourse>, ReportError> {
    let sheet = Sheet::new(skin)?;
    let reference = Reference::of(&sheet, size.reference_scales)?;
    let mut course = ForwardCourse {
        skin: *skin,
        reference: reference.words.clone(),
        reference_error: reference.error,
        points: Vec::new(),
        left_out: 0,
        failures: Vec::new(),
        picture: None,
    };
    for family in Family::ALL {
        for &step in size.mesh_steps {
            if stop.is_set() {
                return Ok(None);
            }
            let settings = sheet.settings(family, step);
            let mesh = sheet.mesh(&settings)?;
            let of = (family, &settings);
            let lane = Lane { sheet: &sheet, of, mesh: &mesh, floors, reference: &reference };
            for (elements, name, most_nodes) in ELEMENTS {
                bar.inc();
                if mesh.surface().nodes().len() <= most_nodes {
                    course.keep(&reference, lane.own((elements, name), size)?);
                }
            }
            if let (Some(python), Family::Graded) = (args.peers.as_deref(), family)
                && mesh.surface().nodes().len() <= PEER_NODES
            {
                match lane.peers(python) {
                    Ok(points) => points.into_iter().for_each(|p| course.keep(&reference, p)),
                    Err(error) => course.failures.push(error.to_string()),
                }
            }
        }
    }
    if !course.points.is_empty() {
        course.picture = Some(plots::png(&plots::forward(&course)?)?);
    }
    Ok(Some(course))
}

impl ForwardCourse {
    /// Takes what the reference can judge.
    fn keep(&mut self, reference: &Reference, point: ForwardPoint) {
        match reference.can_tell(point.error) {
            true => self.points.push(point),
            false => self.left_out += 1,
        }
    }

    /// The reference, its own error, and what it cannot judge.
    pub fn reference_words(&self) -> String {
        let left_out = match self.left_out {
            0 => String::new(),
            count => format!("; {count} with errors below ten times that are left out"),
        };
        format!("{} (its own error: {:.0e}{left_out})", self.reference, self.reference_error)
    }
}

/// A mesh that is solved on.
struct Lane<'a> {
    sheet: &'a Sheet,
    of: (Family, &'a MeshSettings),
    mesh: &'a Mesh,
    floors: &'a Floors,
    reference: &'a Reference,
}

impl Lane<'_> {
    fn own(
        &self,
        (elements, name): (ElementOrder, &'static str),
        size: &Size,
    ) -> Result<ForwardPoint, ReportError> {
        let model = self.sheet.model(self.mesh, elements)?;
        let sigma = self.sheet.conductivity_s(self.mesh);
        let (voltages, [voltages_time, time]) = timed(&model, &sigma, size.forward_runs)?;
        Ok(ForwardPoint {
            voltages_time: Some(voltages_time),
            ..self.point(
                (OURS.to_owned(), name),
                (&model, time),
                self.reference.error_of(&voltages),
            )
        })
    }

    fn point(
        &self,
        (solver, elements): (String, &'static str),
        (model, time): (&ForwardModel, Spread),
        error: f64,
    ) -> ForwardPoint {
        let (cost, (family, settings)) = (model.cost(), self.of);
        let sizes = [model.protocol().measurements(), model.elements()];
        ForwardPoint {
            solver,
            elements,
            mesh: family.name(),
            edge_m: settings.edge_m,
            electrode_edge_m: settings.electrode_edge_m,
            nodes: self.mesh.surface().nodes().len(),
            triangles: model.elements(),
            unknowns: cost.unknowns,
            time,
            voltages_time: None,
            floor_s: self.floors.forward(&cost, sizes),
            voltages_floor_s: self.floors.voltages(&cost),
            error,
        }
    }

    /// The peers' linear elements on this mesh.
    fn peers(&self, python: &Path) -> Result<Vec<ForwardPoint>, ReportError> {
        let model = self.sheet.model(self.mesh, ElementOrder::Linear)?;
        let impedance = self.sheet.scene.contact_impedance(self.mesh.electrodes().len())?;
        let sigma = self.sheet.conductivity_s(self.mesh);
        let given = (model.protocol(), impedance.as_slice(), sigma.as_slice());
        let found = peers::forward(python, self.mesh, given)?;
        let one = |peer: peers::PeerVoltages| {
            let of = |voltages: &Array1<f64>| self.reference.error_of(voltages);
            // of the two senses of a voltage, the one that the peer means
            let error = of(&peer.voltages).min(of(&peer.voltages.mapv(|v| -v)));
            self.point((peer.name, ELEMENTS[0].1), (&model, peer.time), error)
        };
        Ok(found.into_iter().map(one).collect())
    }
}

/// Voltages, and the times of some solves until the voltages and until the Jacobian is made, with
/// memory of earlier runs.
fn timed(
    model: &ForwardModel,
    sigma: &[f64],
    runs: usize,
) -> Result<(Array1<f64>, [Spread; 2]), ReportError> {
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
    Ok((Array1::from(voltages), seconds.map(|seconds| Spread::of(seconds, 1))))
}
