//! Every inverse solver on one recording.
//!
//! One-step images (hyperparameter by noise figure 1, as without a word of the scene, and by
//! cross-validation) are timed on the way that `eit live` takes, frame by frame. Iterated methods run
//! from cold to each gap. A stream gets one frame after the other and gives the newest one's image.
//! All movies are judged on the finest raster; a coarser one is shown on it as it is, in squares.

use super::super::bench::{Bench, Entrant, Entry};
use super::super::scores::{Scores, Truth};
use super::floor::Floors;
use super::peers::{self, PeerMovie, PeerProblem};
use super::point::{Course, Point, Solver, Spread};
use super::{Recording, Size};
use crate::denoise::Net;
use crate::error::CliError;
use crate::method::Method;
use crate::pipeline;
use crate::progress::Progress;
use crate::scene::{Hyperparameter, Rule};
use eit_inverse::{Differences, MovieReport, MovieStatus, StTvStream, Stop, StreamSettings};
use ndarray::{Array1, Array2, Array3, ArrayView2, Axis};
use std::path::Path;
use std::time::{Duration, Instant};

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
/// Frames of a stream's window.
const WINDOW: usize = 8;

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
}

/// Everything that ran, and what failed with its reason.
#[derive(Default)]
pub(super) struct Outcome {
    pub courses: Vec<Course>,
    pub failures: Vec<(String, String)>,
}

impl Lane<'_> {
    /// Number of solvers, for a progress bar.
    pub fn solvers(&self) -> usize {
        let rasters = self.benches.len();
        match self.is_still() {
            true => rasters * (2 + STILLS.len()) + 1,
            false => rasters * (2 + STREAMS.len() + MOVIES.len()) + 3 + 2 * self.nets.len(),
        }
    }

    /// Runs them all; one that fails does not stop the others.
    pub fn run(&self, bar: &indicatif::ProgressBar) -> Outcome {
        let mut outcome = Outcome::default();
        let mut keep = |name: &str, course: Result<Course, CliError>| {
            bar.inc(1);
            match course {
                Ok(course) => outcome.courses.push(course),
                Err(error) => outcome.failures.push((name.to_owned(), error.to_string())),
            }
        };
        let entrants = if self.is_still() { &STILLS[..] } else { &MOVIES[..] };
        for bench in self.benches {
            for rule in [Rule::NoiseFigure, Rule::Gcv] {
                keep("gauss-newton", self.one_step(bench, rule, None));
            }
            for entrant in entrants {
                keep(&entrant.name(), self.total_variation(bench, *entrant));
            }
            if !self.is_still() {
                for stream in STREAMS {
                    keep("st-tv stream", self.stream(bench, stream, None));
                }
            }
        }
        for (name, net) in self.nets {
            keep(name, self.one_step(self.judge(), Rule::NoiseFigure, Some((name, net))));
            keep(name, self.stream(self.judge(), STREAMS[0], Some((name, net))));
        }
        let on_elements = [Method::TimePrior, Method::Kalman, Method::GaussNewtonAbsolute];
        let first = if self.is_still() { 2 } else { 0 };
        for method in &on_elements[first..] {
            keep(method.name(), self.on_elements(*method));
        }
        if let Some(python) = self.peers {
            match peers::inverse(python, self) {
                Ok(movies) => movies.into_iter().for_each(|movie| {
                    keep(&movie.name.clone(), self.peer(movie));
                }),
                Err(error) => keep("Python peers", Err(error)),
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

    fn judge(&self) -> &Bench {
        &self.benches[self.benches.len() - 1]
    }

    /// Difference images by one matrix, one frame after the other, and through a net.
    fn one_step(
        &self,
        bench: &Bench,
        rule: Rule,
        net: Option<(&String, &Net)>,
    ) -> Result<Course, CliError> {
        let frames = &self.recording.simulated.frames;
        let mut scene = bench.scene.clone();
        scene.reconstruction.hyperparameter = Some(Hyperparameter::Rule(rule));
        scene.noise.additive_v = Some(self.recording.simulated.noise_std_v);
        let mut silent = Progress::silent();
        let start = Instant::now();
        let parts = (&bench.setup, &bench.linearised);
        let imaging = pipeline::imaging(&scene, parts.0, parts.1, frames, &mut silent)?;
        let choice = format!(
            "hyperparameter {:.2e}, {}",
            imaging.difference.report().hyperparameter,
            imaging.rule
        );
        let reconstructor = imaging.difference.on_raster(bench.raster.pixel_from_element())?;
        let set_up_s = start.elapsed().as_secs_f64();
        let mut memory = reconstructor.workspace();
        let mut movie = Array2::zeros((self.frames(), reconstructor.image_len()));
        let rows: Vec<Vec<f64>> = frames.values.rows().into_iter().map(|r| r.to_vec()).collect();
        let mut image = vec![0.0; reconstructor.image_len()];
        let mut seconds = Vec::new();
        for _ in 0..self.size.direct_runs {
            let start = Instant::now();
            for (frame, mut row) in rows.iter().zip(movie.rows_mut()) {
                let reference = &frames.reference;
                reconstructor.reconstruct_into(frame, reference, &mut memory, &mut image)?;
                row.iter_mut().zip(&image).for_each(|(out, value)| *out = *value);
            }
            seconds.push(start.elapsed().as_secs_f64());
        }
        let floor_s = self.floors.one_step(bench, imaging.difference.report().rank);
        let made = Made { movie, seconds, floor_s, report: None, target_gap: None };
        let setup = SetUp { set_up_s, choice_s: 0.0, choice };
        match rule {
            Rule::NoiseFigure => self.live_course("gauss-newton", bench, (setup, made), net),
            // sees the recording before its first image
            _ => {
                let name = "gauss-newton, gcv";
                let mut course = self.live_course(name, bench, (setup, made), net)?;
                course.solver.is_live = false;
                Ok(course)
            }
        }
    }

    /// A stream's images of the newest frame, and through a net.
    fn stream(
        &self,
        bench: &Bench,
        (entrant, target_gap): (Entrant, f64),
        net: Option<(&String, &Net)>,
    ) -> Result<Course, CliError> {
        let (mut seconds, mut found) = (Vec::new(), None);
        for _ in 0..self.size.stream_runs {
            let entry = self.entry(bench, entrant)?;
            let set_up = SetUp {
                set_up_s: entry.set_up_s,
                choice_s: entry.choice_s,
                choice: entry.choice.clone(),
            };
            let Some(solver) = entry.into_tv() else {
                return Err(CliError::Failure("no solver of total variation".to_owned()));
            };
            let settings =
                StreamSettings { window: WINDOW, lag: 0, target_gap, ..Default::default() };
            let mut stream = StTvStream::new(solver, settings)?;
            let values = self.recording.simulated.frames.differences(bench.kind());
            let mut movie = Array2::zeros((values.nrows(), bench.raster.masked_pixels().len()));
            let (mut iterations, mut worst, mut status) = (0, 0.0_f64, MovieStatus::Converged);
            let start = Instant::now();
            for (frame, mut row) in values.rows().into_iter().zip(movie.rows_mut()) {
                let step = stream.push(&frame.to_vec(), None)?;
                iterations += step.iterations;
                worst = worst.max(step.certificate.relative_gap());
                if step.status != MovieStatus::Converged {
                    status = step.status;
                }
                let image = step.image.unwrap_or_default();
                row.iter_mut().zip(image).for_each(|(out, value)| *out = *value);
            }
            seconds.push(start.elapsed().as_secs_f64());
            let report = (iterations, status, Some(worst));
            found = Some((movie, report, set_up));
        }
        let Some((movie, report, set_up)) = found else {
            return Err(CliError::Failure("no run of the stream".to_owned()));
        };
        let each = report.0 as f64 / self.frames() as f64;
        let floor_s = self.floors.total_variation(bench, WINDOW, each);
        let target_gap = Some(target_gap);
        let made = Made { movie, seconds, floor_s, report: Some(report), target_gap };
        let name = match entrant.lower_s {
            None => "st-tv stream",
            Some(_) => "st-tv ≥ 0 stream",
        };
        self.live_course(name, bench, (set_up, made), net)
    }

    /// A course of one point, whose images may go through a net.
    fn live_course(
        &self,
        name: &str,
        bench: &Bench,
        (set_up, mut made): (SetUp, Made),
        net: Option<(&String, &Net)>,
    ) -> Result<Course, CliError> {
        let mut name = name.to_owned();
        if let Some((net_name, net)) = net {
            let images = bench.raster.images_from_pixels(made.movie.view())?;
            let mut times = Vec::new();
            let mut denoised = images.clone();
            for _ in 0..made.seconds.len().max(3) {
                denoised = images.clone();
                times.push(net.time_of(&mut denoised, &bench.raster)?);
            }
            made.movie = bench.pixels_of(denoised.view())?;
            times.sort_by(f64::total_cmp);
            let net_s = times[times.len() / 2];
            made.seconds.iter_mut().for_each(|seconds| *seconds += net_s);
            made.floor_s += self.floors.net(net.shape(), bench);
            name = format!("{name}, {net_name}");
        }
        let solver =
            Solver { name, pixels: Some(bench.raster.pixels()), is_live: true, is_peer: false };
        let movie = self.on_judge(bench, made.movie.view())?;
        let point = self.point(&movie, &made)?;
        Ok(self.course(solver, set_up, vec![point], movie))
    }

    /// Methods on the elements of the mesh.
    fn on_elements(&self, method: Method) -> Result<Course, CliError> {
        let judge = self.judge();
        let is_absolute = method == Method::GaussNewtonAbsolute;
        let frames = if is_absolute { self.size.absolute_frames } else { self.frames() };
        let frames = frames.min(self.frames());
        let mut entry = self.entry(judge, Entrant { method, lower_s: None })?;
        let values = self.recording.simulated.frames.differences(judge.kind());
        let values = values.slice_axis(Axis(0), (..frames).into());
        let differences = Differences::all_good(values);
        let runs = if is_absolute { 1 } else { self.size.direct_runs };
        let (mut seconds, mut found) = (Vec::new(), None);
        for _ in 0..runs {
            let start = Instant::now();
            let (movie, report) = entry.run(&differences, &Stop::default())?;
            seconds.push(start.elapsed().as_secs_f64());
            found = Some((movie, report));
        }
        let Some((movie, report)) = found else {
            return Err(CliError::Failure("no run".to_owned()));
        };
        let steps = report.iterations as f64 / frames as f64;
        let floor_s = match is_absolute {
            true => self.floors.absolute(judge, steps),
            false => self.floors.on_elements(judge, (entry.rank, frames)),
        };
        let set_up = SetUp::of(&entry);
        let report = Some((report.iterations, report.status, None));
        let made = Made { movie, seconds, floor_s, report, target_gap: None };
        let solver = Solver {
            name: method.name().to_owned(),
            pixels: None,
            is_live: is_absolute,
            is_peer: false,
        };
        let point = self.point(&made.movie, &made)?;
        Ok(self.course(solver, set_up, vec![point], made.movie))
    }

    /// Total variation of the whole recording, to one gap after the other.
    fn total_variation(&self, bench: &Bench, entrant: Entrant) -> Result<Course, CliError> {
        let mut entry = self.entry(bench, entrant)?;
        let values = self.recording.simulated.frames.differences(bench.kind());
        let differences = Differences::all_good(values.view());
        let deadline = Some(Duration::from_secs_f64(self.size.deadline_s));
        let (mut points, mut last) = (Vec::new(), None);
        for &target_gap in self.size.gaps {
            let stop = Stop { target_gap, deadline, max_iterations: usize::MAX };
            let (mut seconds, mut found): (Vec<f64>, Option<(Array2<f64>, MovieReport)>) =
                (Vec::new(), None);
            while seconds.is_empty() || self.once_more(&seconds) {
                let (movie, report) = entry.run(&differences, &stop)?;
                seconds.push(report.seconds);
                found = Some((movie, report));
            }
            let Some((movie, report)) = found else { break };
            let frames = self.frames();
            let iterations = report.iterations as f64;
            let floor_s = self.floors.total_variation(bench, frames, iterations) / frames as f64;
            let gap = report.certificate.map(|certificate| certificate.relative_gap());
            let is_late = report.status == MovieStatus::Deadline;
            let report = Some((report.iterations, report.status, gap));
            let movie = self.on_judge(bench, movie.view())?;
            let made = Made { movie, seconds, floor_s, report, target_gap: Some(target_gap) };
            points.push(self.point(&made.movie, &made)?);
            last = Some(made.movie);
            if is_late {
                break;
            }
        }
        let name = entrant.name();
        let solver =
            Solver { name, pixels: Some(bench.raster.pixels()), is_live: false, is_peer: false };
        Ok(self.course(solver, SetUp::of(&entry), points, last.unwrap_or_default()))
    }

    /// What the Python peers are given: the one-step matrix, and the problem of total variation with
    /// the weights that ours chose.
    pub fn peer_problem(&self) -> Result<PeerProblem, CliError> {
        let (judge, simulated) = (self.judge(), &self.recording.simulated);
        let frames = &simulated.frames;
        let mut scene = judge.scene.clone();
        scene.noise.additive_v = Some(simulated.noise_std_v);
        let mut silent = Progress::silent();
        let parts = (&judge.setup, &judge.linearised);
        let imaging = pipeline::imaging(&scene, parts.0, parts.1, frames, &mut silent)?;
        let on_pixels = imaging.difference.on_raster(judge.raster.pixel_from_element())?;
        let entrant = if self.is_still() { STILLS[0] } else { MOVIES[0] };
        let Some(solver) = self.entry(judge, entrant)?.into_tv() else {
            return Err(CliError::Failure("no solver of total variation".to_owned()));
        };
        let settings = solver.settings();
        let noise = settings.noise_std.clone().unwrap_or_else(|| vec![1.0; frames.used.len()]);
        let mut whitened_jacobian = pipeline::tv::pixel_jacobian(
            &judge.linearised,
            &judge.raster,
            judge.kind(),
            &frames.used,
        )?;
        for (mut row, noise) in whitened_jacobian.rows_mut().into_iter().zip(&noise) {
            row.mapv_inplace(|j| j / noise);
        }
        let differences = frames.differences(judge.kind());
        let whitened_differences = &differences / &Array1::from(noise);
        let side = judge.raster.pixel_m();
        Ok(PeerProblem {
            matrix: on_pixels.reconstruction_matrix(),
            differences,
            whitened_jacobian,
            whitened_differences,
            mask: judge.raster.mask().mapv(|inside| f64::from(u8::from(inside))),
            weights: [settings.lambda_space * side, settings.lambda_time * side * side],
        })
    }

    /// A peer's movie, judged as ours.
    fn peer(&self, movie: PeerMovie) -> Result<Course, CliError> {
        let PeerMovie { name, seconds, movie } = movie;
        let solver = Solver {
            name,
            pixels: Some(self.judge().raster.pixels()),
            is_live: false,
            is_peer: true,
        };
        let floor_s = f64::NAN;
        let made = Made { movie, seconds, floor_s, report: None, target_gap: None };
        let point = self.point(&made.movie, &made)?;
        let set_up = SetUp { set_up_s: 0.0, choice_s: 0.0, choice: "as ours".to_owned() };
        Ok(self.course(solver, set_up, vec![point], made.movie))
    }

    /// Whether a run is short enough to repeat.
    fn once_more(&self, seconds: &[f64]) -> bool {
        seconds.len() < self.size.runs && seconds.iter().sum::<f64>() < self.size.repeat_below_s
    }

    /// Rule of the hyperparameter of methods on elements: of all, cross-validation alone sees the
    /// noise of the recording, as the weights of total variation do; it needs several frames.
    fn rule(&self) -> Rule {
        if self.is_still() { Rule::NoiseFigure } else { Rule::Gcv }
    }

    fn entry<'a>(&self, bench: &'a Bench, entrant: Entrant) -> Result<Entry<'a>, CliError> {
        let Recording { simulated, .. } = self.recording;
        Entry::new(bench, (entrant, self.rule()), &simulated.frames, simulated.noise_std_v)
    }

    /// A movie of another raster on that of the judge.
    fn on_judge(&self, bench: &Bench, movie: ArrayView2<'_, f64>) -> Result<Array2<f64>, CliError> {
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

    fn point(&self, movie: &Array2<f64>, made: &Made) -> Result<Point, CliError> {
        let Recording { simulated, truth, .. } = self.recording;
        let truth = Truth { pixels: truth, positions_m: &simulated.positions_m };
        let (iterations, status, gap) = made.report.unwrap_or((0, MovieStatus::Direct, None));
        Ok(Point {
            target_gap: made.target_gap,
            time: Spread::of(made.seconds.clone(), movie.nrows()),
            floor_s: made.floor_s,
            scores: Scores::new(self.judge(), movie.view(), &truth)?,
            gap,
            iterations,
            status,
        })
    }

    fn course(
        &self,
        solver: Solver,
        set_up: SetUp,
        points: Vec<Point>,
        movie: Array2<f64>,
    ) -> Course {
        let SetUp { set_up_s, choice_s, choice } = set_up;
        Course { solver, set_up_s, choice_s, choice, points, movie }
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
}

/// A movie and how it was made.
struct Made {
    /// [frame, masked pixel].
    movie: Array2<f64>,
    /// Of each run, for all frames.
    seconds: Vec<f64>,
    /// A frame.
    floor_s: f64,
    /// Iterations, status and proven gap; `None` for a direct method.
    report: Option<(usize, MovieStatus, Option<f64>)>,
    target_gap: Option<f64>,
}
