//! Touches by one model and one score: everything that is decided is a comparison of -2 log posterior.
//!
//! ```text
//! y = z - r = sum_k a_k d(p_k) + sum_k B_k g_k + memory + error + noise,   g ~ N(0, I)
//! C = S + E(touches) + sum_k B_k B_k'
//! J = r' C^-1 r + ln|C| + ln|Lambda / 2 pi| - 2 ln prior,                  r = y - D a
//! ```
//!
//! A row is a reciprocal pair in units of its noise. `z`: change since the reference frame.
//!
//! | file | holds |
//! |---|---|
//! | `model.rs`, `places.rs`, `dictionary.rs` | what is known before the first frame: rows, places, prints `d`, effects of touches |
//! | `background.rs` | `S` (noise, drift of the reference, memory of the fabric) and `E` (error of the model) |
//! | `rows.rs`, `error_size.rs` | rows of a frame, and how large `E` is |
//! | `actions.rs` | `B`: what a touch does besides its print |
//! | `whitened.rs`, `linear.rs` | a frame whitened by `S + E`, and the products of which scores are made |
//! | `prior.rs`, `estimate.rs` | the score of a hypothesis, at its maximum over strengths and positions |
//! | `hypotheses.rs` | births, deaths, relocations |
//! | `drives.rs` | leaks of the common potential, and time between drives, from the halves of pairs |
//! | `electrodes.rs`, `faults.rs` | open, noisy, stuck and drifting electrodes under the same score |
//! | `state.rs` | state of a touch, with its id, from frame to frame |
//! | `report.rs` | touches as reported: confidence, covariance, validity |
//!
//! **Cost** of a frame with 104 rows (`n`), in Mflop: whitening `n^3 / 3` 0.4, once or twice, twice more in every tenth frame
//! for the size of the model's error; `E` 0.7; scan for births 1; each place 0.15 and each pair of places 0.04; each fit 0.1 to
//! 1; reference 2.2. Nothing is allocated once vectors have grown to the largest number of touches; for places there is room
//! from the start.

mod actions;
mod background;
mod dictionary;
mod drives;
mod electrodes;
mod error_size;
mod estimate;
mod faults;
mod hypotheses;
mod linear;
mod model;
mod places;
mod prior;
mod report;
mod rows;
mod settings;
mod state;
#[cfg(test)]
mod tests;
mod whitened;

pub use electrodes::ElectrodeState;
pub use model::ScoreModel;
pub use settings::ScoreSettings;

use super::detector::{DentPlace, DetectorModel};
use super::{DetectorStep, Touch};
use crate::InverseError;
use crate::check::{check_length, check_positive};
use background::Background;
use electrodes::Electrodes;
use estimate::Scene;
use hypotheses::Search;
use linear::Symmetric;
use model::Model;
use ndarray::ArrayRef2;
use places::Grid;
use report::Report;
use state::{Hypothesis, Touches};
use whitened::Whitened;

/// Number of searches in a frame: the error of the model follows the touches found.
const PASSES: usize = 3;
/// 2 ln odds of a touch that are computed no further: 3 million to one.
const CERTAIN: f64 = 30.0;

/// Finds touches in frames, with ids that last.
#[derive(Debug, Clone)]
pub struct ScoreDetector {
    settings: ScoreSettings,
    model: Model,
    background: Background,
    electrodes: Electrodes,
    search: Search,
    report: Report,
    /// Touches of the last frame.
    touches: Touches,
    frames: u64,
    next_id: u64,
    /// `S`, and `E` of the touches.
    base: Symmetric,
    error: Symmetric,
    other_error: Symmetric,
    /// Error of each row's gain because an electrode drifts, squared.
    gains: Vec<f64>,
    frame: Whitened,
    other: Whitened,
    /// The change in all rows.
    y: Vec<f64>,
    is_missing: Vec<bool>,
    has_no_half: Vec<bool>,
    work: Vec<f64>,
    reference_v: Vec<f64>,
    step: DetectorStep,
}

impl ScoreDetector {
    /// Returns the places at which the deformations of the fabric are needed, see [`new`](Self::new).
    pub fn dent_places(model: &DetectorModel<'_>, settings: &ScoreSettings) -> Vec<DentPlace> {
        Grid::new(model.surface, settings.pitch_m).dent_places()
    }

    /// Builds a detector for frames of one skin.
    ///
    /// `dents_v`: effects on the model's voltages, volts per metre, `[measurement, effect]`, three for each of
    /// [`dent_places`](Self::dent_places) in turn: a pull of 1 m at 15 mm towards its position, a drag of 1 m at the finger along
    /// each of its tangents. No columns: unknown.
    ///
    /// # Errors
    /// Wrong lengths, invalid settings, non-finite values of used measurements, noise that is not above zero, or no used
    /// measurement.
    pub fn new(
        model: &ScoreModel<'_>,
        dents_v: &ArrayRef2<f64>,
        settings: ScoreSettings,
    ) -> Result<Self, InverseError> {
        settings.validate()?;
        let made = Model::new(model, dents_v, &settings)?;
        let (n, measurements) = (made.n, made.reference_v.len());
        Ok(Self {
            background: Background::new(&made, &settings),
            electrodes: Electrodes::new(&made),
            search: Search::default(),
            report: Report::new(model.skin.surface),
            touches: Touches::none(),
            frames: 0,
            next_id: 1,
            base: Symmetric::zeros(n),
            error: Symmetric::zeros(n),
            other_error: Symmetric::zeros(n),
            gains: vec![0.0; n],
            frame: Whitened::with_room(n),
            other: Whitened::with_room(n),
            y: vec![0.0; n],
            is_missing: vec![false; measurements],
            has_no_half: vec![false; n],
            work: Vec::new(),
            reference_v: made.reference_v.clone(),
            step: step_of(n, 0.0, 0.0),
            model: made,
            settings,
        })
    }

    /// Takes a frame `[measurement]`, volts, recorded `dt_s` seconds after the previous one, and returns its touches.
    ///
    /// `is_missing` says which values of the frame must not be used; values that are not finite are not.
    ///
    /// # Errors
    /// Wrong lengths, or a time step that is not above zero. The detector is then unchanged.
    pub fn push(
        &mut self,
        frame_v: &[f64],
        is_missing: impl Fn(usize) -> bool,
        dt_s: f64,
    ) -> Result<&[Touch], InverseError> {
        check_length("frame", frame_v.len(), self.is_missing.len())?;
        check_positive("time since the last frame", dt_s)?;
        for (i, missing) in self.is_missing.iter_mut().enumerate() {
            *missing = is_missing(i) || !frame_v[i].is_finite();
        }
        self.frames += 1;
        self.begin(frame_v, dt_s);
        let found = self.find(dt_s);
        let found = self.find_faults(found, dt_s);
        let found = self.close(found, dt_s);
        self.fit_error(&found, dt_s);
        self.step = step_of(self.frame.n(), self.frame.square, found.chi_square);
        let found = self.cool(found, dt_s);
        self.end(found, dt_s);
        Ok(self.report.touches())
    }

    /// Searches for touches while the error of the model follows them.
    fn find(&mut self, dt_s: f64) -> Hypothesis {
        for touch in self.touches.iter_mut() {
            touch.before = Some(touch.remembered(self.settings.dies_hz, dt_s));
        }
        self.search.known = self.touches.iter().flat_map(|t| &t.before).map(|b| b.odds).sum();
        self.search.turn = (self.frames % 840) as usize;
        let Self { model, settings, background, electrodes, search, .. } = self;
        let scene = Scene { model, settings, dt_s };
        let counts = |row: usize| !electrodes.is_lost[row] && !self.has_no_half[row];
        let (eta, known) = (background.eta, self.touches);
        background.errors(&scene, &known, eta, &self.gains, &mut self.error);
        self.frame.set(&self.base, &self.error, &self.y, counts);
        let mut found = search.search(&scene, &mut self.frame, &known);
        for _ in 1..PASSES {
            if !background.grows(&scene, &found.touches, eta, &self.gains, &self.error) {
                break;
            }
            background.errors(&scene, &found.touches, eta, &self.gains, &mut self.error);
            self.frame.set(&self.base, &self.error, &self.y, counts);
            found = search.search(&scene, &mut self.frame, &found.touches);
        }
        found
    }

    /// Searches again in a frame that nothing explains, with variances as large as it shows: it tells that much less.
    fn cool(&mut self, found: Hypothesis, dt_s: f64) -> Hypothesis {
        if self.step.is_explained {
            return found;
        }
        let Self { model, settings, search, frame, other, base, error, .. } = self;
        self.electrodes.is_last_known = false;
        let scene = Scene { model, settings, dt_s };
        base.scale(found.heat());
        let present = &frame.present;
        other.set(base, error, &self.y, |row| present.binary_search(&row).is_ok());
        std::mem::swap(frame, other);
        search.search(&scene, frame, &self.touches)
    }

    /// Updates the state after a frame: odds, motion, ids, reference, memory.
    fn end(&mut self, found: Hypothesis, dt_s: f64) {
        let Self { model, settings, background, search, frame, .. } = self;
        let scene = Scene { model, settings, dt_s };
        let mut touches = found.touches;
        let least = search.total(&found);
        for k in 0..touches.len() {
            let touch = touches[k];
            let gain = match prior::worth(&touch, &scene) > CERTAIN {
                true => CERTAIN,
                false => {
                    let fewer = found.touches.without(k);
                    let fewer = search.estimator.fit(&scene, frame, &fewer, 1, 0);
                    search.total(&fewer) - least
                }
            };
            touches[k].odds = gain.clamp(-CERTAIN, CERTAIN);
            touches[k].follow(settings.error_s, dt_s);
            if touches[k].odds >= settings.shown && touch.id.is_none() {
                touches[k].id = Some(self.next_id);
                self.next_id += 1;
            }
        }
        background.learn(&scene, frame, found.heat(), &mut touches, &self.y);
        self.touches = touches;
        let reference = self.background.reference.iter().zip(&self.model.row_noise_v);
        for ((r, noise), pair) in reference.zip(&self.model.rows.of) {
            pair.iter().for_each(|&i| self.reference_v[i] = self.model.reference_v[i] + r * noise);
        }
        let is_there = |pair: &[usize; 2]| pair.iter().all(|&i| !self.is_missing[i]);
        let is_whole = self.frame.n() == self.model.n && self.model.rows.of.iter().all(is_there);
        self.report.push(&self.model, &self.settings, &self.touches, &self.step, is_whole, dt_s);
    }

    /// Returns the touches of the last frame.
    pub fn touches(&self) -> &[Touch] {
        self.report.touches()
    }

    /// Returns whether touches, or the absence of any, explain the last frame.
    pub fn is_explained(&self) -> bool {
        self.step.is_explained
    }

    /// Returns how the last frame was explained.
    pub fn step(&self) -> DetectorStep {
        self.step
    }

    /// Returns the state of each electrode.
    pub fn electrodes(&self) -> &[ElectrodeState] {
        &self.electrodes.states
    }

    /// Returns whether a measurement of the last frame does not count.
    pub fn is_missing(&self, measurement: usize) -> bool {
        let is_lost = |(of, state): (&Vec<usize>, &ElectrodeState)| {
            matches!(state, ElectrodeState::Noisy | ElectrodeState::Stuck)
                && of.contains(&measurement)
        };
        self.is_missing.get(measurement).copied().unwrap_or(true)
            || self.model.of_electrode.iter().zip(&self.electrodes.states).any(is_lost)
    }

    /// Returns the reference of the last frame, volts, `[measurement]`.
    pub fn reference_v(&self) -> &[f64] {
        &self.reference_v
    }

    /// Returns the number of rows, and of places at which touches are sought.
    pub fn size(&self) -> [usize; 2] {
        [self.model.n, self.model.grid.at.len()]
    }

    /// Returns the error of the model of a change, relative, as found from the frames.
    pub fn model_error(&self) -> f64 {
        self.background.eta
    }

    /// Returns the number of fits since the start.
    pub fn fits(&self) -> u64 {
        self.search.estimator.fits
    }

    /// Returns the id that the next touch will get; the first is 1.
    pub fn next_id(&self) -> u64 {
        self.next_id
    }

    /// Continues the ids of another detector: the next new touch has this id, or 1 for 0.
    pub fn set_next_id(&mut self, id: u64) {
        self.next_id = id.max(1);
    }

    /// Starts again with another reference of the same skin, `[measurement]`, volts: nothing touches it.
    ///
    /// # Errors
    /// A wrong length.
    pub fn set_reference(&mut self, reference_v: &[f64]) -> Result<(), InverseError> {
        check_length("reference_v", reference_v.len(), self.reference_v.len())?;
        self.model.reference_v.copy_from_slice(reference_v);
        self.reference_v.copy_from_slice(reference_v);
        self.background.restart(&self.model, &self.settings);
        self.electrodes = Electrodes::new(&self.model);
        self.touches = Touches::none();
        Ok(())
    }
}

/// How a frame was explained, for programs that know the other detector.
fn step_of(rows: usize, chi_square: f64, chi_square_rest: f64) -> DetectorStep {
    DetectorStep::new(
        rows,
        [chi_square, chi_square_rest],
        report::is_explained(rows, chi_square_rest),
    )
}
