//! The smallest distance at which two equal touches are detected as two.

use super::super::table::{Cell, Table};
use super::estimators::{Estimator, TouchEstimators};
use super::grid::Grid;
use super::noise_levels::at_each;
use super::simulated_disc::{RADIUS_M, RINGS, SimulatedDisc, distance_m};
use crate::error::ReportError;
use eit_fem::fabric::Random;
use eit_inverse::touch::Touch;
use ndarray::Array2;
use std::f64::consts::TAU;

/// Fraction of the trials that must show two touches.
const SHARE: f64 = 0.95;

/// Maximum number of touches in a fit: two, and two false ones.
const MOST: usize = 4;

/// The smallest distance that an estimator resolves on a ring at a noise level.
pub(super) struct Separation {
    ring: f64,
    noise_db: f64,
    estimator: Estimator,
    /// Distance, metres; infinite if none of those tried is enough.
    distance_m: f64,
}

/// Measures every estimator on every ring at every noise level.
pub(super) fn measure(
    disc: &SimulatedDisc,
    grid: &Grid,
    bar: &eit_skin::Steps<'_>,
) -> Result<Vec<Separation>, ReportError> {
    at_each(grid.noise_db, |noise_db| {
        // many fits are needed, so the mesh of the images is used at every noise level
        let fit_skin = disc.model.skin();
        let mut estimators =
            TouchEstimators::fitting_on(fit_skin, disc, noise_db, grid.quiet_frames)?;
        let mut all = Vec::new();
        for ring in RINGS {
            for estimator in Estimator::ALL {
                let distance_m = least(&mut estimators, estimator, ring, grid)?;
                all.push(Separation { ring, noise_db, estimator, distance_m });
                bar.inc();
            }
        }
        Ok(all)
    })
}

/// Finds by bisection the smallest distance of the grid at which enough trials show two touches,
/// assuming that larger distances are then sufficient too.
fn least(
    estimators: &mut TouchEstimators<'_>,
    estimator: Estimator,
    ring: f64,
    grid: &Grid,
) -> Result<f64, ReportError> {
    let steps = grid.distances_m.len();
    let (mut low, mut high) = (0, steps);
    while low < high {
        let middle = (low + high) / 2;
        let pair = TouchPair { ring, apart_m: grid.distances_m[middle] };
        if separates(estimators, estimator, &pair, grid)? {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    Ok(grid.distances_m.get(high).copied().unwrap_or(f64::INFINITY))
}

/// Two touches on a ring, next to each other along the rim.
struct TouchPair {
    /// Radius of the ring relative to the skin's.
    ring: f64,
    /// Distance between them, metres.
    apart_m: f64,
}

impl TouchPair {
    /// Their positions around an angle of the ring, metres.
    fn places(&self, disc: &SimulatedDisc, angle: f64) -> [[f64; 2]; 2] {
        let Self { ring, apart_m } = *self;
        let r = ring * disc.radius_m;
        if r == 0.0 {
            return [1.0, -1.0]
                .map(|s| [0.5 * s * apart_m * angle.cos(), 0.5 * s * apart_m * angle.sin()]);
        }
        // a chord of the ring, at most its diameter
        let half = (0.5 * apart_m / r).min(1.0).asin();
        [half, -half].map(|turn| [r * (angle + turn).cos(), r * (angle + turn).sin()])
    }
}

/// Whether enough trials show both touches of a pair.
fn separates(
    estimators: &mut TouchEstimators<'_>,
    estimator: Estimator,
    pair: &TouchPair,
    grid: &Grid,
) -> Result<bool, ReportError> {
    let (disc, noise_db) = (estimators.disc, estimators.noise_db);
    let reference = &disc.reference_v;
    let allowed = ((1.0 - SHARE) * grid.pair_trials as f64 + 1e-9) as usize;
    let mut failed = 0;
    let per_place = grid.pair_trials.div_ceil(grid.places);
    let mut clean = Vec::new();
    let mut truth = [[0.0; 2]; 2];
    for trial in 0..grid.pair_trials {
        let place = trial / per_place;
        let seed = (10.0 * noise_db + 1e6 * pair.apart_m + 1e5 * pair.ring) as u64;
        let mut random = Random::named(trial as u64, "noise of a pair", seed);
        if trial % per_place == 0 {
            let angle = TAU * Random::named(23, "angle of a pair", place as u64).uniform();
            truth = pair.places(disc, angle);
            clean = disc.voltages(&truth)?;
            if trial == 0 && estimator == Estimator::StTvImage {
                let frame = random.noisy(&clean, estimators.noise_std_v);
                let frame = Array2::from_shape_vec((1, frame.len()), frame)
                    .map_err(|e| ReportError::Failure(e.to_string()))?;
                estimators.prepare_st_tv(frame, reference)?;
            }
        }
        let frame = random.noisy(&clean, estimators.noise_std_v);
        let positions = |touches: Vec<Touch>| touches.iter().map(|t| t.position_m).collect();
        let found: Vec<[f64; 3]> = match estimator {
            Estimator::OneStepImage => positions(estimators.one_step(&frame, reference)?),
            Estimator::StTvImage => positions(estimators.st_tv(&frame, reference)?),
            Estimator::BellFit => {
                let starts = estimators.starts(&frame, reference)?;
                let (best, _) = estimators.fit.fit_number(&frame, reference, &starts, MOST)?;
                best.touches.iter().map(|t| t.bell.position_m).collect()
            }
        };
        failed += usize::from(!both(&found, truth, pair.apart_m));
        if failed > allowed {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Whether exactly two touches were found, each within half of the true distance of a different
/// finger.
fn both(found: &[[f64; 3]], truth: [[f64; 2]; 2], apart_m: f64) -> bool {
    let near = |a: [f64; 3], place: [f64; 2]| distance_m(a, place) < 0.5 * apart_m;
    let [a, b] = truth;
    matches!(*found, [p, q] if (near(p, a) && near(q, b)) || (near(p, b) && near(q, a)))
}

/// Creates the table of distances.
pub(super) fn table(grid: &Grid, all: &[Separation]) -> Table {
    let mut rows: Vec<Vec<Cell>> = Vec::new();
    for of_estimators in all.chunks(Estimator::ALL.len()) {
        let Some(first) = of_estimators.first() else { continue };
        let mut row = vec![Cell::text(first.ring), Cell::text(first.noise_db)];
        for separation in of_estimators {
            debug_assert_eq!(separation.estimator, Estimator::ALL[row.len() - 2]);
            row.push(Cell::Number(1e3 * separation.distance_m, 0));
        }
        rows.push(row);
    }
    let [least, most] = [grid.distances_m.first(), grid.distances_m.last()]
        .map(|d| 1e3 * d.copied().unwrap_or(f64::NAN));
    Table {
        name: "two_points",
        title: "Two-point discrimination",
        note: format!(
            "Smallest distance in mm at which two equal bells of {:.0} mm and 30 %, next to each \
             other along the ring, are detected as exactly two, each within half of their distance \
             of its true position, in 95 % of {} trials ({} positions, seeded); distances of \
             {least:.0} to {most:.0} mm by bisection, inf: not even at the largest. Fit: as many \
             bells as Schwarz's criterion supports, at most {MOST}, on the mesh of the images at \
             every noise level. Noise and data as above.",
            1e3 * RADIUS_M,
            grid.pair_trials,
            grid.places,
        ),
        columns: ["ring", "noise, dB"]
            .into_iter()
            .chain(Estimator::ALL.map(Estimator::name))
            .collect(),
        rows,
    }
}
