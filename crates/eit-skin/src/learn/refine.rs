//! Corrects the positions and forces of a frame's touches by what was learnt.

use super::{LearnedForce, LearnedSkin, LocalSheet, PlacesBy};
use crate::error::SkinError;
use crate::linearised::LinearisedSkin;
use eit_inverse::learn::{Located, Locator, PlaceRegression};
use eit_inverse::touch::{DetectedTouch, LearntTouch};
use std::path::Path;

/// Number of passes in which the touches of a frame are fitted one after the other.
const SWEEPS: usize = 3;

/// Maximum number of simultaneous touches, as in the detector.
const MOST: usize = 16;

/// A touch is sought within this fraction of the distance to its nearest neighbour, ...
const NEAR_PART: f64 = 0.5;
/// ... but at least within this distance, metres.
const NEAR_M: f64 = 0.015;

/// Applies what was learnt to the touches of each frame.
#[derive(Debug, Clone)]
pub(crate) struct LearnedTouches {
    locator: Locator,
    regression: Option<PlaceRegression>,
    places_by: PlacesBy,
    force: Option<LearnedForce>,
    local: LocalSheet,
    channels: Vec<usize>,
    /// Frame minus reference, `[channel]`.
    difference: Vec<f64>,
    /// The same minus all other touches.
    rest: Vec<f64>,
    /// Response of the channels to each touch, `[touch][channel]`.
    responses: Vec<f64>,
    located: Vec<Option<Located>>,
    touches: Vec<DetectedTouch>,
}

impl LearnedSkin {
    /// Reads the file that a scene names.
    ///
    /// # Errors
    ///
    /// A file that cannot be read, or that was learnt on another skin or protocol.
    pub(crate) fn read_for(file: &Path, skin: &LinearisedSkin) -> Result<Self, SkinError> {
        let learned = Self::read(file)?;
        learned.check(skin).map_err(|e| e.within(&file.display().to_string()))?;
        Ok(learned)
    }

    /// Whether the model alone was the best on the presses.
    pub(crate) fn model_is_right(&self) -> bool {
        self.places_by == PlacesBy::Model
    }
}

impl LearnedTouches {
    /// Prepares what was learnt for frames in which these measurements count and have this noise, volts.
    ///
    /// # Errors
    ///
    /// Presses learnt on another skin, protocol or choice of measurements.
    pub(crate) fn new(
        learned: &LearnedSkin,
        skin: &LinearisedSkin,
        used: &[bool],
        noise_std_v: &[f64],
        local: LocalSheet,
    ) -> Result<Self, SkinError> {
        let channels = learned.channels.clone();
        let noise: Vec<f64> = channels
            .iter()
            .map(|&i| if used[i] && noise_std_v[i].is_finite() { noise_std_v[i] } else { 0.0 })
            .collect();
        let count = channels.len();
        let regression = match learned.places_by {
            PlacesBy::Regression => {
                Some(PlaceRegression::with_settings(&learned.presses, learned.regression)?)
            }
            PlacesBy::Model | PlacesBy::Map => None,
        };
        Ok(Self {
            locator: Locator::new(learned.response_map(skin)?, &noise)?,
            regression,
            places_by: learned.places_by,
            force: learned.force.clone(),
            local,
            channels,
            difference: vec![0.0; count],
            rest: vec![0.0; count],
            responses: vec![0.0; MOST * count],
            located: Vec::with_capacity(MOST),
            touches: Vec::with_capacity(MOST),
        })
    }

    /// Returns the touches found by the model, corrected by what was learnt, using the channels that are
    /// present. Regression only handles complete frames with one touch; the map replaces it for all others.
    /// Does not allocate, except where regression locates the touch.
    pub(crate) fn refine(
        &mut self,
        values: &[f64],
        reference: &[f64],
        is_missing: impl Fn(usize) -> bool,
        found: &[DetectedTouch],
    ) -> &[DetectedTouch] {
        self.touches.clear();
        if found.is_empty() {
            return &self.touches;
        }
        self.touches.extend(found.iter().take(MOST));
        for (difference, &i) in self.difference.iter_mut().zip(&self.channels) {
            *difference = if is_missing(i) { f64::NAN } else { values[i] - reference[i] };
        }
        let Self { locator, difference, .. } = self;
        locator.set_missing(|k| !difference[k].is_finite());
        let is_whole = difference.iter().all(|d| d.is_finite());
        difference.iter_mut().filter(|d| !d.is_finite()).for_each(|d| *d = 0.0);
        self.sweep();
        let by_regression = is_whole && self.touches.len() == 1;
        for k in 0..self.touches.len() {
            match self.located[k] {
                Some(located) => self.apply(k, &located, by_regression),
                // no press explains any part of it
                None => {
                    self.touches[k].learnt = Some(LearntTouch { force_n: None, is_unlike: true });
                }
            }
        }
        &self.touches
    }

    /// Locates each touch in what the others leave of the frame, in the order of `touches`.
    fn sweep(&mut self) {
        let count = self.channels.len();
        self.located.clear();
        self.located.resize(self.touches.len(), None);
        self.responses[..self.touches.len() * count].fill(0.0);
        let sweeps = if self.touches.len() == 1 { 1 } else { SWEEPS };
        for _ in 0..sweeps {
            for k in 0..self.touches.len() {
                self.rest.copy_from_slice(&self.difference);
                let mut others = 0.0;
                for (j, response) in self.responses.chunks_exact(count).enumerate() {
                    if j != k && j < self.touches.len() {
                        self.rest.iter_mut().zip(response).for_each(|(rest, r)| *rest -= r);
                        others += response.iter().map(|r| r * r).sum::<f64>();
                    }
                }
                let near = self.near(k);
                let located = self.locator.locate(&self.rest, near, others.sqrt());
                let own = &mut self.responses[k * count..(k + 1) * count];
                own.fill(0.0);
                self.locator.add_response(own);
                self.located[k] = located;
            }
        }
    }

    /// Region in which a touch is sought; `None` (everywhere) if it is the only one and the model does not
    /// locate it.
    fn near(&self, k: usize) -> Option<([f64; 3], f64)> {
        let here = self.touches[k].position_m;
        let others = self.touches.iter().enumerate().filter(|(j, _)| *j != k);
        let nearest = others
            .map(|(_, touch)| eit_core::vector::distance(touch.position_m, here))
            .fold(f64::INFINITY, f64::min);
        if nearest.is_infinite() && self.places_by != PlacesBy::Model {
            return None;
        }
        Some((here, (NEAR_PART * nearest).max(NEAR_M)))
    }

    fn apply(&mut self, k: usize, located: &Located, by_regression: bool) {
        let touch = &mut self.touches[k];
        // the model's strength belongs to the model's position
        let model_m = touch.position_m;
        if located.is_unlike {
            touch.learnt = Some(LearntTouch { force_n: None, is_unlike: true });
            return;
        }
        if self.places_by != PlacesBy::Model {
            touch.position_m = located.position_m;
            touch.position_covariance_m2 = located.covariance_m2;
            if let Some(place) = self
                .regression
                .as_ref()
                .filter(|_| by_regression)
                .and_then(|regression| regression.place(&self.difference).ok())
            {
                touch.position_m = place.position_m;
                touch.position_covariance_m2 = std::array::from_fn(|i| {
                    std::array::from_fn(|j| if i == j { place.std_m.powi(2) } else { 0.0 })
                });
            }
        }
        let force_n = self.force.as_ref().map(|LearnedForce { strength_by, curve }| {
            let by_model = touch.strength_s_m2.abs() / self.local.ratio_at(model_m);
            let strength = strength_by.strength(Some(by_model), Some(located.strength_s_m2));
            let relative = (touch.strength_std_s_m2 / touch.strength_s_m2).abs();
            let relative = if relative.is_finite() { relative } else { 1.0 };
            let force = curve.force(strength, touch.position_m, relative);
            [force.force_n, force.std_n]
        });
        touch.learnt = Some(LearntTouch { force_n, is_unlike: false });
    }
}
