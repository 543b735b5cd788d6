//! What a search knows of the skin and the previous frames, and the price of touches by it.

use super::dictionary::Dictionary;
use super::evidence::Evidence;
use super::late::Late;
use super::memory::Memory;
use super::places::{Places, Spot};
use super::settings::DetectorSettings;
use super::slides::{SAME_M, Slides};
use super::whitening::Whitening;
use crate::geometry::distance_m;

/// Factor by which the residual's excess must fall for each added touch.
const PRICE: f64 = 1.6;

/// The same for a touch that continues one of the previous frame.
pub(super) const PRICE_OF_KNOWN: f64 = 1.25;

/// The same for a touch that splits off a sliding one: within the distance below of that touch and
/// of its previous position. One finger was shown as two at its sides with factors of up to 3;
/// fingers that land 22 to 45 mm beside another one are found as early as without this price.
const PRICE_OF_SPLIT: f64 = 4.0;
const SPLIT_M: f64 = 35e-3;

/// The same for one touch in place of two that began separately. While the dents of both are free,
/// one bell fits two fingers nearly as well.
const PRICE_OF_MERGING: f64 = 1.6;

/// Fraction of the least distance below which a further touch belongs to the print of another one.
/// Without it, one of six recordings of closing fingers shows a third touch for 16 frames.
const CLOSE: f64 = 0.88;

/// Number of other touches above which the least share of a new touch increases, by half with each.
/// Six fingers show a seventh of up to a quarter of their strength; with a limit of three,
/// fingertips of a hand would be lost.
const CROWD: f64 = 4.0;

/// Touches that together explain a frame.
#[derive(Debug, Clone, Default)]
pub(super) struct Fit {
    pub(super) spots: Vec<Spot>,
    pub(super) strengths: Vec<f64>,
    /// Shares of the memory's columns.
    pub(super) shares: Vec<f64>,
    /// Squared length of the residual.
    pub(super) rest: f64,
    /// Factor by which the residual grows without each touch.
    pub(super) worth: Vec<f64>,
}

impl Fit {
    pub(super) fn copy_from(&mut self, other: &Self) {
        self.spots.clone_from(&other.spots);
        self.strengths.clone_from(&other.strengths);
        self.shares.clone_from(&other.shares);
        self.worth.clone_from(&other.worth);
        self.rest = other.rest;
    }
}

/// Quantities of the skin that a search needs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scene<'a> {
    /// The whitened frame without lost rows and free unknowns.
    pub(super) frame: &'a [f64],
    pub(super) places: &'a Places,
    pub(super) dictionary: &'a Dictionary,
    pub(super) whitening: &'a Whitening,
    pub(super) memory: &'a Memory,
    pub(super) settings: &'a DetectorSettings,
    pub(super) late: &'a Late,
    /// Touches of the previous frame.
    pub(super) before: &'a Slides,
    /// Positions with too little evidence in the previous frame, and its chi^2.
    pub(super) weak: &'a [([f64; 3], f64)],
}

impl Scene<'_> {
    /// Whether a touch of the previous frame may continue here.
    pub(super) fn is_known(&self, at_m: [f64; 3]) -> bool {
        self.before.spots.iter().any(|before| distance_m(before.position_m, at_m) < SAME_M)
    }

    /// Logarithm of the factor by which the residual's excess must fall for these touches.
    pub(super) fn price(&self, spots: &[Spot]) -> f64 {
        let of = |k: usize| match self.is_known(spots[k].position_m) {
            _ if self.is_split_off(spots, k) => PRICE_OF_SPLIT.ln(),
            true => PRICE_OF_KNOWN.ln(),
            false => PRICE.ln(),
        };
        (0..spots.len()).map(of).sum::<f64>() + self.merged(spots) as f64 * PRICE_OF_MERGING.ln()
    }

    /// Number of touches of the previous frame that began separately and share their nearest touch
    /// with an earlier one of them.
    fn merged(&self, spots: &[Spot]) -> usize {
        let nearest = |before: &Spot| {
            let way_m = |spot: &Spot| distance_m(spot.position_m, before.position_m);
            let ways = spots.iter().map(way_m).enumerate().filter(|(_, way_m)| *way_m < SPLIT_M);
            ways.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(k, _)| k)
        };
        let alone = || self.before.alone().enumerate();
        let is_merged = |&(k, before): &(usize, &Spot)| {
            let own = nearest(before);
            own.is_some() && alone().take(k).any(|(_, other)| nearest(other) == own)
        };
        alone().filter(is_merged).count()
    }

    /// Whether a touch has split off: it lies beside one that continues a touch of the previous
    /// frame, closer than two touches may be or beside a sliding one, and continues none itself.
    fn is_split_off(&self, spots: &[Spot], k: usize) -> bool {
        let way_m = |a: &Spot, b: &Spot| distance_m(a.position_m, b.position_m);
        let goes_on = |before: &Spot| {
            (0..spots.len())
                .min_by(|&a, &b| way_m(&spots[a], before).total_cmp(&way_m(&spots[b], before)))
        };
        let is_near = |before: &&Spot| way_m(before, &spots[k]) < SPLIT_M;
        if self.before.spots.iter().filter(is_near).any(|before| goes_on(before) == Some(k)) {
            return false;
        }
        let is_beside = |before: &Spot, near_m: f64| {
            goes_on(before).is_some_and(|at| way_m(&spots[at], &spots[k]) < near_m)
        };
        let near = || self.before.spots.iter().filter(is_near);
        near().any(|before| is_beside(before, CLOSE * self.settings.apart_m))
            || self.before.sliding().filter(is_near).any(|slid| is_beside(slid, SPLIT_M))
    }

    /// Least strength of a touch beside the others of a fit.
    pub(super) fn least_strength(&self, fit: &Fit, k: usize) -> f64 {
        let settings = self.settings;
        let goes_on = self.is_known(fit.spots[k].position_m);
        // compare with touches that explain more; in a poorly sensed corner strengths are arbitrary
        let more = (0..fit.spots.len()).filter(|&i| fit.worth[i] >= fit.worth[k]);
        let strongest = more.map(|i| fit.strengths[i]).fold(0.0, f64::max);
        // what several fingers do to each other looks like a faint one between them
        let (crowd, here) = match goes_on {
            true => (1.0, 0.0),
            false => {
                let crowd = 1.0 + 0.5 * (fit.spots.len() as f64 - 1.0 - CROWD);
                (crowd.max(1.0), self.late.here_s_m2[fit.spots[k].place])
            }
        };
        settings
            .least_s_m2
            .max(settings.least_share * crowd * strongest)
            .max(settings.least_share_of_late * self.late.strongest_s_m2)
            .max(settings.least_share_of_here * here)
    }

    /// Evidence of the previous frame for a touch here that was then too weak, chi^2.
    pub(super) fn earlier(&self, at_m: [f64; 3]) -> f64 {
        let near = self.weak.iter().filter(|(weak_m, _)| distance_m(*weak_m, at_m) < SAME_M);
        near.map(|(_, gain)| *gain).fold(0.0, f64::max)
    }

    /// Units in which residuals of the frame are weighed.
    pub(super) fn evidence(&self) -> Evidence {
        Evidence::new(self.whitening.expected(), self.whitening.present())
    }

    /// Cost of a fit: that of its residual, and the price of its touches.
    pub(super) fn cost(&self, fit: &Fit) -> f64 {
        self.evidence().cost(fit.rest) + self.price(&fit.spots)
    }
}
