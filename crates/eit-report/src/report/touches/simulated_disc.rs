//! The simulated disc of the touch figures: one mesh generates the data, others reconstruct.

use super::super::reconstruction_model::ReconstructionModel;
use super::super::statistics::rms;
use crate::error::ReportError;
use eit_fem::fabric::{LinearResponse, Random, Tip, Touch};
use eit_inverse::metrics::Cells;
use eit_inverse::touch::Bell;
use eit_mesh::SkinShape;
use eit_skin::frames::Frames;
use eit_skin::scene::MeshSource;
use eit_skin::{Progress, Skin};
use ndarray::Array2;
use std::f64::consts::TAU;

/// The touch used in the figures: a bell of 10 mm and 30 %.
pub(super) const RADIUS_M: f64 = 0.010;
pub(super) const AMPLITUDE: f64 = 0.3;
/// Its force, newtons, and the skin response that gives this change.
pub(super) const FORCE_N: f64 = 1.0;
pub(super) const RESPONSE: LinearResponse =
    LinearResponse { change_per_newton: AMPLITUDE / FORCE_N };

/// Ring radii relative to the skin's: centre, halfway and near the rim.
pub(super) const RINGS: [f64; 3] = [0.0, 0.5, 0.8];

/// Noise level from which the fit needs a finer mesh: near the rim, the error of the mesh with 2
/// 000 nodes exceeds half of the bound at 70 dB.
const FINE_FIT_DB: f64 = 65.0;

/// Nodes of the mesh that generates the data, and of the mesh for fitting at low noise.
pub(super) const SIMULATION_NODES: usize = 9000;
const FINE_FIT_NODES: usize = 5000;

/// The paper's skin on the meshes for simulation, reconstruction and fitting, with its reference
/// voltages.
pub(super) struct SimulatedDisc {
    /// Reconstruction model with 2 000 nodes.
    pub model: ReconstructionModel,
    /// Simulation model.
    pub simulation: Skin,
    /// Model for fitting at low noise.
    pub fine_fit: Skin,
    /// Radius of the skin, metres.
    pub radius_m: f64,
    /// The pixels, with their positions in space.
    pub cells: Cells<3>,
    /// Voltages of the untouched skin on the simulation mesh, volts.
    pub reference_v: Vec<f64>,
}

impl SimulatedDisc {
    /// Creates the paper's skin.
    pub fn new(pixels: usize, progress: &mut Progress) -> Result<Self, ReportError> {
        let model = ReconstructionModel::paper_disc(pixels, progress)?;
        let simulation = model.skin().with_nodes(SIMULATION_NODES, progress)?;
        let fine_fit = model.skin().with_nodes(FINE_FIT_NODES, progress)?;
        let MeshSource::Generated { shape: SkinShape::Disc { radius_m }, .. } = simulation.source
        else {
            return Err(ReportError::Failure("touch figures need a disc".to_owned()));
        };
        let reference_v = simulation.model.forward(&simulation.background_s())?.to_vec();
        let cells = Cells::of_raster_on(&model.raster, model.skin().mesh.surface())?;
        Ok(Self { model, simulation, fine_fit, radius_m, cells, reference_v })
    }

    /// The mesh for fitting at a noise level.
    pub fn fit_skin(&self, noise_db: f64) -> &Skin {
        if noise_db >= FINE_FIT_DB { &self.fine_fit } else { self.model.skin() }
    }

    /// Sheet conductivity, siemens.
    pub fn conductivity_s(&self) -> f64 {
        self.simulation.conductivity_s
    }

    /// Standard deviation of the noise of a difference, volts, the given number of decibels below
    /// the root mean square of the reference voltages.
    pub fn noise_std_v(&self, noise_db: f64) -> f64 {
        rms(&self.reference_v) * 10_f64.powf(-noise_db / 20.0)
    }

    /// Noise-free voltages of a skin with touches at the given positions.
    pub fn voltages(&self, places_m: &[[f64; 2]]) -> Result<Vec<f64>, ReportError> {
        let touch = |&position_m: &[f64; 2]| Touch {
            finger: 1,
            tip: Tip::Round,
            position_m,
            force_n: FORCE_N,
            radius_m: RADIUS_M,
            direction: [0.0; 2],
        };
        let touches: Vec<Touch> = places_m.iter().map(touch).collect();
        let centroids = self.simulation.mesh.surface().centroids();
        let sigma = RESPONSE.conductivity_s(self.conductivity_s(), &touches, &centroids);
        Ok(self.simulation.model.forward(&sigma)?.to_vec())
    }

    /// Voltages as frames with a noise-free reference, for functions that take recordings.
    pub fn frames(&self, values: Array2<f64>, reference: &[f64]) -> Frames {
        Frames {
            good: Array2::from_elem(values.raw_dim(), true),
            used: vec![true; reference.len()],
            values,
            reference: reference.to_vec(),
            reference_source: "the untouched skin".to_owned(),
            // the reference has no noise of its own
            reference_frames: usize::MAX,
            quiet: None,
            faults: Vec::new(),
            rate_hz: None,
            reciprocity_error: None,
            notes: Vec::new(),
        }
    }

    /// Positions on a ring, at equal steps of the angle between two electrodes from a seeded start,
    /// so that symmetry does not favour any. The centre gives one position.
    pub fn places(&self, ring: f64, count: usize) -> Vec<[f64; 2]> {
        let electrodes = self.simulation.mesh.electrodes().len() as f64;
        let first = TAU * Random::named(17, "places of a ring", (100.0 * ring) as u64).uniform();
        let at = |k: usize| {
            // one turn around the skin, combined with one step through the gap between electrodes
            let part = k as f64 / count as f64;
            let angle = first + TAU * part + TAU / electrodes * part;
            let r = ring * self.radius_m;
            [r * angle.cos(), r * angle.sin()]
        };
        (0..count).map(at).collect()
    }
}

/// The touch used in the figures, at a position.
pub(super) fn bell(position_m: [f64; 2]) -> Bell {
    let [x, y] = position_m;
    Bell { position_m: [x, y, 0.0], amplitude: AMPLITUDE, radius_m: RADIUS_M }
}

/// Distance in the plane, metres.
pub(super) fn distance_m(found: [f64; 3], place: [f64; 2]) -> f64 {
    (found[0] - place[0]).hypot(found[1] - place[1])
}
