//! Simulated touch movies: fingers move on a skin, voltages are solved for, noise is added.
//!
//! A finger raises the sheet conductivity, softly or with an edge: with `f` its place,
//!
//! ```text
//! sigma(x) = sigma_0 (1 + sum over fingers of  change s(|x - f| / sigma_m))
//! bell: s(r) = exp(-r^2 / 2)          pad: s(r) = 1 for r^2 <= 2, else 0
//! ```
//!
//! Each frame is a full non-linear solve on a mesh finer than the one that reconstructs; frames
//! that show the same fingers as the one before share its solve, and noise of any level and seed
//! goes onto the same voltages afterwards. The reference frame is the untouched skin with noise of
//! its own. Everything random comes from a seed, so a movie has the same bytes every time.

mod paths;

use crate::error::ReportError;
use eit_mesh::Raster;
use eit_skin::frames::Frames;
use eit_skin::scene::MeshSource;
use eit_skin::{Progress, Skin, rounding_warning};
use ndarray::{Array1, Array2, Array3, Axis};
use rand_distr::Distribution as _;

/// Steps of a slow and of a fast finger of 12 mm, metres a frame: a sixth of the bell's standard
/// deviation, which averaging over frames hardly blurs, and all of it, which it smears out. At 8
/// frames a second they are 16 and 96 mm a second.
pub const SLOW_M: f64 = 0.002;
pub const FAST_M: f64 = 0.012;

/// How the change falls off around a finger. Both hold the same amount of change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FingerShape {
    /// Soft: a Gaussian bell.
    Bell,
    /// A flat stamp of radius `sqrt(2) sigma_m` with an edge.
    Pad,
}

impl FingerShape {
    /// Both, with names for tables.
    pub const ALL: [(&str, Self); 2] = [("bell", Self::Bell), ("pad", Self::Pad)];
}

/// How a finger changes the skin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Finger {
    /// Soft or with an edge.
    pub shape: FingerShape,
    /// Standard deviation of the bell, metres.
    pub sigma_m: f64,
    /// Relative change of the sheet conductivity in its middle; above -1.
    pub change: f64,
}

impl Default for Finger {
    /// A fingertip: a bell of 12 mm, half as much conductivity again.
    fn default() -> Self {
        Self { shape: FingerShape::Bell, sigma_m: 0.012, change: 0.5 }
    }
}

/// A random touch movie.
#[derive(Debug, Clone, PartialEq)]
pub struct MovieSettings {
    /// Fingers on the skin all the time, 1 to 4.
    pub touches: usize,
    /// Frames.
    pub frames: usize,
    /// Way of every finger from one frame to the next along its path, metres; 0: at rest.
    /// [`SLOW_M`], [`FAST_M`].
    pub step_m: f64,
    /// All fingers are alike.
    pub finger: Finger,
    /// Frames a second, for displays.
    pub rate_hz: f64,
    /// Seed of the paths.
    pub path_seed: u64,
    /// Noise: `20 log10(rms of the reference voltages / noise standard deviation)`, decibel, as
    /// makers of instruments state it (30 to 70 dB), and its seed.
    pub noise_db: f64,
    pub noise_seed: u64,
    /// Nodes of the mesh that simulates.
    pub nodes: usize,
}

impl Default for MovieSettings {
    /// One slow finger, 60 dB, on a mesh of 7 000 nodes (3.5 times the usual 2 000).
    fn default() -> Self {
        Self {
            touches: 1,
            frames: 40,
            step_m: SLOW_M,
            finger: Finger::default(),
            rate_hz: 8.0,
            path_seed: 1,
            noise_db: 60.0,
            noise_seed: 1,
            nodes: 7000,
        }
    }
}

/// A simulated movie and its truth.
pub struct Simulated {
    /// Voltages with noise and their reference.
    pub frames: Frames,
    /// True conductivity change, siemens, [frame, row, column], NaN outside the skin.
    pub truth: Array3<f64>,
    /// True places of the fingers, metres, `[frame][finger]`; a finger keeps its number.
    pub positions_m: Vec<Vec<[f64; 2]>>,
    /// Standard deviation of the noise, volt.
    pub noise_std_v: f64,
    /// Nodes of the mesh that simulated.
    pub nodes: usize,
}

/// Simulates a random movie; its truth is on the raster of the reconstruction.
///
/// For several noise levels of one movie take its steps: [`TouchMovie::random`],
/// [`TouchMovie::voltages`] once, [`Voltages::with_noise`] for each.
pub fn simulate(
    skin: &Skin,
    settings: &MovieSettings,
    raster: &Raster,
    progress: &mut Progress,
) -> Result<Simulated, ReportError> {
    let movie = TouchMovie::random(&skin.source, settings)?;
    let skin = skin.with_nodes(settings.nodes, progress)?;
    let voltages = movie.voltages(&skin, progress)?;
    let noise_std_v = voltages.noise_std_v(settings.noise_db);
    Ok(Simulated {
        frames: voltages.with_noise(noise_std_v, settings.noise_seed)?,
        truth: movie.truth(skin.conductivity_s, raster),
        noise_std_v,
        nodes: skin.mesh.surface().nodes().len(),
        positions_m: movie.positions_m,
    })
}

/// Where the fingers are in each frame.
#[derive(Debug, Clone, PartialEq)]
pub struct TouchMovie {
    /// Places, metres, `[frame][finger]`; a frame may be without fingers.
    pub positions_m: Vec<Vec<[f64; 2]>>,
    /// All fingers are alike.
    pub finger: Finger,
    /// Frames a second, for displays.
    pub rate_hz: f64,
}

impl TouchMovie {
    /// Fingers on random closed paths, each with the same way from frame to frame.
    ///
    /// All places lie within 0.8 of the radius (of the largest circle around the centroid of the
    /// skin that meets no rim) and at least four standard deviations of the bell from each other.
    /// The path seed decides alone, whatever mesh is used; fewer frames are the first ones of more.
    pub fn random(source: &MeshSource, settings: &MovieSettings) -> Result<Self, ReportError> {
        let MovieSettings { finger, rate_hz, .. } = *settings;
        let positions_m = paths::positions_m(source, settings)?;
        Ok(Self { positions_m, finger, rate_hz })
    }

    /// Relative conductivity change at a point.
    fn change(&self, point: [f64; 2], fingers: &[[f64; 2]]) -> f64 {
        let Finger { shape, sigma_m, change } = self.finger;
        let of_one = |finger: &[f64; 2]| {
            let square = (point[0] - finger[0]).powi(2) + (point[1] - finger[1]).powi(2);
            match shape {
                FingerShape::Bell => change * (-0.5 * square / sigma_m.powi(2)).exp(),
                FingerShape::Pad if square <= 2.0 * sigma_m.powi(2) => change,
                FingerShape::Pad => 0.0,
            }
        };
        fingers.iter().map(of_one).sum()
    }

    /// Sheet conductivity with fingers at these places: of each element that at its centroid, siemens.
    pub fn conductivity_s(
        &self,
        background_s: f64,
        centroids: &[[f64; 3]],
        fingers: &[[f64; 2]],
    ) -> Vec<f64> {
        let of = |c: &[f64; 3]| background_s * (1.0 + self.change([c[0], c[1]], fingers));
        centroids.iter().map(of).collect()
    }

    /// Voltages of the untouched skin and of each frame, without noise.
    pub fn voltages(&self, skin: &Skin, progress: &mut Progress) -> Result<Voltages, ReportError> {
        let background = skin.conductivity_s;
        let centroids = skin.mesh.surface().centroids();
        let mut workspace = skin.model.workspace()?;
        let mut solution = skin.model.solve(&skin.background_s(), &mut workspace)?;
        let reference = solution.measurements();
        let notes = rounding_warning(&solution.report())?.into_iter().collect();
        let mut frames = Array2::zeros((self.positions_m.len(), reference.len()));
        progress.steps("simulate", self.positions_m.len(), |bar| {
            // what the last solve showed, and its voltages
            let (mut shown, mut solved): (&[[f64; 2]], _) = (&[], reference.clone());
            for (mut frame, fingers) in frames.rows_mut().into_iter().zip(&self.positions_m) {
                if shown != fingers.as_slice() {
                    let conductivity = self.conductivity_s(background, &centroids, fingers);
                    solved = skin.model.solve(&conductivity, &mut workspace)?.measurements();
                    shown = fingers;
                }
                frame.assign(&solved);
                bar.inc();
            }
            Ok::<(), ReportError>(())
        })?;
        Ok(Voltages { frames, reference, rate_hz: self.rate_hz, notes })
    }

    /// True conductivity change, siemens, [frame, row, column], NaN outside the skin: the mean of
    /// each pixel, on 4 x 4 points.
    pub fn truth(&self, background_s: f64, raster: &Raster) -> Array3<f64> {
        let (side, pixel_m) = (raster.pixels(), raster.pixel_m());
        let offsets = [-0.375, -0.125, 0.125, 0.375].map(|part| part * pixel_m);
        let mut images = Array3::from_elem((self.positions_m.len(), side, side), f64::NAN);
        for (mut image, fingers) in images.axis_iter_mut(Axis(0)).zip(&self.positions_m) {
            for &[row, column] in raster.masked_pixels() {
                let [x, y] = raster.centre_m(row, column);
                let points = offsets.iter().flat_map(|dx| offsets.map(|dy| [x + dx, y + dy]));
                let sum: f64 = points.map(|point| self.change(point, fingers)).sum();
                image[[row, column]] = background_s * sum / 16.0;
            }
        }
        images
    }
}

/// Voltages of a movie without noise.
pub struct Voltages {
    /// Volt, [frame, measurement].
    pub frames: Array2<f64>,
    /// The untouched skin, volt.
    pub reference: Array1<f64>,
    /// Frames a second.
    rate_hz: f64,
    /// What rounding may have cost, where that is worth saying.
    notes: Vec<String>,
}

impl Voltages {
    /// Standard deviation of noise that lies so many decibel below the reference voltages, volt.
    pub fn noise_std_v(&self, noise_db: f64) -> f64 {
        let rms = (self.reference.dot(&self.reference) / self.reference.len() as f64).sqrt();
        10_f64.powf(-noise_db / 20.0) * rms
    }

    /// The frames with white Gaussian noise of a standard deviation in volt, and the reference with noise of its own.
    ///
    /// Noise of one seed is the same numbers at every level, only larger or smaller, so that
    /// results over levels differ by the level alone.
    pub fn with_noise(&self, std: f64, seed: u64) -> Result<Frames, ReportError> {
        if !(std.is_finite() && std >= 0.0) {
            let message = format!("noise of {std} V: it must be finite and not below zero");
            return Err(ReportError::input(message));
        }
        let mut generator = rand_pcg::Pcg64Mcg::new(u128::from(seed) << 64 | 1);
        let mut noise = || {
            let sample: f64 = rand_distr::StandardNormal.sample(&mut generator);
            std * sample
        };
        let (mut values, mut reference) = (self.frames.clone(), self.reference.clone());
        values.iter_mut().for_each(|v| *v += noise());
        reference.iter_mut().for_each(|v| *v += noise());
        Ok(Frames {
            good: Array2::from_elem(values.raw_dim(), true),
            used: vec![true; reference.len()],
            values,
            reference: reference.to_vec(),
            reference_source: "the untouched skin".to_owned(),
            reference_frames: 1,
            quiet: None,
            rate_hz: Some(self.rate_hz),
            reciprocity_error: None,
            notes: self.notes.clone(),
        })
    }
}

#[cfg(test)]
mod tests;
