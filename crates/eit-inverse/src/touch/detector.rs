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

/// What the search of a frame needs to know.
macro_rules! scene {
    ($detector:expr) => {
        Scene {
            frame: &$detector.whitened,
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
mod follow;
mod gains;
mod joint;
mod late;
mod least_squares;
mod memory;
mod model;
mod places;
mod quiet;
mod reconsider;
mod report;
mod responses;
mod rows;
mod scene;
mod search;
mod settings;
mod slides;
mod step;
mod vectors;
mod whitening;

#[cfg(feature = "learn")]
pub(crate) use dictionary::bell_at;
pub(crate) use places::Places;
pub use step::{DetectedTouch, DetectorStep, LearntTouch};
pub(crate) use vectors::dot;
pub use {
    dents::DentPlace, electrodes::UnknownKind, model::DetectorModel, settings::DetectorSettings,
};
pub(super) use {model::check, rows::Rows, vectors::widest};

use crate::InverseError;
use crate::check::{check_length, check_positive};
use dents::Dents;
use dictionary::Dictionary;
use earlier::EarlierReferences;
use electrodes::Electrodes;
use gains::Gains;
use joint::Joint;
use late::Late;
use memory::Memory;
use model::whitening_of;
use places::Spot;
use scene::{Fit, Scene};
use search::Search;
use slides::Slides;
use whitening::Whitening;

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
        let (whitening, acted) = whitening_of(model, &rows)?;
        let places = Places::new(model.surface, settings.spacing_m);
        let dictionary =
            Dictionary::new(model.surface, model.jacobian, &places, &rows, &whitening, &settings)?;
        let (n, measurements) = (rows.of.len(), model.used.len());
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
            electrodes: Electrodes::new(acted, settings.max_touches),
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
        self.search_with_actions();
        self.reconsider();
        if self.search.may_be_left_behind(&scene!(self)) {
            self.drop_left_behind();
        }
        let blamed = self.blamed().or_else(|| self.blamed_beside_known());
        self.report();
        self.follow(dt_s);
        Ok(self.step(blamed))
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
        let scene = scene!(self);
        self.search.gains_at(&scene, spots)
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
        check_positive("time since the last frame", dt_s)?;
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

    /// Searches for touches, together with what those found before do to electrodes, contacts and the fabric.
    fn search_with_actions(&mut self) {
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
            self.project();
            let scene = scene!(self);
            match pass {
                0 => {
                    self.search.run(&scene);
                    self.collect();
                }
                _ => self.search.go_on(&scene),
            }
            // what the touches found do to electrodes may explain others away
            self.electrodes.add(&self.search.best.spots, &self.before, &self.places, &self.dents);
        }
    }

    /// Drops what remains of touches that have ended: electrodes and contacts come back from a slide in ways of their
    /// own.
    fn drop_left_behind(&mut self) {
        self.is_updated = false;
        let [actions, dented] = self.electrodes.with_each_alone();
        self.whitening.set_free(actions, dented);
        self.project();
        self.search.prune(&scene!(self));
    }

    /// Projects the free unknowns out of the frame and the memory's columns.
    fn project(&mut self) {
        self.whitened.copy_from_slice(&self.white);
        self.whitening.project(&mut self.whitened);
        self.memory.prepare(&self.whitening);
    }
}
