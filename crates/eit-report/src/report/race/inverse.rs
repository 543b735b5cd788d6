//! Every inverse solver on one recording.
//!
//! All movies are judged on the finest raster; a coarser one is shown on it as it is, in squares.

mod live;
mod peer;
mod recorded;

use super::super::bench::{Bench, Entrant, Entry};
use super::super::scores::{Scores, Truth};
use super::floor::Floors;
use super::peers;
use super::point::{Course, Point, Solver, Spread};
use super::{Recording, Size};
use crate::error::ReportError;
use eit_inverse::SequenceStatus;
use eit_skin::denoise::Net;
use eit_skin::method::Method;
use eit_skin::scene::{ReconstructionSettings, Rule};
use eit_skin::{FittedFrames, StopFlag};
use ndarray::{Array2, Array3, ArrayView2};
use std::path::Path;

/// Total variation with and without what is known of the fabric.
const MOVIES: [Entrant; 3] = [
    Entrant { method: Method::StTv, lower_s: None },
    Entrant { method: Method::StTv, lower_s: Some(0.0) },
    Entrant { method: Method::Tv, lower_s: Some(0.0) },
];
const STILLS: [Entrant; 2] = [
    Entrant { method: Method::Tv, lower_s: None },
    Entrant { method: Method::Tv, lower_s: Some(0.0) },
];
/// Those that stream, and the gap of every frame.
const STREAMS: [(Entrant, f64); 2] = [
    (Entrant { method: Method::StTv, lower_s: None }, 1e-2),
    (Entrant { method: Method::StTv, lower_s: Some(0.0) }, 1e-1),
];
/// Rules of the hyperparameter: one needs no data, the other sees the noise of the recording.
const RULES: [(Rule, &str); 2] = [(Rule::NoiseFigure, "noise-figure"), (Rule::Gcv, "gcv")];

/// A recording and what it is reconstructed and judged on.
pub(super) struct Lane<'a> {
    /// The same skin with more and more pixels; the last one judges.
    pub benches: &'a [Bench],
    pub recording: &'a Recording,
    pub size: &'a Size,
    pub floors: &'a Floors,
    /// Nets that belong to the skin and to the finest raster, with their names.
    pub nets: &'a [(String, Net)],
    /// An interpreter that runs the Python peers.
    pub peers: Option<&'a Path>,
    /// Set when the user wants an end.
    pub stop: &'a StopFlag,
}

/// Everything that ran, and what failed with its reason.
#[derive(Default)]
pub(super) struct Outcome {
    pub courses: Vec<Course>,
    pub failures: Vec<(String, String)>,
}

impl Outcome {
    fn keep(&mut self, name: &str, course: Result<Course, ReportError>) {
        match course {
            Ok(course) => self.courses.push(course),
            Err(error) => self.failures.push((name.to_owned(), error.to_string())),
        }
    }
}

impl Lane<'_> {
    /// Number of solvers, for a progress bar.
    pub fn solvers(&self) -> usize {
        let (rasters, rules) = (self.benches.len(), RULES.len());
        match self.is_still() {
            true => rasters * (rules + STILLS.len()) + rules,
            false => {
                rasters * (rules + STREAMS.len() + MOVIES.len()) + 3 * rules + 2 * self.nets.len()
            }
        }
    }

    /// Runs them all; one that fails does not stop the others. Once the user wants an end, none begins.
    pub fn run(&self, bar: &eit_skin::Steps<'_>) -> Outcome {
        let mut outcome = Outcome::default();
        let mut keep = |name: &str, course: &dyn Fn() -> Result<Course, ReportError>| {
            bar.inc();
            if !self.stop.is_set() {
                outcome.keep(name, course());
            }
        };
        let entrants = if self.is_still() { &STILLS[..] } else { &MOVIES[..] };
        for bench in self.benches {
            for rule in RULES {
                keep("gauss-newton", &|| self.one_step(bench, rule, None));
            }
            for entrant in entrants {
                keep(&entrant.name(), &|| self.total_variation(bench, *entrant));
            }
            if !self.is_still() {
                for stream in STREAMS {
                    keep("st-tv stream", &|| self.stream(bench, stream, None));
                }
            }
        }
        for net in self.nets {
            keep(&net.0, &|| self.one_step(self.judge(), RULES[0], Some(net)));
            keep(&net.0, &|| self.stream(self.judge(), STREAMS[0], Some(net)));
        }
        let on_elements = [Method::TimePrior, Method::Kalman, Method::GaussNewtonAbsolute];
        let first = if self.is_still() { 2 } else { 0 };
        for method in &on_elements[first..] {
            for rule in RULES {
                keep(method.name(), &|| self.on_elements(*method, rule));
            }
        }
        if let Some(python) = self.peers.filter(|_| !self.stop.is_set()) {
            match peers::inverse(python, self) {
                Ok(movies) => movies.into_iter().for_each(|movie| {
                    outcome.keep(&movie.name.clone(), self.peer(movie));
                }),
                Err(error) => outcome.keep("Python peers", Err(error)),
            }
        }
        outcome
    }

    fn is_still(&self) -> bool {
        self.frames() == 1
    }

    fn frames(&self) -> usize {
        self.recording.truth.nrows()
    }

    /// The finest raster; a lane has one at least.
    fn judge(&self) -> &Bench {
        &self.benches[self.benches.len() - 1]
    }

    /// The recording with its noise, for a method with a rule for its hyperparameter.
    fn fitted(&self, bench: &Bench, entrant: Entrant, rule: Rule) -> FittedFrames {
        self.with_settings(bench, entrant.settings(bench, rule))
    }

    /// The recording with its noise, to be reconstructed with these settings.
    fn with_settings(&self, bench: &Bench, settings: ReconstructionSettings) -> FittedFrames {
        let Recording { simulated, .. } = self.recording;
        bench.fitted(&simulated.frames, simulated.noise_std_v, settings)
    }

    /// A movie of another raster on that of the judge.
    fn on_judge(
        &self,
        bench: &Bench,
        movie: ArrayView2<'_, f64>,
    ) -> Result<Array2<f64>, ReportError> {
        let (judge, own) = (&self.judge().raster, &bench.raster);
        if own.pixels() == judge.pixels() {
            return Ok(movie.to_owned());
        }
        let images: Array3<f64> = own.images_from_pixels(movie)?;
        let mut shown = Array2::zeros((movie.nrows(), judge.masked_pixels().len()));
        for ((frame, k), value) in shown.indexed_iter_mut() {
            let [row, column] = judge.masked_pixels()[k];
            let [x_m, y_m] = judge.centre_m(row, column);
            let found = own.pixel_at([x_m, y_m]).map(|[row, column]| images[[frame, row, column]]);
            // a rim pixel that the coarse raster leaves out shows no change
            *value = found.filter(|v| v.is_finite()).unwrap_or(0.0);
        }
        Ok(shown)
    }

    /// Judges a movie on the finest raster.
    fn point(&self, movie: &Array2<f64>, made: &Made) -> Result<Point, ReportError> {
        let Recording { simulated, truth, .. } = self.recording;
        let truth = Truth { pixels: truth, positions_m: &simulated.positions_m };
        let (iterations, status, gap) = made.report.unwrap_or((0, SequenceStatus::Direct, None));
        Ok(Point {
            target_gap: made.target_gap,
            time: made.time,
            floor_s: made.floor_s,
            scores: Scores::new(self.judge(), movie.view(), &truth)?,
            gap,
            iterations,
            status,
        })
    }

    /// A course of one movie.
    fn course(
        &self,
        solver: Solver,
        set_up: SetUp,
        (movie, made): (Array2<f64>, &Made),
    ) -> Result<Course, ReportError> {
        let points = vec![self.point(&movie, made)?];
        Ok(set_up.course(solver, points, movie))
    }
}

/// What came before the first frame.
struct SetUp {
    set_up_s: f64,
    choice_s: f64,
    choice: String,
}

impl SetUp {
    fn of(entry: &Entry<'_>) -> Self {
        Self { set_up_s: entry.set_up_s, choice_s: entry.choice_s, choice: entry.choice.clone() }
    }

    fn course(self, solver: Solver, points: Vec<Point>, movie: Array2<f64>) -> Course {
        let Self { set_up_s, choice_s, choice } = self;
        Course { solver, set_up_s, choice_s, choice, points, movie }
    }
}

/// How a movie was made.
struct Made {
    time: Spread,
    /// A frame.
    floor_s: f64,
    /// Iterations, status and proven gap; `None` for a direct method.
    report: Option<(usize, SequenceStatus, Option<f64>)>,
    target_gap: Option<f64>,
}
