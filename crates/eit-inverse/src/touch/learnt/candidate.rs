//! A touch of a hypothesis, and where it is.

use super::places::SkinPlaces;
use super::thresholds::Stated;
use eit_core::vector::{dot, sub};

/// A touch of a hypothesis.
#[derive(Debug, Clone, Default)]
pub(super) struct Candidate {
    pub(super) place: usize,
    pub(super) strength: f64,
    /// -2 ln L gained when it was added.
    pub(super) evidence: f64,
    /// Index of its coarse place.
    pub(super) home: usize,
    /// -2 ln L at the fine places around, and at all coarse places, the other touches fixed.
    pub(super) near: Vec<f64>,
    pub(super) far: Vec<f64>,
}

impl Candidate {
    /// Mean and covariance of the place, from the likelihoods at the fine places around it and, where
    /// that is wider, on the whole skin.
    pub(super) fn place(&self, places: &SkinPlaces, stated: &Stated) -> ([f64; 3], [[f64; 3]; 3]) {
        let touch = self;
        let position_m = mean_place(&places.near[touch.home], &touch.near, places, stated);
        let tangents = &places.at[touch.place].tangents;
        let spread = |which: &[usize], scores: &[f64], cell_m2: f64| {
            let mut sum = 0.0;
            let mut spread = [[0.0; 2]; 2];
            let least = scores.iter().copied().fold(f64::INFINITY, f64::min);
            for (&at, score) in which.iter().zip(scores) {
                let weight = (-0.5 * (score - least) / stated.mild).exp();
                let way = places.along(tangents, position_m, at);
                sum += weight;
                for (i, row) in spread.iter_mut().enumerate() {
                    (0..2).for_each(|j| row[j] += weight * way[i] * way[j]);
                }
            }
            for (i, row) in spread.iter_mut().enumerate() {
                row.iter_mut().for_each(|v| *v /= sum);
                row[i] += cell_m2 + stated.floor_m2;
            }
            spread
        };
        let fine = spread(&places.near[touch.home], &touch.near, places.cells_m2[0]);
        let whole = spread(&places.coarse, &touch.far, places.cells_m2[1]);
        let trace = |s: &[[f64; 2]; 2]| s[0][0] + s[1][1];
        let wider = if trace(&whole) > trace(&fine) { whole } else { fine };
        let covariance = std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                let mut sum = 0.0;
                for (a, row) in wider.iter().enumerate() {
                    for (b, value) in row.iter().enumerate() {
                        sum += value * tangents[a][i] * tangents[b][j];
                    }
                }
                stated.wide * sum
            })
        });
        (position_m, covariance)
    }

    /// Squared distance from where the touch was, in units of its covariance, and the determinant of that.
    pub(super) fn distance2(
        &self,
        truth_m: [f64; 3],
        places: &SkinPlaces,
        stated: &Stated,
    ) -> (f64, f64) {
        let (position_m, covariance) = self.place(places, stated);
        let [first, second] = places.at[self.place].tangents;
        let times = |t: [f64; 3]| covariance.map(|row| dot(t, row));
        let way = sub(position_m, truth_m);
        let [x, y] = [dot(first, way), dot(second, way)];
        let (a, b, c) =
            (dot(first, times(first)), dot(first, times(second)), dot(second, times(second)));
        let determinant = (a * c - b * b).max(f64::MIN_POSITIVE);
        ((c * x * x - 2.0 * b * x * y + a * y * y) / determinant, determinant)
    }
}

fn mean_place(near: &[usize], scores: &[f64], places: &SkinPlaces, stated: &Stated) -> [f64; 3] {
    let least = scores.iter().copied().fold(f64::INFINITY, f64::min);
    let (mut sum, mut mean) = (0.0, [0.0; 3]);
    for (&at, score) in near.iter().zip(scores) {
        let weight = (-0.5 * (score - least) / stated.mild).exp();
        sum += weight;
        (0..3).for_each(|i| mean[i] += weight * places.at[at].position_m[i]);
    }
    mean.map(|m| m / sum)
}
