//! Forward problem and Jacobian: error of the voltages against time on many meshes, with linear and
//! quadratic elements on uniform and graded meshes.
//!
//! The error is the largest error of any voltage divided by the largest voltage, relative to
//! [`ReferenceVoltages`].

mod choice;
mod mesh_run;
mod plot;
mod problem;
mod reference;
pub(super) mod results;
pub(super) mod tables;

use super::cases::{self, Case};
use super::picture::Picture;
use super::settings::{BenchmarkSettings, Size};
use crate::error::ReportError;
use eit_fem::ElementOrder;
use mesh_run::MeshRun;
use problem::{ForwardProblem, MeshFamily};
use reference::ReferenceVoltages;
use results::{ForwardPoint, ForwardResults};

/// An element order and its limits.
struct Elements {
    elements: ElementOrder,
    /// Largest number of nodes of a mesh used with it.
    most_nodes: usize,
}

/// Both element orders, on meshes that take about the same time.
const ELEMENT_KINDS: [Elements; 2] = [
    Elements { elements: ElementOrder::Linear, most_nodes: 30_000 },
    Elements { elements: ElementOrder::Quadratic, most_nodes: 15_000 },
];

/// Number of meshes over all element orders, for a progress bar.
pub(super) fn steps(size: &Size) -> usize {
    size.mesh_steps.len() * MeshFamily::ALL.len() * ELEMENT_KINDS.len()
}

/// Runs all meshes of a skin; `None` if the user interrupts.
pub(super) fn run(
    case: &Case,
    settings: &BenchmarkSettings<'_>,
    bar: &eit_skin::Steps<'_>,
) -> Result<Option<ForwardResults>, ReportError> {
    let BenchmarkSettings { size, roofline, stop, .. } = *settings;
    let problem = ForwardProblem::new(case)?;
    let reference = ReferenceVoltages::of(&problem, size.reference_scales)?;
    let mut results = ForwardResults {
        case: case.clone(),
        reference: reference.description.clone(),
        reference_error: reference.error,
        points: Vec::new(),
        left_out: 0,
        picture: None,
    };
    for family in MeshFamily::ALL {
        for &step in size.mesh_steps {
            if stop.is_set() {
                return Ok(None);
            }
            let settings = &problem.settings(family, step);
            let mesh = &problem.mesh(settings)?;
            let nodes = mesh.surface().nodes().len();
            let (problem, reference) = (&problem, &reference);
            let run = MeshRun { problem, family, settings, mesh, roofline, reference };
            for Elements { elements, most_nodes } in ELEMENT_KINDS {
                bar.inc();
                if nodes <= most_nodes {
                    keep(&mut results, reference, run.solve(elements, size.forward_runs)?);
                }
            }
        }
    }
    if !results.points.is_empty() {
        results.picture =
            Some(Picture::new(cases::picture("forward", case.skin()), &plot::draw(&results)?)?);
    }
    Ok(Some(results))
}

/// Keeps a point if the reference is accurate enough for its error.
fn keep(results: &mut ForwardResults, reference: &ReferenceVoltages, point: ForwardPoint) {
    match reference.can_tell(point.error) {
        true => results.points.push(point),
        false => results.left_out += 1,
    }
}
