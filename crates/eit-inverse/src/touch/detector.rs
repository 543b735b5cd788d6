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
            late_s_m2: $detector.late_s_m2,
            late_here_s_m2: &$detector.late_here_s_m2,
            before: &$detector.before,
            weak: &$detector.weak,
        }
    };
}

mod dents;
mod dictionary;
mod electrodes;
mod evidence;
mod joint;
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
mod whitening;

#[cfg(feature = "learn")]
pub(crate) use dictionary::bell_at;
pub use electrodes::UnknownKind;
pub(crate) use places::Places;
pub use settings::DetectorSettings;

use super::fit::in_space;
use crate::InverseError;
use crate::check::{check_length, check_positive};
use crate::geometry::distance_m;
use dents::Dents;
use dictionary::Dictionary;
use eit_mesh::Surface;
use electrodes::Electrodes;
use faer::Mat;
use joint::Joint;
use memory::Memory;
use ndarray::{ArrayRef2, ArrayView2};
use places::Spot;
use rows::Rows;
use search::{Fit, Scene, Search};
use slides::Slides;
use whitening::{Whitening, dot};

/// Inputs of a [`TouchDetector`]. Rows `[measurement]` are in protocol order.
#[derive(Debug, Clone, Copy)]
pub struct DetectorModel<'a> {
    /// The skin.
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
    /// Frames during which nothing touched the skin, `[frame, measurement]`, volts. What varies in them
    /// beyond the noise (waves in a tank, hum, a swinging cable) is not taken for touch. May have no rows.
    pub quiet_v: ArrayView2<'a, f64>,
    /// Which measurements are used.
    pub used: &'a [bool],
    /// Index of each measurement's reciprocal; its own index if it has none.
    pub reciprocal: &'a [usize],
    /// Measurements that involve each electrode; empty to turn off the search for faulty electrodes.
    pub of_electrode: &'a [Vec<usize>],
}

/// A touch found in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct DetectedTouch {
    /// Position on the skin, metres.
    pub position_m: [f64; 3],
    /// Unit normal of the mesh at that position, on the side from which the corners of its triangles run
    /// counter-clockwise; +z on a flat skin.
    pub normal: [f64; 3],
    /// Covariance of the position, square metres, from noise and nuisance parameters, scaled by the
    /// residual chi^2 per row if that exceeds 1.
    pub position_covariance_m2: [[f64; 3]; 3],
    /// Integral of the conductivity change, S m^2, with its sign.
    pub strength_s_m2: f64,
    /// Standard deviation of the strength, S m^2, computed like the covariance of the position.
    pub strength_std_s_m2: f64,
    /// Peak of the conductivity change, siemens, with its sign.
    pub peak_s: f64,
    /// 1 plus the chi^2 that this touch removes over what the residual has beyond the noise (but at least 0.3
    /// per row): the factor by which the residual grows without it, where the model's error dominates.
    pub worth: f64,
    /// Result of the map learnt from presses at known positions and forces, if there is one.
    pub learnt: Option<LearntTouch>,
}

/// What a map learnt from presses says about a touch.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct LearntTouch {
    /// Force and its standard deviation, newtons, if forces were learnt.
    pub force_n: Option<[f64; 2]>,
    /// Whether the frame is unlike every learnt press. Position and strength then do not come from the map,
    /// and no force is given.
    pub is_unlike: bool,
}

/// How a frame was explained.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct DetectorStep {
    /// Number of rows present.
    pub rows: usize,
    /// Squared length of the whitened frame; without a touch, the expectation of each row is below 1.
    pub chi_square: f64,
    /// Squared length after subtracting what the fabric's memory explains.
    pub chi_square_without: f64,
    /// Squared length of the residual after fitting touches.
    pub chi_square_rest: f64,
    /// The electrode whose gain alone explains the frame far better than touches do.
    pub blamed: Option<usize>,
}

/// Largest residual of an explained frame, over its number of rows. Simulated fabrics leave up to 50 under the
/// touches that were found and up to 7 without any; frames whose voltages change the other way leave 1 000 and more.
const MOST_PER_ROW: f64 = 20.0;
/// Largest part of a frame's squared length that an explained frame leaves: strong touches leave more per row, since
/// the model is linear, but up to a quarter of their own frame.
const MOST_OF_FRAME: f64 = 0.3;

impl DetectorStep {
    /// Returns whether touches, or the absence of any, explain the frame: little is left of it, or little per row.
    /// Data of another kind, such as touches that change the conductivity the other way, is not explained.
    pub fn is_explained(&self) -> bool {
        self.chi_square_rest <= MOST_PER_ROW * self.rows.max(1) as f64
            || self.chi_square_rest <= MOST_OF_FRAME * self.chi_square
    }
}

/// Most searches of a frame, each with what the touches found before do to electrodes.
const PASSES: usize = 3;

/// Largest part of the residual that one electrode's gain may leave for the electrode to be reported: of a frame
/// without touches, of what touches leave, and of what the frame has without its touches. On three fresh seeds of
/// ten scripts with sound electrodes the best gain left 0.18 and more of the first, 0.33 and more of the second.
const BLAME: [f64; 3] = [0.13, 0.2, 0.1];

/// Largest part of the residual of a frame without touches, and of what noise leaves, that a gain may leave which explains
/// the frame: a drift that begins as a finger lands is to be found before the finger hides it. One of 1 % a second left 0.21
/// and 0.26, 2.1 and 1.8 in its first two frames; in 50 recordings with sound electrodes none was named.
const EXPLAINED_BY: [f64; 2] = [0.35, 3.0];

/// Residual chi^2 per row above which such frames are checked; noise leaves up to 0.7.
const EXPLAINED_FROM: f64 = 3.0;

/// Residual chi^2 per row above which electrodes are checked.
const BLAME_FROM: f64 = 5.0;

/// Time for which the reference is kept at least while frames show touches or stay unexplained, seconds: longer than a
/// fault stays unnoticed.
const KEPT_S: f64 = 3.0;

/// Most by which the strongest touch counts as stronger than the next one. In a poorly sensed corner strengths are arbitrary,
/// up to twenty times too large, and touches of the next seconds were taken for what such a one had left behind.
const BELIEVED: f64 = 4.0;

/// Time constant with which recent strengths near a position fade while something touches the skin, seconds: what
/// memory explains then does not enter the reference, and fabric settles in some 10 s. With 5 s, one of 45 recordings of
/// slides shows a trail as a touch after the next two slides.
const KEPT_HERE_S: f64 = 20.0;

/// Distance within which hysteresis left by a touch can show, metres.
const LATE_M: f64 = 20e-3;

/// Strength of the strongest touch of a frame, as far as others make it likely.
fn strongest_believed(strengths: &[f64]) -> f64 {
    let [first, second] =
        strengths.iter().fold([0.0_f64; 2], |[first, second], &s| match s > first {
            true => [s, first],
            false => [first, second.max(s)],
        });
    if second > 0.0 { first.min(BELIEVED * second) } else { first }
}

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
    /// The reference of the last frame that no touch was needed to explain, or of three to six seconds ago, and a later
    /// one.
    earlier_v: [Vec<f64>; 2],
    /// Time since the later one was taken, seconds.
    earlier_s: f64,
    /// Strongest recent touch, S m^2, fading.
    late_s_m2: f64,
    /// Strongest recent touch near each position, S m^2, fading.
    late_here_s_m2: Vec<f64>,
    /// Touches of the last frame.
    before: Slides,
    /// Positions with too little evidence in the last frame, metres, and its chi^2.
    weak: Vec<([f64; 3], f64)>,
    /// Whitened gain of each electrode, `[electrode][row]`.
    gains: Vec<f64>,
    is_missing: Vec<bool>,
    lost: Vec<usize>,
    difference: Vec<f64>,
    folded: Vec<f64>,
    whitened: Vec<f64>,
    /// The same with no row lost and no action on electrodes.
    white: Vec<f64>,
    electrodes: Electrodes,
    dents: Dents,
    /// Touches together with their actions; `None` before dents are known.
    joint: Option<Joint>,
    /// Places where the first search or the previous frame has touches.
    candidates: Vec<Spot>,
    /// Touches that are reconsidered, and others in their place.
    held: Fit,
    other: Fit,
    third: Fit,
    /// Touches of the first search.
    first: Fit,
    basis: Vec<f64>,
    /// Whether a touch was found together with its actions.
    is_joint: bool,
    /// Whether the dictionary knows which unknowns are free.
    is_updated: bool,
    touch_v: Vec<f64>,
    memory_v: Vec<f64>,
    /// What touches do to rows through electrodes and contacts, volts.
    acted_v: Vec<f64>,
    gain_of: Vec<f64>,
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
            gains: gains(model, &rows, &whitening),
            reference_v: model.reference_v.to_vec(),
            earlier_v: [model.reference_v.to_vec(), model.reference_v.to_vec()],
            earlier_s: 0.0,
            late_s_m2: 0.0,
            late_here_s_m2: vec![0.0; places.len()],
            before: Slides::new(settings.max_touches),
            weak: Vec::with_capacity(settings.max_touches),
            is_missing: vec![false; measurements],
            lost: Vec::with_capacity(n),
            difference: vec![0.0; measurements],
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
            first: Fit::default(),
            basis: Vec::new(),
            is_joint: false,
            is_updated: true,
            touch_v: vec![0.0; n],
            memory_v: vec![0.0; n],
            acted_v: vec![0.0; n],
            gain_of: vec![0.0; n],
            touches: Vec::with_capacity(settings.max_touches),
            errors_m: Vec::with_capacity(settings.max_touches),
            settings,
            places,
            rows,
            whitening,
            dictionary,
        })
    }

    /// Positions at which the effect of a dent has to be known, see [`with_dents`](Self::with_dents), metres.
    pub fn dent_positions_m(&self) -> Vec<[f64; 3]> {
        self.dents.at.iter().map(|&place| self.places.at[place].position_m).collect()
    }

    /// Lets each touch pull the skin towards itself, as well as electrodes alone.
    ///
    /// `dents_v`: effect of a pull towards each of [`dent_positions_m`](Self::dent_positions_m) on the model's
    /// voltages, volts per standard deviation, `[measurement, position]`.
    ///
    /// # Errors
    /// Wrong lengths, values of used measurements that are not finite.
    pub fn with_dents(mut self, dents_v: &ArrayRef2<f64>) -> Result<Self, InverseError> {
        check_length("rows of the dents", dents_v.nrows(), self.is_missing.len())?;
        check_length("columns of the dents", dents_v.ncols(), self.dents.at.len())?;
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
        self.whitening.apply(&self.folded, &mut self.white);
        if self.whitening.lose(&self.lost) {
            self.dictionary.update(&self.whitening);
        }
        self.memory.whiten(&self.rows, &self.whitening, &self.settings);
        self.electrodes.start(&self.before.spots, &self.places, &self.dents);
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
            self.electrodes.add(&self.search.best.spots, &self.places, &self.dents);
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
        let scene = scene!(self);
        let alone = best_gain(
            &self.gains,
            &self.whitening,
            &mut self.gain_of,
            &self.search.residual_without,
        );
        let blamed = match alone {
            // not a touch but a contact that got worse
            Some((electrode, rest))
                if !self.is_joint && self.search.is_beaten_by_gain(&scene, rest) =>
            {
                self.search.take_back(&scene, &self.whitened);
                Some(electrode)
            }
            _ => self.blamed(),
        };
        self.report();
        self.follow(dt_s);
        let of = |v: &[f64]| dot(v, v);
        Ok(DetectorStep {
            rows: self.whitening.present(),
            chi_square: of(&self.whitened),
            chi_square_without: of(&self.search.residual_without),
            chi_square_rest: self.search.best.rest,
            blamed,
        })
    }

    /// Returns how much a touch at each of the given positions lowers the chi^2 of the last frame, all fitted
    /// together with the frame's other effects, from these positions on.
    ///
    /// This is the evidence that a frame holds for touches whose positions are known, to find out whether a
    /// touch was missed or could not be seen. Allocates; ignores positions beyond the largest number of
    /// touches.
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

    /// Sets the reference of one measurement, for one that has come back and whose old reference no longer
    /// holds. Ignores non-finite values.
    pub fn set_reference(&mut self, measurement: usize, value_v: f64) {
        if value_v.is_finite() && measurement < self.reference_v.len() {
            self.reference_v[measurement] = value_v;
            self.earlier_v.iter_mut().for_each(|earlier_v| earlier_v[measurement] = value_v);
        }
    }

    /// Takes back what the reference followed in the last seconds under touches and in frames that nothing explained,
    /// for when an electrode turns out to be faulty: until then the finger that was pressing may have become part of
    /// the reference, which would show a touch elsewhere from its lift on.
    pub fn take_back_reference(&mut self) {
        self.reference_v.copy_from_slice(&self.earlier_v[0]);
        self.earlier_v[1].copy_from_slice(&self.reference_v);
        self.earlier_s = 0.0;
    }

    /// Returns the change of one measurement due to the last frame's touches, volts.
    pub fn touch_of(&self, measurement: usize) -> f64 {
        let row = self.rows.of.iter().position(|pair| pair.contains(&measurement));
        row.map_or(0.0, |row| self.rows.ratio[measurement] * self.touch_v[row])
    }

    /// Returns the number of rows: used measurements, where a measurement and its reciprocal count as one.
    pub fn rows(&self) -> usize {
        self.whitening.rows()
    }

    /// Returns the number of candidate positions and how many of them the present rows can sense.
    pub fn places(&self) -> (usize, usize) {
        (self.places.len(), self.dictionary.seen())
    }

    /// Returns the settings.
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
            self.difference[i] = if *missing { 0.0 } else { frame[i] - self.reference_v[i] };
        }
        let Self { rows, difference, is_missing, folded, lost, .. } = self;
        rows.fold_present(difference, is_missing, folded, lost);
        Ok(())
    }

    /// Finds the electrode whose gain explains the frame, before or after touches, far better than they do.
    fn blamed(&mut self) -> Option<usize> {
        let (left, rows) = (self.search.best.rest, self.whitening.present() as f64);
        let is_touched = !self.search.best.spots.is_empty();
        if !is_touched && left > EXPLAINED_FROM * rows {
            let residual = &self.search.residual;
            let found = best_gain(&self.gains, &self.whitening, &mut self.gain_of, residual);
            let [part, times] = EXPLAINED_BY;
            let bar = (part * left).min(times * self.whitening.expected());
            if let Some((electrode, _)) = found.filter(|(_, rest)| *rest < bar) {
                return Some(electrode);
            }
        }
        if left <= BLAME_FROM * rows {
            return None;
        }
        let [of_untouched, of_rest, of_whole] = BLAME;
        let of_rest = if is_touched { of_rest } else { of_untouched };
        let (mut blamed, mut least) = (None, 0.5 * left);
        for (residual, part) in
            [(&self.search.residual_without, of_whole), (&self.search.residual, of_rest)]
        {
            let bar = least.min(part * dot(residual, residual));
            let found = best_gain(&self.gains, &self.whitening, &mut self.gain_of, residual);
            if let Some((electrode, rest)) = found.filter(|(_, rest)| *rest < bar) {
                (least, blamed) = (rest, Some(electrode));
            }
        }
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

    /// Keeps the reference for [`take_back_reference`](Self::take_back_reference).
    fn keep_reference(&mut self, is_doubtful: bool, dt_s: f64) {
        let Self { reference_v, earlier_v, earlier_s, .. } = self;
        if !is_doubtful {
            earlier_v.iter_mut().for_each(|earlier_v| earlier_v.copy_from_slice(reference_v));
            *earlier_s = 0.0;
            return;
        }
        *earlier_s += dt_s;
        if *earlier_s >= KEPT_S {
            earlier_v.swap(0, 1);
            earlier_v[1].copy_from_slice(reference_v);
            *earlier_s = 0.0;
        }
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
            self.whitening.explained(&self.search.residual, &mut self.gain_of, &mut self.acted_v);
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
        self.keep_reference(is_touched || !is_explained, dt_s);
        let best = &self.search.best;
        let fade = if is_touched { 0.0 } else { weight };
        let touches = best.spots.iter().zip(&best.strengths).zip(&self.errors_m);
        let touches = touches.map(|((spot, strength), error_m)| (*spot, *strength, *error_m));
        self.memory.take(&self.touch_v, touches, dt_s, fade, &self.dictionary, &self.settings);
        let strongest = strongest_believed(&best.strengths);
        self.before.take(&best.spots, dt_s);
        self.weak.clone_from(&self.search.weak);
        // what a touch leaves behind enters the reference, but hardly while something touches the skin
        let late_s = self.settings.late_s;
        let late_here_s = if is_touched { late_s.max(KEPT_HERE_S) } else { late_s };
        self.late_s_m2 = strongest.max(self.late_s_m2 * (-dt_s / late_s).exp());
        let fading = (-dt_s / late_here_s).exp();
        self.late_here_s_m2.iter_mut().for_each(|late| *late *= fading);
        for (spot, strength) in best.spots.iter().zip(&best.strengths) {
            for (late, place) in self.late_here_s_m2.iter_mut().zip(&self.places.at) {
                if distance_m(place.position_m, spot.position_m) < LATE_M {
                    *late = late.max(*strength);
                }
            }
        }
    }
}

fn check(model: &DetectorModel<'_>) -> Result<(), InverseError> {
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

/// Returns the effect of each electrode's gain: the reference values of its measurements, whitened and
/// scaled to length 1.
fn gains(model: &DetectorModel<'_>, rows: &Rows, whitening: &Whitening) -> Vec<f64> {
    let n = rows.of.len();
    let mut gains = vec![0.0; model.of_electrode.len() * n];
    let mut values = vec![0.0; model.used.len()];
    let mut folded = vec![0.0; n];
    for (measurements, gain) in model.of_electrode.iter().zip(gains.chunks_exact_mut(n)) {
        values.fill(0.0);
        let used = measurements.iter().filter(|&&i| model.used[i]);
        used.for_each(|&i| values[i] = model.reference_v[i]);
        rows.fold(&values, &mut folded);
        whitening.apply(&folded, gain);
        let length = dot(gain, gain).sqrt().max(f64::MIN_POSITIVE);
        gain.iter_mut().for_each(|g| *g /= length);
    }
    gains
}

/// Returns the electrode whose gain explains most of a residual, and the chi^2 that it leaves.
fn best_gain(
    gains: &[f64],
    whitening: &Whitening,
    gain_of: &mut [f64],
    residual: &[f64],
) -> Option<(usize, f64)> {
    let whole = dot(residual, residual);
    let mut best = None;
    for (electrode, gain) in gains.chunks_exact(residual.len().max(1)).enumerate() {
        gain_of.copy_from_slice(gain);
        whitening.project(gain_of);
        let square = dot(gain_of, gain_of);
        if square < 1e-6 {
            continue;
        }
        let rest = whole - dot(gain_of, residual).powi(2) / square;
        if best.is_none_or(|(_, least)| rest < least) {
            best = Some((electrode, rest));
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame is explained by what little is left of it or of each of its rows; either is enough.
    #[test]
    fn explained_by_part_or_by_row() {
        let step = |chi_square: f64, chi_square_rest: f64| DetectorStep {
            rows: 100,
            chi_square,
            chi_square_without: chi_square,
            chi_square_rest,
            blamed: None,
        };
        // noise, memory, a strong touch whose model is off, a faint one; and touches of the other sign
        for (all, rest) in [(50.0, 50.0), (2e3, 7e2), (1e6, 2e5), (2.5e3, 1.9e3)] {
            assert!(step(all, rest).is_explained(), "{all} {rest}");
        }
        assert!(!step(4e5, 2e5).is_explained() && !step(3e4, 3e4).is_explained());
    }

    /// One touch alone is believed, and one that is far stronger than all others only in part.
    #[test]
    fn the_strength_of_an_outlier_is_not_believed() {
        for (strengths, wanted) in [
            (&[][..], 0.0),
            (&[7.0], 7.0),
            (&[1.0, 3.0, 2.0], 3.0),
            (&[20.0, 1.0, 1.5], 6.0),
            (&[0.5, 20.0], 2.0),
            (&[20.0, 0.0], 20.0),
        ] {
            assert_eq!(strongest_believed(strengths), wanted, "{strengths:?}");
        }
    }
}
