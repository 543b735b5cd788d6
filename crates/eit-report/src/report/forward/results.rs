//! Time and error of a skin's forward problem on each mesh.

use super::super::cases::Case;
use super::super::picture::Picture;
use super::super::work_precision::Spread;
use serde::Serialize;

/// A mesh with the time and error of its voltages.
#[derive(Debug, Clone, Serialize)]
pub(in super::super) struct ForwardPoint {
    /// Element order, "linear" or "quadratic".
    pub elements: &'static str,
    /// Mesh family, "even" or "graded".
    pub mesh: &'static str,
    /// `mesh.edge_m` and `mesh.electrode_edge_m` that give this mesh in a scene, metres.
    pub edge_m: Option<f64>,
    pub electrode_edge_m: Option<f64>,
    pub nodes: usize,
    pub triangles: usize,
    /// Number of node, midside and electrode potentials.
    pub unknowns: usize,
    /// Time of factorisation, voltages and Jacobian, seconds.
    pub time: Spread,
    /// Time without the Jacobian.
    pub voltages_time: Spread,
    /// Floors of the two times: the same work at this machine's best rates.
    pub floor_s: f64,
    pub voltages_floor_s: f64,
    /// Largest error of a voltage divided by the largest voltage.
    pub error: f64,
}

impl ForwardPoint {
    /// Name of its curve in a picture.
    pub(crate) fn curve(&self) -> String {
        format!("{}, {}", self.elements, self.mesh)
    }
}

/// The forward problem of a skin on all of its meshes.
pub(in super::super) struct ForwardResults {
    pub case: Case,
    /// Description of the reference, and its own error.
    pub reference: String,
    pub reference_error: f64,
    pub points: Vec<ForwardPoint>,
    /// Number of meshes whose error is too close to the reference's own.
    pub left_out: usize,
    /// `None` if no error could be reported.
    pub picture: Option<Picture>,
}

impl ForwardResults {
    /// Describes the reference, its own error, and the number of results that it cannot judge.
    pub(crate) fn reference_text(&self) -> String {
        let left_out = match self.left_out {
            0 => String::new(),
            count => format!("; {count} results with errors below ten times that are omitted"),
        };
        format!("{} (its own error: {:.0e}{left_out})", self.reference, self.reference_error)
    }
}
