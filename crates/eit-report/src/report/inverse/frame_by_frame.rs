//! Solvers that process one frame at a time, as in `eit live`: before the first frame they know
//! only the skin and the noise. Every frame is timed separately, including those that fill a
//! window.

use super::super::named_net::NamedNet;
use super::super::work_precision::{Convergence, SolverDescription, Spread, WorkPrecisionCurve};
use super::problem::{InverseProblem, SolverRun};
use crate::comparison::{BoundedMethod, ReconstructionModel, SetUpCost};
use crate::error::ReportError;
use eit_skin::denoise::LiveNet;
use eit_skin::scene::{Hyperparameter, Rule};
use eit_skin::touches::touches;
use eit_skin::{FittedFrames, Progress};
use ndarray::Array2;
use std::time::Instant;

/// A total-variation stream and the target gap of each frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct StreamSetting {
    pub method: BoundedMethod,
    pub target_gap: f64,
}

/// Makes the image of a frame from its values and its differences.
type FrameSolver<'a> =
    Box<dyn FnMut(&[f64], &[f64], &mut [f64]) -> Result<Convergence, ReportError> + 'a>;

/// One-step Gauss-Newton images by one matrix, with and without a network. With cross-validation
/// the method knows the recording and does not count as live.
pub(super) fn one_step(
    problem: &InverseProblem<'_>,
    model: &ReconstructionModel,
    rule: Rule,
    net: Option<&NamedNet>,
) -> Result<WorkPrecisionCurve, ReportError> {
    let mut settings = model.settings().clone();
    settings.hyperparameter = Some(Hyperparameter::Rule(rule));
    let fitted = problem.fit_with(model, settings);
    let mut silent = Progress::silent();
    let start = Instant::now();
    let imaging = fitted.one_step(&mut silent)?;
    let report = imaging.difference.report();
    let reconstructor = imaging.difference.on_raster(model.raster.pixel_from_element())?;
    let all_s = start.elapsed().as_secs_f64();
    let of_rule = silent.times().iter().find(|stage| stage.stage == "hyperparameter");
    let is_live = rule == Rule::NoiseFigure;
    let choice_s = if is_live { 0.0 } else { of_rule.map_or(0.0, |stage| stage.time_s) };
    let choice = format!("hyperparameter {:.2e}, {}", report.hyperparameter, imaging.rule);
    let (reconstructor, reference) = (&reconstructor, &fitted.frames.reference);
    let solver = || {
        let mut workspace = reconstructor.workspace();
        let solver: FrameSolver<'_> = Box::new(move |values, _, image| {
            reconstructor.reconstruct_into(values, reference, &mut workspace, image)?;
            Ok(Convergence::DIRECT)
        });
        Ok::<_, ReportError>(solver)
    };
    let live = LiveRuns { problem, model, net, runs: problem.size.direct_runs };
    let (images, run) = live.run(&fitted, &solver)?;
    let floor_s = problem.roofline.one_step(model, report.rank);
    let description = SolverDescription::own("gauss-newton", Some(model.raster.pixels()), is_live);
    let cost = SetUpCost { set_up_s: all_s - choice_s, choice_s, choice };
    live.curve(description.with_rule(rule), cost, &images, SolverRun { floor_s, ..run })
}

/// Total variation frame by frame, with and without a network.
pub(super) fn stream(
    problem: &InverseProblem<'_>,
    model: &ReconstructionModel,
    setting: StreamSetting,
    net: Option<&NamedNet>,
) -> Result<WorkPrecisionCurve, ReportError> {
    let StreamSetting { method, target_gap } = setting;
    let mut settings = model.settings().clone();
    settings.lower_s = method.lower_s;
    settings.target_gap = Some(target_gap);
    let fitted = problem.fit_with(model, settings);
    let start = Instant::now();
    let first = fitted.tv_stream(method.method, &mut Progress::silent())?;
    let (set_up_s, choice) = (start.elapsed().as_secs_f64(), first.description());
    let solver = || {
        let mut stream = fitted.tv_stream(method.method, &mut Progress::silent())?;
        let solver: FrameSolver<'_> = Box::new(move |_, differences, image| {
            let step = stream.push(differences, None)?;
            image.copy_from_slice(step.image);
            let gap = Some(step.certificate.relative_gap());
            Ok(Convergence { iterations: step.iterations, status: step.status, gap })
        });
        Ok::<_, ReportError>(solver)
    };
    let live = LiveRuns { problem, model, net, runs: problem.size.stream_runs };
    let (images, run) = live.run(&fitted, &solver)?;
    let each = run.convergence.iterations as f64 / problem.frames() as f64;
    let floor_s = problem.roofline.total_variation(model, 1, each);
    let name = format!("{} stream", method.name());
    let description = SolverDescription::own(name, Some(model.raster.pixels()), true);
    let cost = SetUpCost { set_up_s, choice_s: 0.0, choice };
    let run = SolverRun { floor_s, target_gap: Some(target_gap), ..run };
    live.curve(description, cost, &images, run)
}

/// Repeated runs over all frames of a solver, optionally followed by a network.
struct LiveRuns<'a> {
    problem: &'a InverseProblem<'a>,
    model: &'a ReconstructionModel,
    net: Option<&'a NamedNet>,
    runs: usize,
}

impl LiveRuns<'_> {
    /// Runs solvers; returns the images of the last run, [frame, masked pixel] on the model's raster,
    /// its convergence, and the time of each frame in each run. The floor is still unknown.
    fn run<'s>(
        &self,
        fitted: &'s FittedFrames,
        solver: &dyn Fn() -> Result<FrameSolver<'s>, ReportError>,
    ) -> Result<(Array2<f64>, SolverRun), ReportError> {
        let raster = &self.model.raster;
        let values: Vec<Vec<f64>> =
            fitted.frames.values.rows().into_iter().map(|row| row.to_vec()).collect();
        let differences: Vec<Vec<f64>> =
            fitted.differences().rows().into_iter().map(|row| row.to_vec()).collect();
        let pixels = raster.masked_pixels().len();
        let mut images = Array2::zeros((values.len(), pixels));
        let (mut raw, mut made) = (vec![0.0; pixels], vec![0.0; pixels]);
        let mut seconds = Vec::new();
        let mut convergence = Convergence::DIRECT;
        // the chain finds touches in every frame, whatever is done with its image
        let touches = match self.net {
            Some(_) => touches(fitted, &mut Progress::silent())?.map(|touches| touches.by_frame()),
            None => None,
        };
        // set up before any run is timed
        let solvers = (0..self.runs).map(|_| solver()).collect::<Result<Vec<_>, _>>()?;
        for mut solver in solvers {
            let mut net = self.net.map(|named| LiveNet::new(&named.net, fitted)).transpose()?;
            let mut worst: Option<Convergence> = None;
            for (k, mut row) in images.rows_mut().into_iter().enumerate() {
                let start = Instant::now();
                let step = solver(&values[k], &differences[k], &mut raw)?;
                let shown = match &mut net {
                    None => &raw,
                    Some(net) => {
                        let touches = touches.as_ref().and_then(|touches| touches.get(k));
                        let touches = touches.map_or(&[][..], Vec::as_slice);
                        net.push(raster, &raw, &differences[k], touches, true, &mut made)?;
                        &made
                    }
                };
                seconds.push(start.elapsed().as_secs_f64());
                row.iter_mut().zip(shown).for_each(|(out, value)| *out = *value);
                worst = Some(worst.map_or(step, |worst| worst.and(step)));
            }
            convergence = worst.unwrap_or(convergence);
        }
        let time = Spread::of(seconds, 1);
        Ok((images, SolverRun { time, floor_s: f64::NAN, convergence, target_gap: None }))
    }

    /// Evaluates the images; the floor in `run` does not include the network yet.
    fn curve(
        &self,
        mut description: SolverDescription,
        cost: SetUpCost,
        images: &Array2<f64>,
        mut run: SolverRun,
    ) -> Result<WorkPrecisionCurve, ReportError> {
        if let Some(NamedNet { name, net }) = self.net {
            description.name = format!("{}, {name}", description.name);
            run.floor_s += self.problem.roofline.net(net.shape(), self.model);
        }
        let images = self.problem.on_finest(self.model, images.view())?;
        self.problem.curve(description, cost, images, &run)
    }
}
