//! Runs Python peers on the same problems, with `--peers PYTHON`.
//!
//! The script is part of the program (`peers.py`: NumPy and SciPy, and CHOLMOD and pyEIT if
//! installed). It reads arrays from a temporary folder and writes its results there: times by its
//! own clock, voltages, and images that are evaluated here like ours.

mod process;

use super::work_precision::Spread;
use crate::error::ReportError;
use crate::output::write_npy;
use eit_fem::Protocol;
use eit_mesh::{Electrode, Mesh};
use ndarray::{Array1, Array2, ArrayBase, ArrayView1, Data, Dimension};
use ndarray_npy::ReadNpyExt as _;
use serde::Deserialize;
use std::path::Path;
use std::process::Command;

const SCRIPT: &str = include_str!("peers.py");

/// A result reported by a peer.
#[derive(Deserialize)]
struct Told {
    kind: String,
    name: String,
    seconds: Vec<f64>,
    frames: usize,
}

/// Voltages computed by a peer.
pub(super) struct PeerVoltages {
    pub name: String,
    pub time: Spread,
    pub voltages: Array1<f64>,
}

/// Images computed by a peer, and its times for all frames.
pub(super) struct PeerImages {
    pub name: String,
    pub seconds: Vec<f64>,
    /// [frame, masked pixel].
    pub images: Array2<f64>,
}

/// Checks before any work that the interpreter has the required modules.
pub(super) fn check(python: &Path) -> Result<(), ReportError> {
    let tried = process::run(Command::new(python).args(["-c", "import numpy, scipy"]));
    tried.map_err(|why| {
        ReportError::input(format!(
            "--peers {}: a Python with numpy and scipy is needed (scikit-sparse and pyeit are used \
             where installed): {why}",
            python.display()
        ))
    })
}

/// Input of the peers' forward problem.
pub(super) struct PeerForwardProblem<'a> {
    pub mesh: &'a Mesh,
    pub protocol: &'a Protocol,
    /// Contact impedance of each electrode, ohm metres.
    pub contact_impedance: &'a [f64],
    /// Conductivity of each element, siemens.
    pub conductivity_s: &'a [f64],
}

/// Returns the peers' voltages; none if electrodes are patches.
pub(super) fn forward(
    python: &Path,
    problem: &PeerForwardProblem<'_>,
) -> Result<Vec<PeerVoltages>, ReportError> {
    let PeerForwardProblem { mesh, protocol, contact_impedance, conductivity_s } = *problem;
    let folder = Folder::new()?;
    let surface = mesh.surface();
    let nodes = Array2::from_shape_fn((surface.nodes().len(), 3), |(n, k)| surface.nodes()[n][k]);
    let triangles = surface.triangles();
    let corners = Array2::from_shape_fn((triangles.len(), 3), |(e, k)| f64::from(triangles[e][k]));
    let mut edges = Vec::new();
    for (number, electrode) in mesh.electrodes().iter().enumerate() {
        // the script supports only electrodes on the rim
        let Electrode::Rim(own) = electrode else { return Ok(Vec::new()) };
        edges.extend(own.iter().flat_map(|[a, b]| [f64::from(*a), f64::from(*b), number as f64]));
    }
    let edges = table(edges, 3)?;
    let data = protocol.data().iter().flatten().map(|i| f64::from(*i)).collect();
    folder.put("nodes", &nodes)?;
    folder.put("triangles", &corners)?;
    folder.put("edges", &edges)?;
    folder.put("impedance", &ArrayView1::from(contact_impedance))?;
    folder.put("sigma", &ArrayView1::from(conductivity_s))?;
    folder.put("stimulations", &protocol.stimulations_a())?;
    folder.put("patterns", &protocol.measurement_patterns())?;
    folder.put("data", &table(data, 2)?)?;
    let told = folder.run(python)?;
    let mut found = Vec::new();
    for (number, told) in told.into_iter().enumerate().filter(|(_, t)| t.kind == "forward") {
        let voltages: Array1<f64> = folder.get(number)?;
        found.push(PeerVoltages { name: told.name, time: Spread::of(told.seconds, 1), voltages });
    }
    Ok(found)
}

/// Returns the peers' images of a recording.
pub(super) fn inverse(
    python: &Path,
    problem: &PeerInverseProblem,
) -> Result<Vec<PeerImages>, ReportError> {
    let folder = Folder::new()?;
    folder.put("matrix", &problem.matrix)?;
    folder.put("frames", &problem.differences)?;
    folder.put("whitened_jacobian", &problem.whitened_jacobian)?;
    folder.put("whitened_differences", &problem.whitened_differences)?;
    folder.put("mask", &problem.mask)?;
    folder.put("weights", &Array1::from(problem.weights.to_vec()))?;
    let told = folder.run(python)?;
    let mut found = Vec::new();
    for (number, told) in told.into_iter().enumerate().filter(|(_, t)| t.kind == "inverse") {
        let images: Array2<f64> = folder.get(number)?;
        if images.nrows() != told.frames {
            return Err(ReportError::Failure(format!(
                "the peer {} returned {} frames instead of {}",
                told.name,
                images.nrows(),
                told.frames
            )));
        }
        found.push(PeerImages { name: told.name, seconds: told.seconds, images });
    }
    Ok(found)
}

/// Input of the inverse problem, as plain arrays.
pub(super) struct PeerInverseProblem {
    /// One-step reconstruction matrix, [pixel, measurement].
    pub matrix: Array2<f64>,
    /// Difference data, [frame, measurement].
    pub differences: Array2<f64>,
    /// Jacobian [measurement, pixel] and data [frame, measurement], divided by the noise.
    pub whitened_jacobian: Array2<f64>,
    pub whitened_differences: Array2<f64>,
    /// Mask [row, column], 1 on the skin.
    pub mask: Array2<f64>,
    /// Weights of differences between pixels in space and between frames in time.
    pub weights: [f64; 2],
}

/// A temporary folder of arrays.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Result<Self, ReportError> {
        let folder = tempfile::Builder::new().prefix("eit-peers-").tempdir();
        folder.map(Self).map_err(|e| ReportError::Failure(format!("no temporary folder: {e}")))
    }

    fn put<S, D>(&self, name: &str, array: &ArrayBase<S, D>) -> Result<(), ReportError>
    where
        S: Data<Elem = f64>,
        D: Dimension,
    {
        let path = self.0.path().join(format!("{name}.npy"));
        let mut file = std::fs::File::create(&path).map_err(|e| ReportError::at(&path, e))?;
        write_npy(array, &mut file)
    }

    fn get<D: Dimension>(
        &self,
        number: usize,
    ) -> Result<ArrayBase<ndarray::OwnedRepr<f64>, D>, ReportError> {
        let path = self.0.path().join(format!("result_{number}.npy"));
        let file = std::fs::File::open(&path).map_err(|e| ReportError::at(&path, e))?;
        ArrayBase::read_npy(std::io::BufReader::new(file)).map_err(|e| ReportError::at(&path, e))
    }

    fn run(&self, python: &Path) -> Result<Vec<Told>, ReportError> {
        let script = self.0.path().join("peers.py");
        std::fs::write(&script, SCRIPT).map_err(|e| ReportError::at(&script, e))?;
        process::run(Command::new(python).arg(&script).arg(self.0.path()))
            .map_err(|why| ReportError::Failure(format!("the Python peers failed: {why}")))?;
        let path = self.0.path().join("results.json");
        let text = std::fs::read_to_string(&path).map_err(|e| ReportError::at(&path, e))?;
        serde_json::from_str(&text).map_err(|e| ReportError::at(&path, e))
    }
}

/// Arranges numbers in rows of the given length.
fn table(values: Vec<f64>, columns: usize) -> Result<Array2<f64>, ReportError> {
    Array2::from_shape_vec((values.len() / columns, columns), values)
        .map_err(|e| ReportError::Failure(e.to_string()))
}
