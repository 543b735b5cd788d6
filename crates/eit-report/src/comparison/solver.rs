//! Methods set up for a recording, with the cost of each step.

use super::model::ReconstructionModel;
use crate::error::ReportError;
use eit_inverse::{DifferenceFrames, SequenceReport, SequenceSolver, StTv, Stop};
use eit_mesh::Raster;
use eit_skin::method::Method;
use eit_skin::scene::{Delta, DeltaRule, Hyperparameter, ReconstructionSettings, Rule};
use eit_skin::{FittedFrames, Progress, sequence, total_variation};
use ndarray::Array2;
use std::time::Instant;

/// A method, with or without a lower bound.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundedMethod {
    /// Method of reconstruction.
    pub method: Method,
    /// Lower bound on the change of conductivity; used only by total variation here.
    pub lower_s: Option<f64>,
    /// Whether total variation is that of equation (7) of the paper: equal weights of space and time, a radius for each frame.
    pub is_paper: bool,
}

impl BoundedMethod {
    /// A method without a bound.
    pub(crate) const fn free(method: Method) -> Self {
        Self { method, lower_s: None, is_paper: false }
    }

    /// Equation (7) of the paper.
    pub(crate) const fn paper() -> Self {
        Self { method: Method::StTv, lower_s: None, is_paper: true }
    }

    /// With the knowledge that touches only raise the conductivity.
    pub(crate) const fn rising(method: Method) -> Self {
        Self { method, lower_s: Some(0.0), is_paper: false }
    }

    /// Name in tables and legends.
    pub fn name(self) -> String {
        match self.lower_s {
            None if self.is_paper => format!("{}, eq. 7", self.method.name()),
            None => self.method.name().to_owned(),
            Some(_) => format!("{} ≥ 0", self.method.name()),
        }
    }

    /// Returns the settings of a skin with this bound and, for methods that have a hyperparameter,
    /// a rule for it.
    pub fn settings(self, model: &ReconstructionModel, rule: Rule) -> ReconstructionSettings {
        let mut settings = model.settings().clone();
        settings.hyperparameter = Some(Hyperparameter::Rule(rule));
        settings.lower_s = self.lower_s;
        if self.is_paper {
            settings.delta = Some(Delta::Rule(DeltaRule::Paper));
            (settings.lambda_space, settings.lambda_time) = (None, None);
        }
        settings
    }
}

/// Every method once, and st-tv with knowledge of the fabric; the slowest by far comes last.
pub const METHODS: [BoundedMethod; 6] = [
    BoundedMethod::free(Method::StTv),
    BoundedMethod::rising(Method::StTv),
    BoundedMethod::free(Method::Tv),
    BoundedMethod::free(Method::GaussNewton),
    BoundedMethod::free(Method::TimePrior),
    BoundedMethod::free(Method::GaussNewtonAbsolute),
];

/// A method set up for one recording.
pub struct Solver<'a> {
    raster: &'a Raster,
    algorithm: Algorithm<'a>,
    /// Cost before the first frame.
    pub cost: SetUpCost,
    /// Number of independent directions of the data.
    pub rank: usize,
}

/// Cost before the first frame.
#[derive(Debug, Clone)]
pub struct SetUpCost {
    /// Set-up for the skin (factorisations), seconds.
    pub set_up_s: f64,
    /// Choice of weights or hyperparameter for the recording, seconds.
    pub choice_s: f64,
    /// Description of that choice.
    pub choice: String,
}

enum Algorithm<'a> {
    /// Works on pixels.
    TotalVariation(Box<StTv>),
    /// Works on mesh elements.
    Sequence(Box<dyn SequenceSolver + 'a>),
}

/// A reconstructed recording.
pub struct ImageSequence {
    /// Images, siemens, [frame, masked pixel].
    pub pixels: Array2<f64>,
    /// Iterations, status and certificate.
    pub report: SequenceReport,
}

impl<'a> Solver<'a> {
    /// Sets up a method for frames and chooses its weights or hyperparameter.
    ///
    /// # Errors
    /// Those of the method.
    pub fn new(
        model: &'a ReconstructionModel,
        fitted: &'a FittedFrames,
        method: Method,
    ) -> Result<Self, ReportError> {
        match method.is_tv() {
            true => Self::total_variation(model, fitted, method),
            false => Self::on_elements(model, fitted, method),
        }
    }

    /// Returns the total-variation solver with its weights; `None` for other methods.
    pub fn into_total_variation(self) -> Option<StTv> {
        match self.algorithm {
            Algorithm::TotalVariation(solver) => Some(*solver),
            Algorithm::Sequence(_) => None,
        }
    }

    fn total_variation(
        model: &'a ReconstructionModel,
        fitted: &FittedFrames,
        method: Method,
    ) -> Result<Self, ReportError> {
        let start = Instant::now();
        let FittedFrames { skin, frames, .. } = fitted;
        let (raster, used) = (&model.raster, &frames.used);
        let values = fitted.differences();
        let noise = fitted.noise()?.map(|noise| noise.with_model_error(&values, &frames.good));
        let jacobian = skin.pixel_jacobian(raster, used)?;
        let settings = &skin.skin.settings.reconstruction;
        let noise_std = noise.map(|noise| noise.std);
        let mut solver =
            total_variation::solver(&jacobian, raster, method, settings, noise_std, used)?;
        let set_up_s = start.elapsed().as_secs_f64();
        let start = Instant::now();
        let differences = DifferenceFrames::all_good(values.view());
        let weights = match settings.delta {
            Some(Delta::Rule(DeltaRule::Paper)) => {
                let used = used.iter().filter(|used| **used).count();
                total_variation::weights(&mut solver, settings, &differences, raster, used)?
            }
            _ => {
                let length_m = total_variation::time_length_m(raster);
                total_variation::chosen_weights(&mut solver, &differences, length_m)?
            }
        };
        let choice = match weights.delta {
            Some(delta) => format!("delta {delta:.1}, {}", weights.rule),
            None => format!("lambda_space {:.2e}, {}", weights.lambda_space, weights.rule),
        };
        let (rank, choice_s) = (solver.rank(), start.elapsed().as_secs_f64());
        let algorithm = Algorithm::TotalVariation(Box::new(solver));
        Ok(Self { raster, algorithm, cost: SetUpCost { set_up_s, choice_s, choice }, rank })
    }

    fn on_elements(
        model: &'a ReconstructionModel,
        fitted: &'a FittedFrames,
        method: Method,
    ) -> Result<Self, ReportError> {
        let start = Instant::now();
        let imaging = fitted.one_step(&mut Progress::silent())?;
        let choice_s = start.elapsed().as_secs_f64();
        let report = imaging.difference.report();
        let mut settings = fitted.one_step_settings()?;
        settings.hyperparameter = report.hyperparameter;
        let start = Instant::now();
        let built = sequence::method(method, &fitted.skin, model.prior.as_ref(), settings)?;
        let Some(built) = built else {
            return Err(ReportError::Failure(format!("{} works on pixels", method.name())));
        };
        let set_up_s = start.elapsed().as_secs_f64();
        let choice = format!("hyperparameter {:.2e}, {}", report.hyperparameter, imaging.rule);
        Ok(Self {
            raster: &model.raster,
            algorithm: Algorithm::Sequence(built),
            cost: SetUpCost { set_up_s, choice_s, choice },
            rank: report.rank,
        })
    }

    /// Reconstructs the frames; `stop` applies to total variation.
    ///
    /// # Errors
    /// Those of the method.
    pub fn run(
        &mut self,
        differences: &DifferenceFrames<'_>,
        stop: &Stop,
    ) -> Result<ImageSequence, ReportError> {
        Ok(match &mut self.algorithm {
            Algorithm::TotalVariation(solver) => {
                let found = solver.solve(differences, stop)?;
                ImageSequence { pixels: found.images, report: found.report }
            }
            Algorithm::Sequence(method) => {
                let found = method.reconstruct_sequence(differences)?;
                let pixels = sequence::pixels_of(found.images.view(), self.raster)?;
                ImageSequence { pixels, report: found.report }
            }
        })
    }
}
