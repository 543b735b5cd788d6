//! What the Python peers are given, and how their movies are judged.

use super::super::peers::{PeerMovie, PeerProblem};
use super::super::point::{Course, Solver, Spread};
use super::{Entry, Lane, MOVIES, Made, STILLS, SetUp};
use crate::error::ReportError;
use eit_skin::Progress;
use eit_skin::scene::Rule;
use ndarray::Array1;

impl Lane<'_> {
    /// The one-step matrix, and the problem of total variation with the weights that ours chose.
    pub fn peer_problem(&self) -> Result<PeerProblem, ReportError> {
        let (judge, simulated) = (self.judge(), &self.recording.simulated);
        let frames = &simulated.frames;
        let own = self.with_settings(judge, judge.skin().settings.reconstruction.clone());
        let imaging = own.one_step(&mut Progress::silent())?;
        let on_pixels = imaging.difference.on_raster(judge.raster.pixel_from_element())?;
        let entrant = if self.is_still() { STILLS[0] } else { MOVIES[0] };
        let fitted = self.fitted(judge, entrant, Rule::NoiseFigure);
        let Some(solver) = Entry::new(judge, &fitted, entrant.method)?.into_tv() else {
            return Err(ReportError::Failure("no solver of total variation".to_owned()));
        };
        let settings = solver.settings();
        let noise = settings.noise_std.clone().unwrap_or_else(|| vec![1.0; frames.used.len()]);
        let mut whitened_jacobian = judge.linearised.pixel_jacobian(&judge.raster, &frames.used)?;
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
    pub(super) fn peer(&self, movie: PeerMovie) -> Result<Course, ReportError> {
        let PeerMovie { name, seconds, movie } = movie;
        let pixels = Some(self.judge().raster.pixels());
        let solver = Solver { is_peer: true, ..Solver::own(name, pixels, false) };
        let time = Spread::of(seconds, movie.nrows());
        let made = Made { time, floor_s: f64::NAN, report: None, target_gap: None };
        let set_up = SetUp { set_up_s: 0.0, choice_s: 0.0, choice: "as ours".to_owned() };
        self.course(solver, set_up, (movie, &made))
    }
}
