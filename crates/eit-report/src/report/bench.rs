//! What all parts of the report share: the skin, simulated recordings, methods set up for them.

use crate::error::ReportError;
use eit_inverse::metrics::Cells;
use eit_inverse::{DifferenceFrames, Prior, SequenceReport, SequenceSolver, StTv, Stop};
use eit_mesh::Raster;
use eit_skin::frames::{Frames, ModelFit};
use eit_skin::method::Method;
use eit_skin::scene::{DifferenceKind, Hyperparameter, ReconstructionSettings, Rule};
use eit_skin::{
    FittedFrames, LinearisedSkin, MeshOverride, Progress, Scene, Skin, sequence, total_variation,
};
use ndarray::{Array2, ArrayView3};
use std::sync::Arc;
use std::time::Instant;

/// A built-in skin, linearised, with its pixels.
pub(super) struct Bench {
    pub linearised: LinearisedSkin,
    pub raster: Raster,
    pub cells: Cells<2>,
    pub prior: Box<dyn Prior + Send + Sync>,
}

impl Bench {
    /// The paper's skin with so many pixels along its diameter.
    pub fn new(pixels: usize, progress: &mut Progress) -> Result<Self, ReportError> {
        Self::of("paper-disc", pixels, progress)
    }

    /// A scene with so many pixels along its skin.
    pub fn of(scene: &str, pixels: usize, progress: &mut Progress) -> Result<Self, ReportError> {
        let mut scene = Scene::load(scene)?;
        scene.reconstruction.pixels = Some(pixels);
        let skin = Skin::set_up(&scene, &MeshOverride::default(), progress)?;
        let linearised = skin.linearise(progress)?;
        let raster = linearised.raster(progress)?.clone();
        let prior = linearised.prior()?;
        Ok(Self { cells: Cells::of_raster(&raster), linearised, raster, prior })
    }

    /// The skin.
    pub fn skin(&self) -> &Skin {
        &self.linearised.skin
    }

    /// Plain or normalised.
    pub fn kind(&self) -> DifferenceKind {
        self.linearised.difference_kind()
    }

    /// Frames whose noise is known, to be reconstructed with these settings. Their skin is the model's:
    /// gain 1.
    pub fn fitted(
        &self,
        frames: &Frames,
        noise_std_v: f64,
        settings: ReconstructionSettings,
    ) -> FittedFrames {
        let mut linearised = self.linearised.clone().with_reconstruction(settings);
        linearised.skin.settings.noise.additive_v = Some(noise_std_v);
        let fit = ModelFit { gain: 1.0, correlation: 1.0 };
        FittedFrames { skin: Arc::new(linearised), frames: frames.clone(), fit }
    }

    /// The masked pixels of images [frame, row, column]: [frame, masked pixel].
    pub fn pixels_of(&self, images: ArrayView3<'_, f64>) -> Result<Array2<f64>, ReportError> {
        let mut pixels = Array2::zeros((images.shape()[0], self.raster.masked_pixels().len()));
        for (image, mut row) in images.outer_iter().zip(pixels.rows_mut()) {
            if let Some(row) = row.as_slice_mut() {
                self.raster.pixels_from_image_into(image, row)?;
            }
        }
        Ok(pixels)
    }
}

/// A method of the report.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Entrant {
    pub method: Method,
    /// Least change of conductivity; only total variation takes it here.
    pub lower_s: Option<f64>,
}

impl Entrant {
    /// In tables and legends.
    pub fn name(self) -> String {
        match self.lower_s {
            None => self.method.name().to_owned(),
            Some(_) => format!("{} ≥ 0", self.method.name()),
        }
    }

    /// The skin's settings with this bound, and with a rule for the hyperparameter of those that have
    /// one.
    pub fn settings(self, bench: &Bench, rule: Rule) -> ReconstructionSettings {
        let mut settings = bench.skin().settings.reconstruction.clone();
        settings.hyperparameter = Some(Hyperparameter::Rule(rule));
        settings.lower_s = self.lower_s;
        settings
    }
}

/// Every method once, and st-tv with what is known of the fabric; the slowest by far comes last.
pub(super) const ENTRANTS: [Entrant; 7] = [
    Entrant { method: Method::StTv, lower_s: None },
    Entrant { method: Method::StTv, lower_s: Some(0.0) },
    Entrant { method: Method::Tv, lower_s: None },
    Entrant { method: Method::GaussNewton, lower_s: None },
    Entrant { method: Method::TimePrior, lower_s: None },
    Entrant { method: Method::Kalman, lower_s: None },
    Entrant { method: Method::GaussNewtonAbsolute, lower_s: None },
];

/// A method set up for one recording.
pub(super) struct Entry<'a> {
    raster: &'a Raster,
    runner: Runner<'a>,
    /// Set-up for the skin: factorisations.
    pub set_up_s: f64,
    /// Choice of weights or hyperparameter for the recording.
    pub choice_s: f64,
    /// That choice in words.
    pub choice: String,
    /// Independent directions of the data.
    pub rank: usize,
}

enum Runner<'a> {
    Tv(Box<StTv>),
    Sequence(Box<dyn SequenceSolver + 'a>),
}

/// What an [`Entry`] makes of a recording.
pub(super) struct Sequence {
    /// Siemens, [frame, masked pixel].
    pub pixels: Array2<f64>,
    pub report: SequenceReport,
}

impl<'a> Entry<'a> {
    /// Sets a method up for frames.
    pub fn new(
        bench: &'a Bench,
        fitted: &'a FittedFrames,
        method: Method,
    ) -> Result<Self, ReportError> {
        match method.is_tv() {
            true => Self::total_variation(bench, fitted, method),
            false => Self::sequence(bench, fitted, method),
        }
    }

    /// The solver of total variation with its weights; `None` for other methods.
    pub fn into_tv(self) -> Option<StTv> {
        match self.runner {
            Runner::Tv(solver) => Some(*solver),
            Runner::Sequence(_) => None,
        }
    }

    fn total_variation(
        bench: &'a Bench,
        fitted: &FittedFrames,
        method: Method,
    ) -> Result<Self, ReportError> {
        let start = Instant::now();
        let FittedFrames { skin, frames, .. } = fitted;
        let (raster, used) = (&bench.raster, &frames.used);
        let values = fitted.differences();
        let noise = fitted.noise()?.map(|noise| noise.with_model_error(&values, &frames.good));
        let jacobian = skin.pixel_jacobian(raster, used)?;
        let keys = &skin.skin.settings.reconstruction;
        let noise_std = noise.map(|noise| noise.std);
        let mut solver = total_variation::solver(&jacobian, raster, method, keys, noise_std, used)?;
        let set_up_s = start.elapsed().as_secs_f64();
        let start = Instant::now();
        let differences = DifferenceFrames::all_good(values.view());
        let length_m = total_variation::time_length_m(raster);
        let weights = total_variation::chosen_weights(&mut solver, &differences, length_m)?;
        let choice = format!("lambda_space {:.2e}, {}", weights.lambda_space, weights.rule);
        let (rank, choice_s) = (solver.rank(), start.elapsed().as_secs_f64());
        let runner = Runner::Tv(Box::new(solver));
        Ok(Self { raster, runner, set_up_s, choice_s, choice, rank })
    }

    fn sequence(
        bench: &'a Bench,
        fitted: &'a FittedFrames,
        method: Method,
    ) -> Result<Self, ReportError> {
        let start = Instant::now();
        let imaging = fitted.one_step(&mut Progress::silent())?;
        let choice_s = start.elapsed().as_secs_f64();
        let hyperparameter = imaging.difference.report().hyperparameter;
        let mut settings = fitted.one_step_settings()?;
        settings.hyperparameter = hyperparameter;
        let start = Instant::now();
        let built = sequence::method(method, &fitted.skin, bench.prior.as_ref(), settings)?;
        let Some(built) = built else {
            return Err(ReportError::Failure(format!("{} works on pixels", method.name())));
        };
        let set_up_s = start.elapsed().as_secs_f64();
        let choice = format!("hyperparameter {hyperparameter:.2e}, {}", imaging.rule);
        let (rank, runner) = (imaging.difference.report().rank, Runner::Sequence(built));
        Ok(Self { raster: &bench.raster, runner, set_up_s, choice_s, choice, rank })
    }

    /// Reconstructs; `stop` counts for total variation.
    pub fn run(
        &mut self,
        differences: &DifferenceFrames<'_>,
        stop: &Stop,
    ) -> Result<Sequence, ReportError> {
        Ok(match &mut self.runner {
            Runner::Tv(solver) => {
                let found = solver.solve(differences, stop)?;
                Sequence { pixels: found.images, report: found.report }
            }
            Runner::Sequence(method) => {
                let found = method.reconstruct_sequence(differences)?;
                let pixels = sequence::pixels_of(found.images.view(), self.raster)?;
                Sequence { pixels, report: found.report }
            }
        })
    }
}
