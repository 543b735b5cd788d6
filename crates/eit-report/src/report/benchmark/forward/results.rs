//! What the forward problem of a skin cost on each mesh, and how wrong it was.

use super::super::forward_cases::ForwardCase;
use super::super::picture::Picture;
use super::super::work_precision::Spread;
use serde::Serialize;

/// [`ForwardPoint::solver`] of this program.
pub(in super::super) const OURS: &str = "ours";

/// A mesh and what its voltages cost.
#[derive(Debug, Clone, Serialize)]
pub(in super::super) struct ForwardPoint {
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
    /// Node, midside and electrode potentials.
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

/// The forward problem of a skin on all its meshes.
pub(in super::super) struct ForwardResults {
    pub case: ForwardCase,
    /// What the error is against, and the error of that.
    pub reference: String,
    pub reference_error: f64,
    pub points: Vec<ForwardPoint>,
    /// Meshes whose error is too near to the reference's own.
    pub left_out: usize,
    /// Why peers did not run.
    pub failures: Vec<String>,
    /// `None` where no error could be told.
    pub picture: Option<Picture>,
}

impl ForwardResults {
    /// The reference, its own error, and what it cannot judge.
    pub fn reference_words(&self) -> String {
        let left_out = match self.left_out {
            0 => String::new(),
            count => format!("; {count} with errors below ten times that are left out"),
        };
        format!("{} (its own error: {:.0e}{left_out})", self.reference, self.reference_error)
    }
}
