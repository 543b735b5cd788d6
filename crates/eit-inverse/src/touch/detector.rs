//! Touches straight from frames, fitted together with everything else that changes a frame.
//!
//! ```text
//! v - v_ref = sum_k a_k d(c_k) + M s + K q + noise
//! ```
//!
//! `d(c)` is the response of the linearised model to a bell of 1 S m^2 at position `c`. `K q` is the effect
//! of moving electrodes, contacts and the sheet as a whole (`q` normal, mean 0, variance 1). `M s` is what
//! the fabric remembers of earlier touches, with `s` within bounds. `K q` and the noise form one
//! covariance, by which everything is whitened once. A touch must lower the residual of a frame by more
//! than all of these do:
//!
//! 1. Greedy search over positions. After each new touch all strengths and positions are fitted together
//!    (damped Gauss-Newton). The search starts from the touches of the previous frame. The number of touches
//!    minimises the cost of the residual ([`evidence`]) plus `ln(1.6)` for each new one.
//! 2. Backward elimination. A touch stays if its evidence is enough, if it is not too faint beside the others
//!    and not too close to a stronger one. A touch that was there in the previous frame needs less evidence
//!    than a new one, and a new one may collect it over two frames. One that began alone is not a part of its
//!    neighbour's print; a new one beside five or more others must be stronger. If what is left explains the frame
//!    worse than the touches of the previous frame, fitted to this one, those are taken.
//! 3. The reference follows what touches do not explain, so it never locks up.
//!
//! A finger that slides leaves a trail, and together with it looks like two touches about its place ([`slides`]). So
//! two where one slid must explain the frame far better.
//!
//! What a touch does to electrodes, contacts and the fabric around it ([`dents`]) is a covariance of its own
//! ([`electrodes`]). The search starts with that of the previous frame's touches. Each further touch adds its own, and
//! the search goes on from the touches found, at most three times in all. Touches of little worth are then weighed as one
//! with what they do ([`reconsider`]). Touches much fainter than a recent one must also hold when every electrode may move
//! by itself. What the covariance explains does not enter the reference, since it ends with the touch.
//!
//! Measurements that are missing from a frame are projected out ([`whitening`]).
//!
//! **Cost** for `n` rows, `G` positions, `K` touches: whitening takes `n^2` flops for the frame and for
//! each memory column, each touch one scan of `2 n G` and fits of about `2 n (3 K)^2`. With 104 rows and
//! 1 200 positions that is 0.4 Mflop per frame without touches and 4 Mflop with eight. The dictionary holds
//! `3 n G` numbers (3 MB), of which a scan reads 1 MB; this bounds its speed. Nothing is allocated once the
//! vectors have grown to the largest number of touches.
//!
//! Source: matching pursuit with orthogonal refits (Pati, Rezaiifar, Krishnaprasad, *Asilomar* 27 (1993),
//! 40-44), with moving positions; correlated noise as in Kaipio, Somersalo (2005), section 3.3.
//!
//! One file over 300 lines: the detector is one state, and its steps share most of its fields.

/// What the search of a frame needs to know.
macro_rules! scene {
    ($detector:expr) => {
        Scene {
            places: &$detector.places,
            dictionary: &$detector.dictionary,
            whitening: &$detector.whitening,
            memory: &$detector.memory,
            settings: &$detector.settings,
            late: &$detector.late,
            before: &$detector.before,
            weak: &$detector.weak,
        }
    };
}

mod dents;
mod dictionary;
mod earlier;
mod electrodes;
mod evidence;
mod gains;
mod joint;
mod late;
mod least_squares;
mod memory;
mod places;
mod quiet;
mod reconsider;
mod responses;
mod rows;
mod search;
mod settings;
mod slides;
mod step;
mod vectors;
mod whitening;

#[cfg(feature = "learn")]
pub(crate) use dictionary::bell_at;
pub use electrodes::UnknownKind;
pub(crate) use places::Places;
pub(super) use rows::Rows;
pub use settings::DetectorSettings;
pub use step::{DetectedTouch, DetectorStep, LearntTouch};
pub(super) use vectors::widest;

use super::skin::{Place, in_space};
use crate::InverseError;
use crate::check::{check_length, check_positive};
use dents::Dents;
use dictionary::Dictionary;
use earlier::EarlierReferences;
use eit_mesh::Surface;
use electrodes::Electrodes;
use faer::Mat;
use gains::{BLAME_FROM, Gains};
use joint::Joint;
use late::Late;
use memory::Memory;
use ndarray::{ArrayRef2, ArrayView2};
use places::Spot;
use search::{Fit, Scene, Search};
use slides::Slides;
pub(crate) use vectors::dot;
use whitening::Whitening;

/// Inputs of a [`TouchDetector`]. Rows `[measurement]` are in protocol order.
#[derive(Debug, Clone, Copy)]
pub struct DetectorModel<'a> {
    /// Surface of the skin.
    pub surface: &'a Surface,
    /// Jacobian, `[measurement, element]`, volts per siemens.
    pub jacobian: &'a ArrayRef2<f64>,
    /// Voltages of the untouched model, volts.
    pub model_v: &'a [f64],
    /// Other effects on the model's voltages, one column per unknown, volts per standard deviation of the
    /// unknown: `[measurement, unknown]`.
    pub unknowns: &'a ArrayRef2<f64>,
    /// Kind of each unknown. Each touch has its own unknowns for the electrodes and contacts that it affects;
    /// without a touch these vary by only a small part of their stated deviation. Empty: touches affect none of
    /// them.
    pub kinds: &'a [UnknownKind],
    /// The reference frame, volts.
    pub reference_v: &'a [f64],
    /// Standard deviation of the noise of a frame minus the reference, volts.
    pub noise_std_v: &'a [f64],
    /// Frames during which nothing touched the skin, `[frame, measurement]`, volts. Variation
    /// beyond the noise (waves in a tank, hum, a swinging cable) does not count as a touch. May
    /// have no rows.
    pub quiet_v: ArrayView2<'a, f64>,
    /// Which measurements are used.
    pub used: &'a [bool],
    /// Index of each measurement's reciprocal; its own index if it has none.
    pub reciprocal: &'a [usize],
    /// Measurements that involve each electrode; empty to turn off the search for faulty electrodes.
    pub of_electrode: &'a [Vec<usize>],
}

/// Squared length per row up to which a frame matches an earlier reference, and above which it does
/// not match the current one; noise leaves up to 0.7.
const AS_BEFORE: [f64; 2] = [1.5, 10.0];

/// A position at which the effects of a touch on the fabric around it are needed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DentPlace {
    /// Position on the skin, metres.
    pub position_m: [f64; 3],
    /// Orthonormal vectors along the skin.
    pub tangents: [[f64; 3]; 2],
}

/// Maximum number of searches per frame, each of which uses the effects on electrodes of the
/// touches found before.
const PASSES: usize = 3;

/// Finds touches in frames: bells on the linearised model, fitted together with all other effects on the
/// frame.
#[derive(Debug, Clone)]
pub struct TouchDetector {
    settings: DetectorSettings,
    places: Places,
    rows: Rows,
    whitening: Whitening,
    dictionary: Dictionary,
    memory: Memory,
    search: Search,
    reference_v: Vec<f64>,
    earlier: EarlierReferences,
    late: Late,
    /// Touches of the last frame.
    before: Slides,
    /// Positions with too little evidence in the last frame, metres, and its chi^2.
    weak: Vec<([f64; 3], f64)>,
    gains: Gains,
    is_missing: Vec<bool>,
    lost: Vec<usize>,
    difference: Vec<f64>,
    since_earlier: Vec<f64>,
    folded: Vec<f64>,
    whitened: Vec<f64>,
    /// Whitening with no row lost and no action on electrodes.
    white: Vec<f64>,
    electrodes: Electrodes,
    dents: Dents,
    /// Touches together with their actions; `None` before dents are known.
    joint: Option<Joint>,
    /// Positions of touches in the first search or the previous frame.
    candidates: Vec<Spot>,
    /// Touches that are reconsidered, and candidates that may replace them.
    held: Fit,
    other: Fit,
    third: Fit,
    /// Touches of the last frame that was explained.
    known: Vec<Spot>,
    /// Touches of the first search.
    first: Fit,
    basis: Vec<f64>,
    /// Whether a touch was found together with its actions.
    is_joint: bool,
    /// Whether the dictionary is up to date with the free unknowns.
    is_updated: bool,
    touch_v: Vec<f64>,
    memory_v: Vec<f64>,
    /// Effect of the touches on the rows through electrodes and contacts, volts.
    acted_v: Vec<f64>,
    /// Workspace, `[row]`.
    work: Vec<f64>,
    touches: Vec<DetectedTouch>,
    /// Root mean square position error of each touch from noise and nuisance parameters, metres.
    errors_m: Vec<f64>,
}

impl TouchDetector {
    /// Builds a detector for frames of one skin.
    ///
    /// # Errors
    /// Wrong lengths, invalid settings, non-finite values of used measurements, noise that is not above
    /// zero, or no used measurement.
    pub fn new(
        model: &DetectorModel<'_>,
        settings: DetectorSettings,
    ) -> Result<Self, InverseError> {
        settings.validate()?;
        check(model)?;
        let rows = Rows::new(model.reciprocal, model.used, model.reference_v, model.model_v)?;
        let n = rows.of.len();
        let variance = |&[i, j]: &[usize; 2]| {
            let [a, b] = [i, j].map(|k| model.noise_std_v[k].powi(2));
            if i == j { a } else { 0.25 * (a + b) }
        };
        let variances: Vec<f64> = rows.of.iter().map(variance).collect();
        let unknowns = Mat::from_fn(n, model.unknowns.ncols(), |row, k| {
            let [i, j] = rows.of[row];
            let column = |i: usize| rows.ratio[i] * model.unknowns[(i, k)];
            0.5 * (column(i) + column(j))
        });
        let kind_of = |k: usize| model.kinds.get(k).copied().unwrap_or(UnknownKind::Other);
        let acted: Vec<usize> =
            (0..unknowns.ncols()).filter(|&k| kind_of(k) != UnknownKind::Other).collect();
        let local = Mat::from_fn(n, acted.len(), |row, k| unknowns[(row, acted[k])]);
        let unknowns = Mat::from_fn(n, unknowns.ncols(), |row, k| {
            kind_of(k).share_alone() * unknowns[(row, k)]
        });
        let whitening = Whitening::new(&variances, unknowns.as_ref())?;
        let whitening = match quiet::components(&rows, &whitening, model.quiet_v) {
            Some(more) => {
                let (known, count) = (unknowns.ncols(), unknowns.ncols() + more.ncols());
                let all = Mat::from_fn(n, count, |i, k| match k.checked_sub(known) {
                    None => unknowns[(i, k)],
                    Some(k) => more[(i, k)],
                });
                Whitening::new(&variances, all.as_ref())?
            }
            None => whitening,
        };
        let whitening = whitening.with_local(local.as_ref());
        let places = Places::new(model.surface, settings.spacing_m);
        let dictionary =
            Dictionary::new(model.surface, model.jacobian, &places, &rows, &whitening, &settings)?;
        let measurements = model.used.len();
        Ok(Self {
            memory: Memory::new(n, &settings),
            search: Search::new(n, &settings),
            gains: Gains::new(model, &rows, &whitening),
            reference_v: model.reference_v.to_vec(),
            earlier: EarlierReferences::new(model.reference_v),
            late: Late::new(&places),
            before: Slides::new(settings.max_touches),
            weak: Vec::with_capacity(settings.max_touches),
            is_missing: vec![false; measurements],
            lost: Vec::with_capacity(n),
            difference: vec![0.0; measurements],
            since_earlier: vec![0.0; measurements],
            folded: vec![0.0; n],
            whitened: vec![0.0; n],
            white: vec![0.0; n],
            electrodes: Electrodes::new(
                acted.iter().map(|&k| kind_of(k)).collect(),
                settings.max_touches,
            ),
            dents: Dents::new(&places),
            joint: None,
            candidates: Vec::with_capacity(4 * settings.max_touches),
            held: Fit::default(),
            other: Fit::default(),
            third: Fit::default(),
            known: Vec::with_capacity(settings.max_touches),
            first: Fit::default(),
            basis: Vec::with_capacity(3 * settings.max_touches * n),
            is_joint: false,
            is_updated: true,
            touch_v: vec![0.0; n],
            memory_v: vec![0.0; n],
            acted_v: vec![0.0; n],
            work: vec![0.0; n],
            touches: Vec::with_capacity(settings.max_touches),
            errors_m: Vec::with_capacity(settings.max_touches),
            settings,
            places,
            rows,
            whitening,
            dictionary,
        })
    }

    /// Returns the positions at which the effects of a touch on the fabric around it are needed,
    /// see [`with_dents`](Self::with_dents).
    pub fn dent_places(&self) -> Vec<DentPlace> {
        let of = |&place: &usize| {
            let Place { position_m, tangents, .. } = self.places.at[place];
            DentPlace { position_m, tangents }
        };
        self.dents.at.iter().map(of).collect()
    }

    /// Lets each touch pull the skin towards itself, and drag it along if it slides, as well as electrodes alone.
    ///
    /// `dents_v`: effects on the model's voltages, volts per standard deviation, `[measurement, effect]`, three for each of
    /// [`dent_places`](Self::dent_places) in turn: a pull towards its position, a drag along each of its tangents.
    ///
    /// # Errors
    /// Wrong lengths, values of used measurements that are not finite.
    pub fn with_dents(mut self, dents_v: &ArrayRef2<f64>) -> Result<Self, InverseError> {
        check_length("rows of the dents", dents_v.nrows(), self.is_missing.len())?;
        check_length(
            "columns of the dents",
            dents_v.ncols(),
            dents::EFFECTS * self.dents.at.len(),
        )?;
        for &measurement in self.rows.of.iter().flatten() {
            if let Some(element) = dents_v.row(measurement).iter().position(|v| !v.is_finite()) {
                let value = dents_v[(measurement, element)];
                return Err(InverseError::NonFiniteJacobian { measurement, element, value });
            }
        }
        self.dents.set(dents_v, &self.rows, &self.whitening, &self.dictionary);
        let Self { dents, electrodes, places, dictionary, whitening, .. } = &self;
        self.joint = Some(Joint::new(dents, electrodes, places, dictionary, whitening));
        Ok(self)
    }

    /// Takes a frame `[measurement]`, volts, recorded `dt_s` seconds after the previous one; its touches
    /// are then in [`touches`](Self::touches).
    ///
    /// `is_missing` says which values of the frame must not be used.
    ///
    /// # Errors
    /// Wrong lengths, a non-finite value that is not marked missing, or a time step that is not above zero.
    /// The detector is then unchanged.
    pub fn push(
        &mut self,
        frame: &[f64],
        is_missing: impl Fn(usize) -> bool,
        dt_s: f64,
    ) -> Result<DetectorStep, InverseError> {
        self.take(frame, is_missing, dt_s)?;
        if self.whitening.lose(&self.lost) {
            self.dictionary.update(&self.whitening);
        }
        self.whitening.apply(&self.folded, &mut self.white);
        if let Some(which) = self.came_back() {
            self.earlier.come_back(which, &mut self.reference_v);
            self.subtract_reference(frame);
            self.whitening.apply(&self.folded, &mut self.white);
        }
        self.memory.whiten(&self.rows, &self.whitening, &self.settings);
        self.electrodes.start(&self.before, &self.places, &self.dents);
        for pass in 0..PASSES {
            let is_changed =
                self.whitening.set_free(&self.electrodes.actions, &self.electrodes.dented);
            if is_changed || !self.is_updated {
                self.dictionary.update_free(&self.whitening);
                self.is_updated = true;
            } else if pass > 0 {
                break;
            }
            self.whitened.copy_from_slice(&self.white);
            self.whitening.project(&mut self.whitened);
            self.memory.prepare(&self.whitening);
            let scene = scene!(self);
            match pass {
                0 => {
                    self.search.run(&scene, &self.whitened);
                    self.collect();
                }
                _ => self.search.go_on(&scene, &self.whitened),
            }
            // what the touches found do to electrodes may explain others away
            self.electrodes.add(&self.search.best.spots, &self.before, &self.places, &self.dents);
        }
        self.reconsider();
        if self.search.may_be_left_behind(&scene!(self)) {
            self.is_updated = false;
            // electrodes and contacts come back from a slide in ways of their own
            let [actions, dented] = self.electrodes.with_each_alone();
            self.whitening.set_free(actions, dented);
            self.whitened.copy_from_slice(&self.white);
            self.whitening.project(&mut self.whitened);
            self.memory.prepare(&self.whitening);
            self.search.prune(&scene!(self), &self.whitened);
        }
        let alone = self.gains.best(&self.whitening, &self.search.residual_without);
        let scene = scene!(self);
        let blamed = match alone {
            // not a touch but a contact that got worse
            Some((electrode, rest))
                if !self.is_joint && self.search.is_beaten_by_gain(&scene, rest) =>
            {
                self.search.take_back(&scene, &self.whitened);
                Some(electrode)
            }
            _ => {
                let whole = dot(&self.whitened, &self.whitened);
                self.gains.blamed(&self.search, &self.whitening, whole)
            }
        };
        let blamed = blamed.or_else(|| self.blamed_beside_known());
        self.report();
        self.follow(dt_s);
        let of = |v: &[f64]| dot(v, v);
        let (rows, whole, rest) =
            (self.whitening.present(), of(&self.whitened), self.search.best.rest);
        Ok(DetectorStep {
            rows,
            chi_square: whole,
            chi_square_without: of(&self.search.residual_without),
            chi_square_rest: rest,
            blamed,
            is_explained: step::is_explained(rows, whole, rest),
        })
    }

    /// Returns the point of the skin nearest to a point, metres.
    pub fn nearest_on_skin(&self, point_m: [f64; 3]) -> [f64; 3] {
        self.places.nearest(point_m).position_m
    }

    /// Returns how much a touch at each of the given positions lowers the chi^2 of the last frame,
    /// all fitted together with the frame's other effects, from these positions on.
    ///
    /// This measures the evidence in a frame for touches at known positions, which distinguishes a
    /// missed touch from one that the data cannot show. Allocates; ignores positions beyond the
    /// largest number of touches.
    pub fn evidence_at(&mut self, positions_m: &[[f64; 3]]) -> Vec<f64> {
        let positions_m = &positions_m[..positions_m.len().min(self.settings.max_touches)];
        let spots = positions_m.iter().map(|p| self.places.nearest(*p)).collect();
        let Self { search, whitened, .. } = self;
        let scene = scene!(self);
        search.gains_at(&scene, whitened, spots)
    }

    /// Returns the touches of the last frame, in no particular order.
    pub fn touches(&self) -> &[DetectedTouch] {
        &self.touches
    }

    /// Returns the reference that the next frame is compared with, volts, `[measurement]`. Values of unused
    /// measurements never change.
    pub fn reference_v(&self) -> &[f64] {
        &self.reference_v
    }

    /// Sets the reference of one measurement that has recovered and whose old reference is no
    /// longer valid. Ignores non-finite values.
    pub fn set_reference(&mut self, measurement: usize, value_v: f64) {
        if value_v.is_finite() && measurement < self.reference_v.len() {
            self.reference_v[measurement] = value_v;
            self.earlier.set(measurement, value_v);
        }
    }

    /// Undoes what the reference has followed in the last seconds under touches and in unexplained
    /// frames. Call it when an electrode turns out to be faulty: a pressing finger may have become
    /// part of the reference, and would show a touch elsewhere once it lifts.
    pub fn take_back_reference(&mut self) {
        self.earlier.restore(&mut self.reference_v);
    }

    /// Returns the number of rows: used measurements, where a measurement and its reciprocal count as one.
    pub fn rows(&self) -> usize {
        self.whitening.rows()
    }

    /// Returns the number of candidate positions and how many of them the present rows can sense.
    pub fn places(&self) -> (usize, usize) {
        (self.places.len(), self.dictionary.seen())
    }

    /// Returns the settings that the detector was created with.
    pub fn settings(&self) -> &DetectorSettings {
        &self.settings
    }

    /// Checks a frame and folds its differences into rows.
    fn take(
        &mut self,
        frame: &[f64],
        is_missing: impl Fn(usize) -> bool,
        dt_s: f64,
    ) -> Result<(), InverseError> {
        check_length("frame", frame.len(), self.reference_v.len())?;
        if !(dt_s > 0.0 && dt_s.is_finite()) {
            let (quantity, must) = ("time since the last frame", "finite and above zero");
            return Err(InverseError::OutOfRange { quantity, value: dt_s, must });
        }
        for &measurement in self.rows.of.iter().flatten() {
            let value = frame[measurement];
            if !value.is_finite() && !is_missing(measurement) {
                return Err(InverseError::NonFiniteData { frame: 0, measurement, value });
            }
        }
        for (i, missing) in self.is_missing.iter_mut().enumerate() {
            *missing = is_missing(i) || !frame[i].is_finite();
        }
        self.subtract_reference(frame);
        Ok(())
    }

    /// Folds the differences from the reference into rows.
    fn subtract_reference(&mut self, frame: &[f64]) {
        let Self { rows, reference_v, difference, is_missing, folded, lost, .. } = self;
        for (i, difference) in difference.iter_mut().enumerate() {
            *difference = if is_missing[i] { 0.0 } else { frame[i] - reference_v[i] };
        }
        rows.fold_present(difference, is_missing, folded, lost);
    }

    /// Returns the earlier reference that the frame matches, except for noise, if it differs far
    /// from the current one. The change that has disappeared was neither touch nor drift, such as a
    /// loose contact, and was part of the reference for a while.
    fn came_back(&mut self) -> Option<usize> {
        let Self { whitening, rows, earlier, reference_v, difference, is_missing, .. } = self;
        let [least, most] = AS_BEFORE.map(|part| part * whitening.present() as f64);
        self.work.copy_from_slice(&self.white);
        whitening.project(&mut self.work);
        if dot(&self.work, &self.work) < most {
            return None;
        }
        earlier.others().position(|other_v| {
            for (i, own) in self.since_earlier.iter_mut().enumerate() {
                let since = if is_missing[i] { 0.0 } else { reference_v[i] - other_v[i] };
                *own = difference[i] + since;
            }
            rows.fold_present(&self.since_earlier, is_missing, &mut self.touch_v, &mut self.lost);
            whitening.apply(&self.touch_v, &mut self.work);
            whitening.project(&mut self.work);
            dot(&self.work, &self.work) < least
        })
    }

    /// Finds an electrode whose gain explains this frame together with the touches of the last
    /// explained frame, if nothing else does: a contact that changes under a finger.
    fn blamed_beside_known(&mut self) -> Option<usize> {
        if self.search.best.rest <= BLAME_FROM * self.whitening.present() as f64 {
            self.known.clone_from(&self.search.best.spots);
            return None;
        }
        if self.known.is_empty() {
            return None;
        }
        self.work.copy_from_slice(&self.whitened);
        let Self { search, gains, known, basis, work, .. } = self;
        let scene = scene!(self);
        search.without(&scene, known, work, basis);
        let blamed = gains.beside_known(&self.whitening, work, basis);
        search.fit_best_again(&scene, &self.whitened);
        blamed
    }

    fn report(&mut self) {
        let (sign, gain) = (self.settings.sign.factor(), self.whitening.present().max(1) as f64);
        let Self { search, places, dictionary, touches, errors_m, .. } = self;
        touches.clear();
        errors_m.clear();
        let best = std::mem::take(&mut search.best);
        for (k, spot) in best.spots.iter().enumerate() {
            touches.push(DetectedTouch {
                position_m: spot.position_m,
                normal: places.normal(spot),
                position_covariance_m2: [[0.0; 3]; 3],
                strength_s_m2: sign * best.strengths[k],
                strength_std_s_m2: 0.0,
                peak_s: sign * best.strengths[k] * dictionary.top(spot.place),
                worth: best.worth[k],
                learnt: None,
            });
        }
        let excess = (best.rest / gain).max(1.0);
        let homes: [usize; 16] =
            std::array::from_fn(|k| best.spots.get(k).map_or(0, |spot| spot.place));
        let spreads: [_; 16] = std::array::from_fn(|k| best.spots.get(k)?.spread_m2);
        search.covariances(&best, |k, strength, [a, b, c, d]| {
            let plane = [[excess * a, excess * b], [excess * c, excess * d]];
            let own = in_space(plane, places.at[homes[k]].tangents);
            touches[k].position_covariance_m2 = spreads[k].unwrap_or(own);
            let square = |m: [[f64; 3]; 3]| (0..3).map(|i| m[i][i]).sum::<f64>();
            errors_m.push(spreads[k].map_or(a + d, square).sqrt());
            touches[k].strength_std_s_m2 = (excess * strength).sqrt();
        });
        search.best = best;
    }

    /// Updates the reference and the memory.
    fn follow(&mut self, dt_s: f64) {
        let best = &self.search.best;
        let is_touched = !best.spots.is_empty();
        self.touch_v.fill(0.0);
        self.memory_v.fill(0.0);
        for (spot, strength) in best.spots.iter().zip(&best.strengths) {
            self.dictionary.add_volts(spot, *strength, &mut self.touch_v);
        }
        if is_touched {
            // what memory explains must not enter the reference while it cannot be told from touches
            self.memory.add_volts(&best.shares, &mut self.memory_v);
        }
        self.acted_v.fill(0.0);
        if is_touched {
            // ends with the touches, and must not stay in the reference
            self.whitening.explained(&self.search.residual, &mut self.work, &mut self.acted_v);
        }
        let time_s = if is_touched { self.settings.touched_s } else { self.settings.idle_s };
        let weight = -(-dt_s / time_s).exp_m1();
        for (row, pair) in self.rows.of.iter().enumerate() {
            let explained = self.touch_v[row] + self.memory_v[row];
            let [first, second] = *pair;
            for i in [first, second].into_iter().take(if first == second { 1 } else { 2 }) {
                if !self.is_missing[i] {
                    let rest =
                        self.difference[i] - self.rows.ratio[i] * explained - self.acted_v[row];
                    self.reference_v[i] += weight * rest;
                }
            }
        }
        let is_explained = best.rest <= BLAME_FROM * self.whitening.present() as f64;
        self.earlier.keep(&self.reference_v, is_touched, is_explained, dt_s);
        let best = &self.search.best;
        let fade = if is_touched { 0.0 } else { weight };
        let touches = best.spots.iter().zip(&best.strengths).zip(&self.errors_m);
        let touches = touches.map(|((spot, strength), error_m)| (*spot, *strength, *error_m));
        self.memory.take(&self.touch_v, touches, dt_s, fade, &self.dictionary, &self.settings);
        self.late.take(&best.spots, &best.strengths, &self.places, &self.settings, dt_s);
        self.before.take(&best.spots, &self.errors_m, dt_s);
        self.weak.clone_from(&self.search.weak);
    }
}

pub(super) fn check(model: &DetectorModel<'_>) -> Result<(), InverseError> {
    let DetectorModel { surface, jacobian, unknowns, .. } = model;
    let (measurements, elements) = jacobian.dim();
    check_length("Jacobian columns", elements, surface.triangles().len())?;
    check_length("model_v", model.model_v.len(), measurements)?;
    check_length("rows of the unknowns", unknowns.nrows(), measurements)?;
    if !model.kinds.is_empty() {
        check_length("kinds", model.kinds.len(), unknowns.ncols())?;
    }
    check_length("reference_v", model.reference_v.len(), measurements)?;
    check_length("noise_std_v", model.noise_std_v.len(), measurements)?;
    check_length("used", model.used.len(), measurements)?;
    check_length("reciprocal", model.reciprocal.len(), measurements)?;
    if model.quiet_v.nrows() > 0 {
        check_length("quiet_v", model.quiet_v.ncols(), measurements)?;
    }
    for i in (0..measurements).filter(|&i| model.used[i]) {
        let value = model.reference_v[i];
        if !value.is_finite() {
            return Err(InverseError::NonFiniteReference { measurement: i, value });
        }
        check_positive("noise_std_v", model.noise_std_v[i])?;
        if let Some(element) = unknowns.row(i).iter().position(|v| !v.is_finite()) {
            let value = unknowns[(i, element)];
            return Err(InverseError::NonFiniteJacobian { measurement: i, element, value });
        }
    }
    let stray = model.of_electrode.iter().flatten().find(|&&i| i >= measurements);
    match stray {
        Some(&measurement) => Err(InverseError::UnknownMeasurement { measurement, measurements }),
        None => Ok(()),
    }
}
