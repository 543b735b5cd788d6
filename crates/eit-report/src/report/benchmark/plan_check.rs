//! Compares the predictions of `eit plan` for a scene with measurements.

use super::super::reconstruction_model::ReconstructionModel;
use super::super::scores::{Scores, Truth};
use super::super::solver::{BoundedMethod, ImageSequence, Solver};
use super::recording::SimulatedRecording;
use super::roofline::Roofline;
use crate::error::ReportError;
use eit_core::median;
use eit_inverse::DifferenceFrames;
use eit_skin::method::{self, Method};
use eit_skin::plan::expected::Expected;
use eit_skin::plan::sequence::Sequence;
use eit_skin::plan::stages;
use eit_skin::scene::{DenoiseSettings, Rule};
use eit_skin::{Progress, Skin, total_variation};
use ndarray::Array2;
use std::time::Instant;

/// Number of timings of each stage; the median counts.
const REPEATS: usize = 3;

/// The plan of a method compared with measurements.
#[derive(Debug, Clone)]
pub(super) struct PlanCheck {
    pub method: Method,
    pub stages: Vec<StageCheck>,
    /// Relative error that the plan expects, if it knows one.
    pub expected_error: Option<f64>,
    /// Relative error in this run: root mean square over the recordings.
    pub measured_error: f64,
}

/// Planned and measured time of a stage.
#[derive(Debug, Clone)]
pub(super) struct StageCheck {
    pub stage: &'static str,
    /// Seconds that the plan expects.
    pub planned_s: f64,
    /// Mean over the recordings, seconds.
    pub measured_s: f64,
}

/// Runs the scene as its user would, with its own method and with one-step images, on recordings
/// that are not in the plan's table, and compares the results.
///
/// The scene of a fabric gets `[denoise]`, as in `eit demo`, because its noise alone does not
/// identify it.
pub(super) fn of(
    model: &ReconstructionModel,
    is_fabric: bool,
    recordings: &[SimulatedRecording],
    roofline: &Roofline,
) -> Result<Vec<PlanCheck>, ReportError> {
    let Some(first) = recordings.first() else { return Ok(Vec::new()) };
    let mut skin = model.skin().clone();
    skin.settings.noise.additive_v = Some(first.simulated.noise_std_v);
    if is_fabric {
        let weights = "default".to_owned();
        skin.settings.denoise = Some(DenoiseSettings { weights, any_skin: false });
    }
    let own = method::choose(&skin.settings, None, Some(first.truth.nrows()))?.method;
    let planned = PlannedSkin { skin, noise_std_v: first.simulated.noise_std_v, model };
    let methods = [own, Method::GaussNewton];
    methods.into_iter().map(|method| planned.check(method, recordings, roofline)).collect()
}

/// A skin as its plan sees it, and the model used to reconstruct.
struct PlannedSkin<'a> {
    skin: Skin,
    /// Noise given to the plan, volts: that of the first recording.
    noise_std_v: f64,
    model: &'a ReconstructionModel,
}

/// Median time of a stage.
struct StageTime {
    stage: &'static str,
    time_s: f64,
}

/// Results for one recording.
struct MeasuredRun {
    times: Vec<StageTime>,
    /// Relative error of the images.
    error: f64,
}

/// Images and the times of the stages that computed them.
struct TimedImages {
    /// [frame, masked pixel].
    pixels: Array2<f64>,
    times: Vec<StageTime>,
}

impl PlannedSkin<'_> {
    fn check(
        &self,
        method: Method,
        recordings: &[SimulatedRecording],
        roofline: &Roofline,
    ) -> Result<PlanCheck, ReportError> {
        let measured: Vec<MeasuredRun> = recordings
            .iter()
            .map(|recording| self.measure(method, recording))
            .collect::<Result<_, _>>()?;
        let frames = recordings.first().map_or(0, |recording| recording.truth.nrows());
        let voltages = self.model.linearised.voltages.to_vec();
        let (skin, machine) = (&self.skin, &roofline.machine);
        let expected = Expected::of(skin, method, Some(frames), &voltages, machine)?;
        let row = expected.row.as_ref();
        let planned = stages::of(skin, method, Sequence::Frames(frames), machine, row);
        let count = measured.len() as f64;
        let both = planned.iter().filter_map(|stage| {
            let of = |run: &MeasuredRun| {
                run.times.iter().find(|time| time.stage == stage.name).map(|time| time.time_s)
            };
            let found: Option<f64> = measured.iter().map(of).sum();
            found.map(|seconds| StageCheck {
                stage: stage.name,
                planned_s: stage.time_s,
                measured_s: seconds / count,
            })
        });
        let squares: f64 = measured.iter().map(|run| run.error * run.error).sum();
        Ok(PlanCheck {
            method,
            stages: both.collect(),
            expected_error: expected.error(),
            measured_error: (squares / count).sqrt(),
        })
    }

    fn measure(
        &self,
        method: Method,
        recording: &SimulatedRecording,
    ) -> Result<MeasuredRun, ReportError> {
        let mut times = forward_times(&self.skin)?;
        let TimedImages { pixels, times: of_images } = match method.is_tv() {
            true => self.total_variation(method, recording)?,
            false => self.one_step(recording)?,
        };
        times.extend(of_images);
        let positions_m = &recording.simulated.positions_m;
        let truth = Truth { pixels: &recording.truth, positions_m };
        let error = Scores::new(self.model, pixels.view(), &truth)?.relative_error;
        Ok(MeasuredRun { times, error })
    }

    fn total_variation(
        &self,
        method: Method,
        recording: &SimulatedRecording,
    ) -> Result<TimedImages, ReportError> {
        let (model, simulated) = (self.model, &recording.simulated);
        let bounded = BoundedMethod { method, lower_s: model.settings().lower_s };
        let settings = bounded.settings(model, Rule::NoiseFigure);
        let fitted = model.fit(&simulated.frames, simulated.noise_std_v, settings);
        let build = || Solver::new(model, &fitted, method);
        let (mut set_up, mut choice) = (Vec::new(), Vec::new());
        let mut solver = build()?;
        for k in 0..REPEATS {
            if k > 0 {
                solver = build()?;
            }
            set_up.push(solver.cost.set_up_s);
            choice.push(solver.cost.choice_s);
        }
        let values = fitted.differences();
        let differences = DifferenceFrames::all_good(values.view());
        let stop = total_variation::stop(model.settings());
        let Timed { made, time_s } = timed(|| solver.run(&differences, &stop))?;
        let ImageSequence { pixels, report } = made;
        let times = vec![
            StageTime { stage: "Jacobian of pixels", time_s: median(set_up).unwrap_or(f64::NAN) },
            StageTime { stage: "weights", time_s: median(choice).unwrap_or(f64::NAN) },
            StageTime { stage: "iteration", time_s: time_s / report.iterations.max(1) as f64 },
            StageTime { stage: "solve", time_s },
        ];
        Ok(TimedImages { pixels, times })
    }

    fn one_step(&self, recording: &SimulatedRecording) -> Result<TimedImages, ReportError> {
        let (model, frames) = (self.model, &recording.simulated.frames);
        let fitted = model.fit(frames, self.noise_std_v, model.settings().clone());
        let matrix = timed(|| Ok(fitted.one_step(&mut Progress::silent())?))?;
        let difference = &matrix.made.difference;
        let reconstructor = difference.on_raster(model.raster.pixel_from_element())?;
        let mut workspace = reconstructor.workspace();
        let count = frames.values.nrows();
        let mut pixels = Array2::zeros((count, reconstructor.image_len()));
        let mut image = vec![0.0; reconstructor.image_len()];
        let all = timed(|| {
            for (frame, mut row) in frames.values.rows().into_iter().zip(pixels.rows_mut()) {
                let (frame, reference) = (frame.to_vec(), &frames.reference);
                reconstructor.reconstruct_into(&frame, reference, &mut workspace, &mut image)?;
                row.iter_mut().zip(&image).for_each(|(out, value)| *out = *value);
            }
            Ok(())
        })?;
        let times = vec![
            StageTime { stage: "reconstruction matrix", time_s: matrix.time_s },
            StageTime { stage: "each frame", time_s: all.time_s / count as f64 },
        ];
        Ok(TimedImages { pixels, times })
    }
}

/// Times of the stages needed by every method: mesh, forward solution and Jacobian.
fn forward_times(skin: &Skin) -> Result<Vec<StageTime>, ReportError> {
    let mesh_s = timed(|| Ok(skin.source.build()?))?.time_s;
    let background = skin.background_s();
    let mut workspace = skin.model.workspace()?;
    let forward = timed(|| Ok(skin.model.solve(&background, &mut workspace)?.measurements()))?;
    let both = timed(|| {
        let mut solution = skin.model.solve(&background, &mut workspace)?;
        Ok((solution.measurements(), solution.jacobian()))
    })?;
    Ok(vec![
        StageTime { stage: "mesh", time_s: mesh_s },
        StageTime { stage: "forward", time_s: forward.time_s },
        StageTime { stage: "Jacobian", time_s: both.time_s - forward.time_s },
    ])
}

/// Result of the last of several runs, and their median time.
struct Timed<T> {
    made: T,
    time_s: f64,
}

fn timed<T>(mut run: impl FnMut() -> Result<T, ReportError>) -> Result<Timed<T>, ReportError> {
    let (mut seconds, mut made) = (Vec::new(), None);
    for _ in 0..REPEATS {
        let start = Instant::now();
        made = Some(run()?);
        seconds.push(start.elapsed().as_secs_f64());
    }
    let made = made.ok_or_else(|| ReportError::Failure("no run".to_owned()))?;
    Ok(Timed { made, time_s: median(seconds).unwrap_or(f64::NAN) })
}
