//! Places on a learnt skin: fine ones at which touches are located, and coarse ones at which they are sought.

use crate::geometry::{distance_m, extent_m};
use crate::touch::skin::{Place, tangents};
use eit_core::vector::{cross, dot, nearest, sub};
use eit_mesh::Surface;

/// Distance between coarse places, as a fraction of the skin's radius: half of the radius of a press.
const COARSE: f64 = 1.0 / 12.0;
/// Fine places within this many coarse distances of a coarse one belong to its neighbourhood.
const AROUND: f64 = 2.3;

/// Distance from other touches, as a fraction of the skin's radius, from which a touch is far from them: on three skins,
/// what presses of which nothing is known show beside themselves is nearer.
const FAR: f64 = 0.75;

#[derive(Debug, Clone)]
pub(super) struct SkinPlaces {
    far_m: f64,
    pub(super) at: Vec<Place>,
    /// Indices of the coarse places, ...
    pub(super) coarse: Vec<usize>,
    /// ... and of the fine ones around each.
    pub(super) near: Vec<Vec<usize>>,
    /// Mean squared error of a place due to the distance of fine and of coarse places, square metres.
    pub(super) cells_m2: [f64; 2],
}

impl SkinPlaces {
    pub(super) fn new(surface: &Surface, places_m: &[[f64; 3]]) -> Self {
        let centroids = surface.centroids();
        let place = |position_m: &[f64; 3]| {
            let triangle = nearest(centroids.iter().copied(), *position_m).map_or(0, |(at, _)| at);
            Place { position_m: *position_m, tangents: tangents(surface.corners(triangle)) }
        };
        let apart_m = COARSE * 0.5 * extent_m(surface);
        let mut coarse: Vec<usize> = Vec::new();
        for (k, place) in places_m.iter().enumerate() {
            if coarse.iter().all(|&other| distance_m(places_m[other], *place) >= apart_m) {
                coarse.push(k);
            }
        }
        let around = |home: &usize| {
            let is_near = |k: &usize| distance_m(places_m[*k], places_m[*home]) <= AROUND * apart_m;
            (0..places_m.len()).filter(is_near).collect()
        };
        let area_m2: f64 = surface.areas_m2().iter().sum();
        let cell = |count: usize| area_m2 / count.max(1) as f64 / 12.0;
        Self {
            far_m: FAR * 0.5 * extent_m(surface),
            at: places_m.iter().map(place).collect(),
            near: coarse.iter().map(around).collect(),
            cells_m2: [cell(places_m.len()), cell(coarse.len())],
            coarse,
        }
    }

    /// Whether two places are far from each other.
    pub(super) fn are_far(&self, one: usize, other: usize) -> bool {
        distance_m(self.at[one].position_m, self.at[other].position_m) >= self.far_m
    }

    /// Index of the fine place nearest to a point.
    pub(super) fn nearest(&self, point_m: [f64; 3]) -> usize {
        nearest(self.at.iter().map(|place| place.position_m), point_m).map_or(0, |(at, _)| at)
    }

    /// Index in the list of coarse places of the one nearest to a fine place.
    pub(super) fn home(&self, place: usize) -> usize {
        let point_m = self.at[place].position_m;
        let coarse = self.coarse.iter().map(|&k| self.at[k].position_m);
        nearest(coarse, point_m).map_or(0, |(at, _)| at)
    }

    /// Unit normal at a place.
    pub(super) fn normal(&self, place: usize) -> [f64; 3] {
        let [first, second] = self.at[place].tangents;
        cross(first, second)
    }

    /// Step from a point to a place along the tangents there, metres.
    pub(super) fn along(&self, tangents: &[[f64; 3]; 2], from_m: [f64; 3], to: usize) -> [f64; 2] {
        let way = sub(self.at[to].position_m, from_m);
        [dot(tangents[0], way), dot(tangents[1], way)]
    }
}
