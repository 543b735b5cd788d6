//! Solvers that take a whole recording: weights and hyperparameters are chosen on it, and its frames
//! are solved for together.

use super::super::super::bench::{Bench, Entrant, Entry, Sequence};
use super::super::point::{Course, Solver, Spread};
use super::{Lane, Made, SetUp};
use crate::error::ReportError;
use eit_inverse::{DifferenceFrames, SequenceStatus, Stop};
use eit_skin::method::Method;
use eit_skin::scene::Rule;
use ndarray::Array2;
use std::time::{Duration, Instant};

impl Lane<'_> {
    /// Methods on the elements of the mesh.
    pub(super) fn on_elements(
        &self,
        method: Method,
        (rule, rule_name): (Rule, &'static str),
    ) -> Result<Course, ReportError> {
        let (judge, frames) = (self.judge(), self.frames());
        let is_absolute = method == Method::GaussNewtonAbsolute;
        let fitted = self.fitted(judge, Entrant { method, lower_s: None }, rule);
        let mut entry = Entry::new(judge, &fitted, method)?;
        let values = self.recording.simulated.frames.differences(judge.kind());
        let differences = DifferenceFrames::all_good(values.view());
        let mut seconds = Vec::new();
        let Sequence { pixels: movie, report } = loop {
            let start = Instant::now();
            let made = entry.run(&differences, &Stop::default())?;
            seconds.push(start.elapsed().as_secs_f64());
            let enough = if is_absolute { 1 } else { self.size.direct_runs };
            if seconds.len() >= enough {
                break made;
            }
        };
        let floor_s = match is_absolute {
            true => self.floors.absolute(judge, report.iterations as f64 / frames as f64),
            false => self.floors.on_elements(judge, (entry.rank, frames)),
        };
        let report = Some((report.iterations, report.status, None));
        let made = Made { time: Spread::of(seconds, frames), floor_s, report, target_gap: None };
        let mut solver = Solver::own(method.name(), None, false);
        solver.rule = rule_name;
        self.course(solver, SetUp::of(&entry), (movie, &made))
    }

    /// Total variation, to one gap after the other, each from cold.
    pub(super) fn total_variation(
        &self,
        bench: &Bench,
        entrant: Entrant,
    ) -> Result<Course, ReportError> {
        let fitted = self.fitted(bench, entrant, Rule::NoiseFigure);
        let mut entry = Entry::new(bench, &fitted, entrant.method)?;
        let (values, frames) =
            (self.recording.simulated.frames.differences(bench.kind()), self.frames());
        let differences = DifferenceFrames::all_good(values.view());
        let deadline = Some(Duration::from_secs_f64(self.size.deadline_s));
        let (mut points, mut last) = (Vec::new(), Array2::zeros((0, 0)));
        for &target_gap in self.size.gaps {
            let stop = Stop { target_gap, deadline, max_iterations: usize::MAX };
            let mut seconds = Vec::new();
            let Sequence { pixels: movie, report } = loop {
                let made = entry.run(&differences, &stop)?;
                seconds.push(made.report.seconds);
                if !self.once_more(&seconds) {
                    break made;
                }
            };
            let iterations = report.iterations as f64;
            let floor_s = self.floors.total_variation(bench, frames, iterations) / frames as f64;
            let gap = report.certificate.map(|certificate| certificate.relative_gap());
            let is_late = report.status == SequenceStatus::Deadline;
            let report = Some((report.iterations, report.status, gap));
            let time = Spread::of(seconds, frames);
            let made = Made { time, floor_s, report, target_gap: Some(target_gap) };
            last = self.on_judge(bench, movie.view())?;
            points.push(self.point(&last, &made)?);
            if is_late {
                break;
            }
        }
        let solver = Solver::own(entrant.name(), Some(bench.raster.pixels()), false);
        Ok(SetUp::of(&entry).course(solver, points, last))
    }

    /// Whether a run is short enough to repeat.
    fn once_more(&self, seconds: &[f64]) -> bool {
        seconds.len() < self.size.runs && seconds.iter().sum::<f64>() < self.size.repeat_below_s
    }
}
