//! Solvers that process one frame at a time, as in `eit live`: before the first frame they know
//! only the skin and the noise. Every frame is timed separately, including those that fill a
//! window.

use super::super::named_net::NamedNet;
use super::super::work_precision::{Convergence, SolverDescription, Spread, WorkPrecisionCurve};
use super::problem::{InverseProblem, SolverRun};
use crate::comparison::ReconstructionModel;
use crate::comparison::{BoundedMethod, SetUpCost};
use crate::error::ReportError;
use eit_inverse::{Reconstructor, SequenceStatus, Workspace};
use eit_skin::denoise::LiveNet;
use eit_skin::scene::{Hyperparameter, Rule};
use eit_skin::total_variation::TvStream;
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

/// One-step Gauss-Newton images by one matrix, with and without a network. With cross-validation
/// the method has seen the recording and does not count as live.
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
    let solver = || FrameSolver::OneStep {
        workspace: Box::new(reconstructor.workspace()),
        reconstructor: &reconstructor,
        reference: &fitted.frames.reference,
    };
    let solvers = std::iter::repeat_with(solver).take(problem.size.direct_runs).collect();
    let FrameTimes { images, seconds, .. } = frame_by_frame(model, &fitted, net, solvers)?;
    let description = SolverDescription::own("gauss-newton", Some(model.raster.pixels()), is_live);
    let live = LiveSolver {
        model,
        net,
        description: description.with_rule(rule),
        cost: SetUpCost { set_up_s: all_s - choice_s, choice_s, choice },
    };
    let run = SolverRun {
        time: Spread::of(seconds, 1),
        floor_s: problem.roofline.one_step(model, report.rank),
        convergence: Convergence::DIRECT,
        target_gap: None,
    };
    live.curve(problem, &images, run)
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
    let (set_up_s, choice) = (start.elapsed().as_secs_f64(), first.words());
    let solver = || {
        let made = fitted.tv_stream(method.method, &mut Progress::silent())?;
        let worst =
            Convergence { iterations: 0, status: SequenceStatus::Converged, gap: Some(0.0) };
        Ok::<_, ReportError>(FrameSolver::Stream { stream: Box::new(made), worst })
    };
    let solvers = (0..problem.size.stream_runs).map(|_| solver()).collect::<Result<_, _>>()?;
    let FrameTimes { images, seconds, convergence } = frame_by_frame(model, &fitted, net, solvers)?;
    let each = convergence.iterations as f64 / problem.frames() as f64;
    let name = format!("{} stream", method.name());
    let live = LiveSolver {
        model,
        net,
        description: SolverDescription::own(name, Some(model.raster.pixels()), true),
        cost: SetUpCost { set_up_s, choice_s: 0.0, choice },
    };
    let run = SolverRun {
        time: Spread::of(seconds, 1),
        floor_s: problem.roofline.total_variation(model, 1, each),
        convergence,
        target_gap: Some(target_gap),
    };
    live.curve(problem, &images, run)
}

/// Reconstructs the image of a frame.
enum FrameSolver<'a> {
    OneStep {
        reconstructor: &'a Reconstructor,
        workspace: Box<Workspace>,
        reference: &'a [f64],
    },
    /// Also records iterations, worst status and worst gap.
    Stream {
        stream: Box<TvStream>,
        worst: Convergence,
    },
}

impl FrameSolver<'_> {
    fn next(
        &mut self,
        values: &[f64],
        differences: &[f64],
        image: &mut [f64],
    ) -> Result<(), ReportError> {
        match self {
            Self::OneStep { reconstructor, workspace, reference } => {
                reconstructor.reconstruct_into(values, reference, workspace, image)?;
            }
            Self::Stream { stream, worst } => {
                let step = stream.push(differences, None)?;
                worst.iterations += step.iterations;
                let gap = step.certificate.relative_gap();
                worst.gap = Some(worst.gap.map_or(gap, |worst| worst.max(gap)));
                if step.status != SequenceStatus::Converged {
                    worst.status = step.status;
                }
                image.copy_from_slice(step.image.unwrap_or_default());
            }
        }
        Ok(())
    }
}

/// Images on a model's raster, and the time of each frame in each run.
struct FrameTimes {
    /// [frame, masked pixel].
    images: Array2<f64>,
    seconds: Vec<f64>,
    /// Convergence of the last run.
    convergence: Convergence,
}

/// Runs a solver over all frames, repeatedly.
fn frame_by_frame(
    model: &ReconstructionModel,
    fitted: &FittedFrames,
    net: Option<&NamedNet>,
    solvers: Vec<FrameSolver<'_>>,
) -> Result<FrameTimes, ReportError> {
    let differences = fitted.differences();
    let rows = |array: &Array2<f64>| -> Vec<Vec<f64>> {
        array.rows().into_iter().map(|row| row.to_vec()).collect()
    };
    let (values, differences) = (rows(&fitted.frames.values), rows(&differences));
    let pixels = model.raster.masked_pixels().len();
    let mut images = Array2::zeros((values.len(), pixels));
    let (mut raw, mut made) = (vec![0.0; pixels], vec![0.0; pixels]);
    let mut seconds = Vec::new();
    let mut convergence = Convergence::DIRECT;
    // the chain finds touches in every frame, whatever is done with its image
    let touches = match net {
        Some(_) => {
            touches(fitted, &mut Progress::silent())?.map_or_else(Vec::new, |t| t.by_frame())
        }
        None => Vec::new(),
    };
    for mut solver in solvers {
        let mut net = net.map(|named| LiveNet::new(&named.net, fitted)).transpose()?;
        for (k, ((values, differences), mut row)) in
            values.iter().zip(&differences).zip(images.rows_mut()).enumerate()
        {
            let start = Instant::now();
            solver.next(values, differences, &mut raw)?;
            let shown = match &mut net {
                None => &raw,
                Some(net) => {
                    let touches = touches.get(k).map_or(&[][..], Vec::as_slice);
                    net.push(&model.raster, &raw, differences, touches, true, &mut made)?;
                    &made
                }
            };
            seconds.push(start.elapsed().as_secs_f64());
            row.iter_mut().zip(shown).for_each(|(out, value)| *out = *value);
        }
        if let FrameSolver::Stream { worst, .. } = solver {
            convergence = worst;
        }
    }
    Ok(FrameTimes { images, seconds, convergence })
}

/// A solver that processes one frame at a time, optionally followed by a network.
struct LiveSolver<'a> {
    model: &'a ReconstructionModel,
    net: Option<&'a NamedNet>,
    description: SolverDescription,
    cost: SetUpCost,
}

impl LiveSolver<'_> {
    /// Evaluates its images; the floor in `run` does not include the network yet.
    fn curve(
        mut self,
        problem: &InverseProblem<'_>,
        images: &Array2<f64>,
        mut run: SolverRun,
    ) -> Result<WorkPrecisionCurve, ReportError> {
        if let Some(NamedNet { name, net }) = self.net {
            self.description.name = format!("{}, {name}", self.description.name);
            run.floor_s += problem.roofline.net(net.shape(), self.model);
        }
        let images = problem.on_finest(self.model, images.view())?;
        problem.curve(self.description, self.cost, images, &run)
    }
}
