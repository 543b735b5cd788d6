//! What all parts of the report share: the skin, simulated recordings, methods set up for them.

use crate::error::ReportError;
use eit_inverse::metrics::Cells;
use eit_inverse::{DifferenceFrames, Prior, SequenceReport, SequenceSolver, StTv, Stop};
use eit_mesh::Raster;
use eit_skin::Progress;
use eit_skin::frames::Frames;
use eit_skin::method::Method;
use eit_skin::pipeline::imaging::{prior, settings};
use eit_skin::pipeline::{self, Linearised, Setup, sequence, tv};
use eit_skin::scene::{DifferenceKind, Hyperparameter, Reconstruction, Rule, Scene};
use ndarray::{Array2, ArrayView3};
use std::time::Instant;

/// A built-in skin, linearised, with its pixels.
pub(super) struct Bench {
    pub scene: Scene,
    pub setup: Setup,
    pub linearised: Linearised,
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
        let setup = pipeline::setup(&scene, None, None, progress)?;
        let linearised = pipeline::linearise(&scene, &setup, progress)?;
        let raster = pipeline::raster(&scene, &setup, progress)?;
        let prior = prior(&scene, &setup)?;
        Ok(Self { cells: Cells::of_raster(&raster), scene, setup, linearised, raster, prior })
    }

    /// Plain or normalised.
    pub fn kind(&self) -> DifferenceKind {
        self.scene.difference_kind(&self.setup.protocol)
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
    bench: &'a Bench,
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

impl<'a> Entry<'a> {
    /// Sets a method up for frames whose noise is `noise_std_v`; `rule` chooses the hyperparameter
    /// of those that have one.
    pub fn new(
        bench: &'a Bench,
        (entrant, rule): (Entrant, Rule),
        frames: &Frames,
        noise_std_v: f64,
    ) -> Result<Self, ReportError> {
        let mut scene = bench.scene.clone();
        scene.reconstruction.hyperparameter = Some(Hyperparameter::Rule(rule));
        scene.noise.additive_v = Some(noise_std_v);
        scene.reconstruction.lower_s = entrant.lower_s;
        if entrant.method.is_tv() {
            Self::total_variation(bench, &scene, entrant.method, frames)
        } else {
            Self::sequence(bench, &scene, entrant.method, frames)
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
        scene: &Scene,
        method: Method,
        frames: &Frames,
    ) -> Result<Self, ReportError> {
        let start = Instant::now();
        let (kind, raster) = (bench.kind(), &bench.raster);
        let data = pipeline::difference_data(kind, &bench.linearised);
        // the simulated skin is the model's: gain 1
        let noise = pipeline::noise::known(scene, frames, (&data, 1.0))?;
        let values = frames.differences(kind);
        let noise = noise.map(|noise| noise.with_model_error(&values, &frames.good));
        let jacobian = tv::pixel_jacobian(&bench.linearised, raster, kind, &frames.used)?;
        let keys: (Method, &Reconstruction) = (method, &scene.reconstruction);
        let noise_std = noise.map(|noise| noise.std);
        let mut solver = tv::solver(&jacobian, raster, keys, noise_std, &frames.used)?;
        let set_up_s = start.elapsed().as_secs_f64();
        let start = Instant::now();
        let differences = DifferenceFrames::all_good(values.view());
        let length_m = tv::time_length_m(raster);
        let weights = tv::chosen_weights(&mut solver, &differences, length_m)?;
        let choice = format!("lambda_space {:.2e}, {}", weights.lambda_space, weights.rule);
        let (rank, choice_s) = (solver.rank(), start.elapsed().as_secs_f64());
        let runner = Runner::Tv(Box::new(solver));
        Ok(Self { bench, runner, set_up_s, choice_s, choice, rank })
    }

    fn sequence(
        bench: &'a Bench,
        scene: &Scene,
        method: Method,
        frames: &Frames,
    ) -> Result<Self, ReportError> {
        let Bench { setup, linearised, prior, .. } = bench;
        let start = Instant::now();
        let mut silent = Progress::silent();
        let imaging = pipeline::imaging(scene, setup, linearised, frames, &mut silent)?;
        let choice_s = start.elapsed().as_secs_f64();
        let hyperparameter = imaging.difference.report().hyperparameter;
        let mut settings = settings(scene, setup, linearised, &frames.used)?;
        settings.hyperparameter = hyperparameter;
        let start = Instant::now();
        let built = sequence::method(method, scene, (setup, linearised), prior.as_ref(), settings)?;
        let Some(built) = built else {
            return Err(ReportError::Failure(format!("{} works on pixels", method.name())));
        };
        let set_up_s = start.elapsed().as_secs_f64();
        let choice = format!("hyperparameter {hyperparameter:.2e}, {}", imaging.rule);
        let (rank, runner) = (imaging.difference.report().rank, Runner::Sequence(built));
        Ok(Self { bench, runner, set_up_s, choice_s, choice, rank })
    }

    /// Reconstructs; `stop` counts for total variation. Movies are [frame, masked pixel], siemens.
    pub fn run(
        &mut self,
        differences: &DifferenceFrames<'_>,
        stop: &Stop,
    ) -> Result<(Array2<f64>, SequenceReport), ReportError> {
        match &mut self.runner {
            Runner::Tv(solver) => {
                let movie = solver.solve(differences, stop)?;
                Ok((movie.images, movie.report))
            }
            Runner::Sequence(method) => {
                let movie = method.reconstruct_sequence(differences)?;
                let pixels = sequence::pixels_of(movie.images.view(), &self.bench.raster)?;
                Ok((pixels, movie.report))
            }
        }
    }
}
