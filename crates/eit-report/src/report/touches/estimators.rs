//! The touch estimators that are compared, set up for one noise level: image and segmentation, or
//! direct fit.

use super::detectors::{OneStepDetector, difference, total_variation};
use super::simulated_disc::{AMPLITUDE, RADIUS_M, SimulatedDisc};
use crate::error::ReportError;
use eit_fem::fabric::Random;
use eit_inverse::touch::{
    Bell, FitResult, FitSettings, NoiseFloor, Touch, TouchFit, TouchStream, TouchStreamSettings,
};
use eit_inverse::{DifferenceFrames, Reconstructor, StTv, Stop, Workspace};
use eit_skin::Skin;
use ndarray::Array2;

/// Noise added to quiet ST-TV images, relative to the peak of a touch: most of their pixels are
/// exactly zero, but a standard deviation must not be.
const JITTER: f64 = 1e-3;

/// Gap of ST-TV, the default of `eit reconstruct`.
const TARGET_GAP: f64 = 1e-2;

/// A method to estimate touches in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Estimator {
    /// Segmentation of the one-step image.
    OneStepImage,
    /// Segmentation of the ST-TV image.
    StTvImage,
    /// Bells fitted to the frame on the forward model.
    BellFit,
}

impl Estimator {
    /// All estimators, in the order of the tables.
    pub const ALL: [Self; 3] = [Self::OneStepImage, Self::StTvImage, Self::BellFit];

    /// Name in tables and legends.
    pub fn name(self) -> &'static str {
        match self {
            Self::OneStepImage => "one-step image",
            Self::StTvImage => "st-tv image",
            Self::BellFit => "fit",
        }
    }
}

/// ST-TV of single frames, with the noise level of its images.
struct StTvDetector {
    solver: StTv,
    touches: TouchStream,
}

/// Every estimator at one noise level.
pub(super) struct TouchEstimators<'a> {
    pub disc: &'a SimulatedDisc,
    /// Noise, decibels below the reference voltages.
    pub noise_db: f64,
    /// Standard deviation of the noise of a difference, volts.
    pub noise_std_v: f64,
    one_step: Reconstructor,
    workspace: Workspace,
    one_step_touches: TouchStream,
    st_tv: Option<StTvDetector>,
    /// Number of quiet frames used to measure the noise of ST-TV images.
    quiet_frames: usize,
    /// Fit of bells on the forward model.
    pub fit: TouchFit<'a>,
    pixels: Vec<f64>,
}

impl<'a> TouchEstimators<'a> {
    /// Sets up the estimators for a noise level, with the mesh that a fit of one touch needs at
    /// that level.
    pub fn new(
        disc: &'a SimulatedDisc,
        noise_db: f64,
        quiet_frames: usize,
    ) -> Result<Self, ReportError> {
        Self::fitting_on(disc.fit_skin(noise_db), disc, noise_db, quiet_frames)
    }

    /// Sets up the estimators for a noise level and a mesh for fitting.
    pub fn fitting_on(
        fit_skin: &'a Skin,
        disc: &'a SimulatedDisc,
        noise_db: f64,
        quiet_frames: usize,
    ) -> Result<Self, ReportError> {
        let noise_std_v = disc.noise_std_v(noise_db);
        let OneStepDetector { reconstructor, floor } = OneStepDetector::new(disc, noise_std_v)?;
        let touches = TouchStream::new(disc.cells.clone(), floor, every_image_alone())?;
        let settings = FitSettings::with_noise(vec![noise_std_v; disc.reference_v.len()]);
        let (model, surface) = (&fit_skin.model, fit_skin.mesh.surface());
        let fit = TouchFit::new(model, surface, &fit_skin.background_s(), settings)?;
        Ok(Self {
            disc,
            noise_db,
            noise_std_v,
            workspace: reconstructor.workspace(),
            pixels: vec![0.0; reconstructor.image_len()],
            one_step: reconstructor,
            one_step_touches: touches,
            st_tv: None,
            quiet_frames,
            fit,
        })
    }

    /// Touches in a one-step image, the strongest first.
    pub fn one_step(
        &mut self,
        frame: &[f64],
        reference: &[f64],
    ) -> Result<Vec<Touch>, ReportError> {
        let image = &mut self.pixels;
        self.one_step.reconstruct_into(frame, reference, &mut self.workspace, image)?;
        strongest_first(&self.one_step_touches, image)
    }

    /// Chooses the weights of ST-TV on frames and measures its noise with them.
    pub fn prepare_st_tv(
        &mut self,
        frames: Array2<f64>,
        reference: &[f64],
    ) -> Result<(), ReportError> {
        let mut solver = total_variation(self.disc, frames, reference, self.noise_std_v)?;
        let mut random = Random::named(5, "quiet frames", 0);
        let mut images = Array2::zeros((self.quiet_frames, self.pixels.len()));
        let jitter = JITTER * AMPLITUDE * self.disc.conductivity_s();
        for mut row in images.rows_mut() {
            let quiet = random.noisy(reference, self.noise_std_v);
            let image = st_tv_image(self.disc, &mut solver, &quiet, reference)?;
            row.iter_mut().zip(&image).for_each(|(r, x)| *r = x + jitter * random.normal());
        }
        let floor = NoiseFloor::of_quiet_images(images.view())?;
        let touches = TouchStream::new(self.disc.cells.clone(), floor, every_image_alone())?;
        self.st_tv = Some(StTvDetector { solver, touches });
        Ok(())
    }

    /// Touches in the ST-TV image of a single frame, the strongest first; none before
    /// [`prepare_st_tv`](Self::prepare_st_tv).
    pub fn st_tv(&mut self, frame: &[f64], reference: &[f64]) -> Result<Vec<Touch>, ReportError> {
        let Some(StTvDetector { solver, touches }) = &mut self.st_tv else {
            return Ok(Vec::new());
        };
        let image = st_tv_image(self.disc, solver, frame, reference)?;
        strongest_first(touches, &image)
    }

    /// Initial bells for the fit: those of a one-step image, or its highest pixel if it shows none.
    pub fn starts(&mut self, frame: &[f64], reference: &[f64]) -> Result<Vec<Bell>, ReportError> {
        let touches = self.one_step(frame, reference)?;
        if touches.is_empty() {
            let highest = self.pixels.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
            let place = highest.map_or([0.0; 3], |(k, _)| self.disc.cells.positions_m()[k]);
            return Ok(vec![Bell { position_m: place, amplitude: 0.2, radius_m: RADIUS_M }]);
        }
        let conductivity_s = self.disc.conductivity_s();
        Ok(touches.iter().map(|touch| start(touch, conductivity_s)).collect())
    }

    /// Fits one bell, starting from the strongest.
    pub fn one_bell(&mut self, frame: &[f64], reference: &[f64]) -> Result<FitResult, ReportError> {
        let starts = self.starts(frame, reference)?;
        Ok(self.fit.fit(frame, reference, &starts[..1])?)
    }
}

/// A bell resembling a touch: half of its peak is at `radius sqrt(2 ln 2)`.
fn start(touch: &Touch, conductivity_s: f64) -> Bell {
    let radius_m = (touch.area_m2.unwrap_or_default()
        / (2.0 * std::f64::consts::LN_2 * std::f64::consts::PI))
        .sqrt();
    Bell {
        position_m: touch.position_m,
        amplitude: (touch.peak_s / conductivity_s).clamp(-0.5, 2.0),
        radius_m: radius_m.clamp(4e-3, 0.03),
    }
}

/// Settings that evaluate every image separately.
fn every_image_alone() -> TouchStreamSettings {
    TouchStreamSettings { birth_hits: 1, birth_frames: 1, ..Default::default() }
}

/// Touches in one image, by a new stream.
fn strongest_first(stream: &TouchStream, image: &[f64]) -> Result<Vec<Touch>, ReportError> {
    let mut touches = stream.clone().push(image, 0.0)?.to_vec();
    touches.sort_by(|a, b| b.peak_s.total_cmp(&a.peak_s));
    Ok(touches)
}

/// The ST-TV image of a single frame.
fn st_tv_image(
    disc: &SimulatedDisc,
    solver: &mut StTv,
    frame: &[f64],
    reference: &[f64],
) -> Result<Vec<f64>, ReportError> {
    let values = difference(disc, frame, reference);
    let stop = Stop { target_gap: TARGET_GAP, ..Default::default() };
    let found = solver.solve(&DifferenceFrames::all_good(values.view()), &stop)?;
    Ok(found.images.row(0).to_vec())
}
