//! The skin of the touch figures: one mesh makes the data, others reconstruct.

use super::super::bench::Bench;
use crate::error::ReportError;
use eit_inverse::metrics::Cells;
use eit_inverse::touch::Bell;
use eit_mesh::SkinShape;
use eit_skin::frames::Frames;
use eit_skin::scene::MeshSource;
use eit_skin::{Progress, Skin};
use ndarray::Array2;
use rand_distr::Distribution as _;

/// Touch of the figures: a bell of 10 mm and 30 %.
pub(super) const RADIUS_M: f64 = 0.010;
pub(super) const AMPLITUDE: f64 = 0.3;

/// Parts of the skin's radius that stand for centre, half way and rim.
pub(super) const RINGS: [f64; 3] = [0.0, 0.5, 0.8];

/// Noise from which on the fit needs a finer mesh: that of 2 000 nodes errs by more than half of
/// the bound of 70 dB near the rim.
const FINE_FIT_DB: f64 = 65.0;

/// Nodes of the mesh that makes the data, and of the one that fits where noise is small.
pub(super) const DATA_NODES: usize = 9000;
pub(super) const FINE_FIT_NODES: usize = 5000;

/// Skin, meshes and pixels.
pub(super) struct Lab {
    /// What reconstructs: 2 000 nodes.
    pub bench: Bench,
    /// What makes the data.
    pub data: Skin,
    /// What fits where noise is small.
    pub fine_fit: Skin,
    /// Radius of the skin, metres.
    pub radius_m: f64,
    /// The pixels in space.
    pub cells: Cells<3>,
    /// Quiet frames that the noise of ST-TV images is measured on, 20 or more.
    pub quiet: usize,
    /// Voltages of the untouched skin on the mesh of the data, volt.
    pub reference_v: Vec<f64>,
}

impl Lab {
    /// The paper's skin.
    pub fn new(
        (pixels, quiet): (usize, usize),
        progress: &mut Progress,
    ) -> Result<Self, ReportError> {
        let bench = Bench::new(pixels, progress)?;
        let data = bench.skin().with_nodes(DATA_NODES, progress)?;
        let fine_fit = bench.skin().with_nodes(FINE_FIT_NODES, progress)?;
        let reference_v = data.model.forward(&data.background_s())?.to_vec();
        let cells = Cells::of_raster_on(&bench.raster, bench.skin().mesh.surface())?;
        let MeshSource::Generated { shape: SkinShape::Disc { radius_m }, .. } = data.source else {
            return Err(ReportError::Failure("touch figures are those of a disc".to_owned()));
        };
        Ok(Self { bench, data, fine_fit, radius_m, cells, quiet, reference_v })
    }

    /// The mesh to fit on at a noise level.
    pub fn fitting(&self, noise_db: f64) -> &Skin {
        if noise_db >= FINE_FIT_DB { &self.fine_fit } else { self.bench.skin() }
    }

    /// Sheet conductivity, siemens.
    pub fn sheet_s(&self) -> f64 {
        self.data.conductivity_s
    }

    /// Standard deviation of a difference's noise, volt: so many decibel below the root mean square
    /// of the reference voltages.
    pub fn noise_std_v(&self, noise_db: f64) -> f64 {
        super::table::rms(&self.reference_v) * 10_f64.powf(-noise_db / 20.0)
    }

    /// Voltages of a skin with bells, without noise.
    pub fn voltages(&self, bells: &[Bell]) -> Result<Vec<f64>, ReportError> {
        let of = |p: &[f64; 3], bell: &Bell| {
            let d2: f64 = (0..3).map(|i| (p[i] - bell.position_m[i]).powi(2)).sum();
            bell.amplitude * (-0.5 * d2 / bell.radius_m.powi(2)).exp()
        };
        let centroids = self.data.mesh.surface().centroids();
        let change = |p: &[f64; 3]| bells.iter().map(|bell| of(p, bell)).sum::<f64>();
        let sigma: Vec<f64> =
            centroids.iter().map(|p| self.sheet_s() * (1.0 + change(p))).collect();
        Ok(self.data.model.forward(&sigma)?.to_vec())
    }

    /// Frames of voltages against the reference without noise, for what reads recordings.
    pub fn frames(&self, values: Array2<f64>, reference: &[f64]) -> Frames {
        Frames {
            good: Array2::from_elem(values.raw_dim(), true),
            used: vec![true; reference.len()],
            values,
            reference: reference.to_vec(),
            reference_source: "the untouched skin".to_owned(),
            // without noise of its own
            reference_frames: usize::MAX,
            quiet: None,
            rate_hz: None,
            reciprocity_error: None,
            notes: Vec::new(),
        }
    }
}

/// A touch of the figures at a place.
pub(super) fn bell(position_m: [f64; 2]) -> Bell {
    let [x, y] = position_m;
    Bell { position_m: [x, y, 0.0], amplitude: AMPLITUDE, radius_m: RADIUS_M }
}

/// Seeded random numbers.
pub(super) struct Random(rand_pcg::Pcg64Mcg);

impl Random {
    /// Of a seed and a purpose: the same numbers whatever else is drawn.
    pub fn new(seed: u64, purpose: u64) -> Self {
        Self(rand_pcg::Pcg64Mcg::new(u128::from(seed) << 64 | u128::from(purpose) << 1 | 1))
    }

    /// Normal, standard deviation 1.
    pub fn normal(&mut self) -> f64 {
        rand_distr::StandardNormal.sample(&mut self.0)
    }

    /// Uniform from 0 to 1.
    pub fn uniform(&mut self) -> f64 {
        rand_distr::StandardUniform.sample(&mut self.0)
    }

    /// Values with white noise.
    pub fn noisy(&mut self, values: &[f64], std: f64) -> Vec<f64> {
        values.iter().map(|v| v + std * self.normal()).collect()
    }
}
