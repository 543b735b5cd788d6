//! Solvers that take frame after frame, on the way that `eit live` takes: what they know before the
//! first one is the skin and the noise. Every frame is timed by itself, the ones that fill a window
//! included.

use super::super::super::bench::{Bench, Entrant};
use super::super::point::{Course, Solver, Spread};
use super::{Lane, Made, SetUp};
use crate::error::ReportError;
use eit_inverse::{Reconstructor, SequenceStatus, StTvStream, Workspace};
use eit_skin::denoise::{LiveNet, Net};
use eit_skin::scene::{Hyperparameter, Rule};
use eit_skin::total_variation::WINDOW;
use eit_skin::{FittedFrames, Progress};
use ndarray::Array2;
use std::time::Instant;

/// Movie of a bench's raster and the time of each frame of each run.
struct Run {
    /// [frame, masked pixel].
    movie: Array2<f64>,
    seconds: Vec<f64>,
}

/// Iterations, the worst status, the worst gap.
type StreamReport = (usize, SequenceStatus, f64);

/// What makes an image of a frame.
enum Source<'a> {
    OneStep { reconstructor: &'a Reconstructor, memory: Box<Workspace>, reference: &'a [f64] },
    Stream { stream: Box<StTvStream>, report: StreamReport },
}

impl Source<'_> {
    fn next(
        &mut self,
        values: &[f64],
        differences: &[f64],
        image: &mut [f64],
    ) -> Result<(), ReportError> {
        match self {
            Self::OneStep { reconstructor, memory, reference } => {
                reconstructor.reconstruct_into(values, reference, memory, image)?;
            }
            Self::Stream { stream, report: (iterations, status, worst) } => {
                let step = stream.push(differences, None)?;
                *iterations += step.iterations;
                *worst = worst.max(step.certificate.relative_gap());
                if step.status != SequenceStatus::Converged {
                    *status = step.status;
                }
                image.copy_from_slice(step.image.unwrap_or_default());
            }
        }
        Ok(())
    }
}

impl Lane<'_> {
    /// Difference images by one matrix, and through a net. By cross-validation it has seen the
    /// recording, and is not live.
    pub(super) fn one_step(
        &self,
        bench: &Bench,
        (rule, rule_name): (Rule, &'static str),
        net: Option<&(String, Net)>,
    ) -> Result<Course, ReportError> {
        let mut settings = bench.skin().settings.reconstruction.clone();
        settings.hyperparameter = Some(Hyperparameter::Rule(rule));
        let fitted = self.with_settings(bench, settings);
        let mut silent = Progress::silent();
        let start = Instant::now();
        let imaging = fitted.one_step(&mut silent)?;
        let report = imaging.difference.report();
        let (rank, hyperparameter) = (report.rank, report.hyperparameter);
        let reconstructor = imaging.difference.on_raster(bench.raster.pixel_from_element())?;
        let all_s = start.elapsed().as_secs_f64();
        let of_rule = silent.times().iter().find(|stage| stage.stage == "hyperparameter");
        let is_live = rule == Rule::NoiseFigure;
        let choice_s = if is_live { 0.0 } else { of_rule.map_or(0.0, |stage| stage.time_s) };
        let choice = format!("hyperparameter {hyperparameter:.2e}, {}", imaging.rule);
        let source = || Source::OneStep {
            memory: Box::new(reconstructor.workspace()),
            reconstructor: &reconstructor,
            reference: &fitted.frames.reference,
        };
        let sources = std::iter::repeat_with(source).take(self.size.direct_runs).collect();
        let (run, _) = self.frame_by_frame(bench, &fitted, net, sources)?;
        let mut solver = Solver::own("gauss-newton", Some(bench.raster.pixels()), is_live);
        solver.rule = rule_name;
        let set_up = SetUp { set_up_s: all_s - choice_s, choice_s, choice };
        let floor_s = self.floors.one_step(bench, rank);
        self.live_course((solver, bench, net), set_up, run, (floor_s, None, None))
    }

    /// A window of total variation: images of the newest frame, and through a net.
    pub(super) fn stream(
        &self,
        bench: &Bench,
        (entrant, target_gap): (Entrant, f64),
        net: Option<&(String, Net)>,
    ) -> Result<Course, ReportError> {
        let mut settings = bench.skin().settings.reconstruction.clone();
        settings.lower_s = entrant.lower_s;
        settings.target_gap = Some(target_gap);
        let fitted = self.with_settings(bench, settings);
        let start = Instant::now();
        let first = fitted.tv_stream(entrant.method, &mut Progress::silent())?;
        let (set_up_s, choice) = (start.elapsed().as_secs_f64(), first.words());
        let source = || {
            let made = fitted.tv_stream(entrant.method, &mut Progress::silent())?;
            let report = (0, SequenceStatus::Converged, 0.0);
            Ok::<_, ReportError>(Source::Stream { stream: Box::new(made.stream), report })
        };
        let sources = (0..self.size.stream_runs).map(|_| source()).collect::<Result<_, _>>()?;
        let (run, report) = self.frame_by_frame(bench, &fitted, net, sources)?;
        let (iterations, status, worst) = report.unwrap_or((0, SequenceStatus::Direct, 0.0));
        let each = iterations as f64 / self.frames() as f64;
        let floor_s = self.floors.total_variation(bench, WINDOW, each);
        let name = format!("{} stream", entrant.name());
        let solver = Solver::own(name, Some(bench.raster.pixels()), true);
        let set_up = SetUp { set_up_s, choice_s: 0.0, choice };
        let report = Some((iterations, status, Some(worst)));
        self.live_course((solver, bench, net), set_up, run, (floor_s, report, Some(target_gap)))
    }

    /// Runs every source over all frames; what the last one tells of itself.
    fn frame_by_frame(
        &self,
        bench: &Bench,
        fitted: &FittedFrames,
        net: Option<&(String, Net)>,
        sources: Vec<Source<'_>>,
    ) -> Result<(Run, Option<StreamReport>), ReportError> {
        let differences = fitted.differences();
        let rows = |array: &Array2<f64>| -> Vec<Vec<f64>> {
            array.rows().into_iter().map(|row| row.to_vec()).collect()
        };
        let (values, differences) = (rows(&fitted.frames.values), rows(&differences));
        let pixels = bench.raster.masked_pixels().len();
        let mut movie = Array2::zeros((values.len(), pixels));
        let (mut raw, mut made) = (vec![0.0; pixels], vec![0.0; pixels]);
        let mut seconds = Vec::new();
        let mut report = None;
        for mut source in sources {
            let mut net = match net {
                Some((_, net)) => Some(LiveNet::new(net, fitted)?),
                None => None,
            };
            for ((values, differences), mut row) in
                values.iter().zip(&differences).zip(movie.rows_mut())
            {
                let start = Instant::now();
                source.next(values, differences, &mut raw)?;
                let shown = match &mut net {
                    None => &raw,
                    Some(net) => {
                        net.push(&bench.raster, &raw, differences, &mut made)?;
                        &made
                    }
                };
                seconds.push(start.elapsed().as_secs_f64());
                row.iter_mut().zip(shown).for_each(|(out, value)| *out = *value);
            }
            if let Source::Stream { report: told, .. } = source {
                report = Some(told);
            }
        }
        Ok((Run { movie, seconds }, report))
    }

    fn live_course(
        &self,
        (mut solver, bench, net): (Solver, &Bench, Option<&(String, Net)>),
        set_up: SetUp,
        run: Run,
        (mut floor_s, report, target_gap): Work,
    ) -> Result<Course, ReportError> {
        if let Some((name, net)) = net {
            solver.name = format!("{}, {name}", solver.name);
            floor_s += self.floors.net(net.shape(), bench);
        }
        let made = Made { time: Spread::of(run.seconds, 1), floor_s, report, target_gap };
        let movie = self.on_judge(bench, run.movie.view())?;
        self.course(solver, set_up, (movie, &made))
    }
}

/// Floor of a frame, report, gap that was asked for.
type Work = (f64, Option<(usize, SequenceStatus, Option<f64>)>, Option<f64>);
