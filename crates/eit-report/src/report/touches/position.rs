//! Position error of single touches, compared with the Cramer-Rao bound.

use super::super::statistics::{quantile, rms};
use super::super::table::{Cell, Table};
use super::estimators::{Estimator, TouchEstimators};
use super::grid::Grid;
use super::noise_levels::at_each;
use super::simulated_disc::{RADIUS_M, RINGS, SimulatedDisc, bell, distance_m};
use crate::error::ReportError;
use eit_fem::fabric::Random;
use eit_inverse::touch::Nuisance;
use ndarray::Array2;
use std::f64::consts::SQRT_2;

/// Ratio of root mean square to median of the length of a normal vector in the plane:
/// `sqrt(1 / ln 2)`.
const RMS_OVER_MEDIAN: f64 = 1.201;

/// A touch farther than this from the finger does not belong to it: three radii, metres.
const WITHIN_M: f64 = 3.0 * RADIUS_M;

/// Number of frames used to choose the weights of ST-TV.
const WEIGHT_FRAMES: usize = 3;

/// Errors of an estimator on a ring at a noise level.
pub(super) struct PositionErrors {
    pub ring: f64,
    pub noise_db: f64,
    pub estimator: Estimator,
    pub trials: usize,
    /// Distances of the touches found, metres.
    pub errors_m: Vec<f64>,
    /// Number of trials in which the strongest touch is elsewhere.
    pub elsewhere: usize,
    /// Lower bound of the root mean square distance, metres.
    pub bound_m: f64,
}

impl PositionErrors {
    /// Ratio of the typical error to the bound, from the median, so that it is robust against
    /// outliers.
    pub fn factor(&self) -> f64 {
        RMS_OVER_MEDIAN * quantile(&self.errors_m, 0.5) / self.bound_m
    }
}

/// Measures every estimator on every ring at every noise level.
pub(super) fn measure(
    disc: &SimulatedDisc,
    grid: &Grid,
    bar: &eit_skin::Steps<'_>,
) -> Result<Vec<PositionErrors>, ReportError> {
    at_each(grid.noise_db, |noise_db| {
        let mut estimators = TouchEstimators::new(disc, noise_db, grid.quiet_frames)?;
        let mut all = Vec::new();
        for ring in RINGS {
            all.extend(at_ring(&mut estimators, ring, grid)?);
            bar.inc();
        }
        Ok(all)
    })
}

fn at_ring(
    estimators: &mut TouchEstimators<'_>,
    ring: f64,
    grid: &Grid,
) -> Result<Vec<PositionErrors>, ReportError> {
    let (disc, noise_db) = (estimators.disc, estimators.noise_db);
    let reference = &disc.reference_v;
    let mut errors: [Vec<f64>; 3] = Default::default();
    let mut elsewhere = [0; 3];
    let mut bounds_m = Vec::new();
    for (k, place) in disc.places(ring, grid.places).into_iter().enumerate() {
        let truth = bell(place);
        let clean = disc.voltages(&[place])?;
        let bounds = estimators.fit.bound(&[truth], Nuisance::AmplitudeAndRadius)?;
        bounds_m.extend(bounds.iter().map(|b| SQRT_2 * b.position_std_m));
        let mut random =
            Random::named(k as u64, "noise at a place", (10.0 * noise_db + 1000.0 * ring) as u64);
        let noise = estimators.noise_std_v;
        if k == 0 {
            let few = (0..WEIGHT_FRAMES).flat_map(|_| random.noisy(&clean, noise)).collect();
            let shape = (WEIGHT_FRAMES, clean.len());
            let few = Array2::from_shape_vec(shape, few)
                .map_err(|e| ReportError::Failure(e.to_string()))?;
            estimators.prepare_st_tv(few, reference)?;
        }
        for _ in 0..grid.trials.div_ceil(grid.places) {
            let frame = random.noisy(&clean, noise);
            let found = found_at(estimators, &frame, reference)?;
            for (k, at) in found.into_iter().enumerate() {
                let Some(error_m) = at.map(|at| distance_m(at, place)) else { continue };
                if error_m <= WITHIN_M {
                    errors[k].push(error_m);
                } else {
                    elsewhere[k] += 1;
                }
            }
        }
    }
    let trials = grid.places * grid.trials.div_ceil(grid.places);
    let bound_m = rms(&bounds_m);
    let all = Estimator::ALL.into_iter().zip(errors).zip(elsewhere);
    let of = |((estimator, errors_m), elsewhere)| PositionErrors {
        ring,
        noise_db,
        estimator,
        trials,
        errors_m,
        elsewhere,
        bound_m,
    };
    Ok(all.map(of).collect())
}

/// Position of the strongest touch that each estimator finds in a frame, in the order of
/// [`Estimator::ALL`].
///
/// The fit of one bell counts if Schwarz's criterion supports it (`TouchFit::fit_number`).
fn found_at(
    estimators: &mut TouchEstimators<'_>,
    frame: &[f64],
    reference: &[f64],
) -> Result<[Option<[f64; 3]>; 3], ReportError> {
    let one_step = estimators.one_step(frame, reference)?.first().map(|t| t.position_m);
    let st_tv = estimators.st_tv(frame, reference)?.first().map(|t| t.position_m);
    let fit = estimators.one_bell(frame, reference)?;
    let gain = (fit.chi_square_without - fit.chi_square) / fit.reduced_chi_square().max(1.0);
    let wanted = fit.covariance.nrows() as f64 * (frame.len() as f64).ln();
    let bell = fit.touches.first().filter(|_| gain > wanted).map(|t| t.bell.position_m);
    Ok([one_step, st_tv, bell])
}

/// Creates the table of positions.
pub(super) fn table(disc: &SimulatedDisc, grid: &Grid, all: &[PositionErrors]) -> Table {
    let diameter_m = 2.0 * disc.radius_m;
    let row = |errors: &PositionErrors| {
        let [median, p95] = [0.5, 0.95].map(|part| quantile(&errors.errors_m, part));
        let found = errors.errors_m.len() as f64 / errors.trials as f64;
        vec![
            Cell::text(errors.ring),
            Cell::text(errors.noise_db),
            Cell::text(errors.estimator.name()),
            Cell::Number(found, 2),
            Cell::Number(errors.elsewhere as f64 / errors.trials as f64, 2),
            Cell::Number(1e3 * median, 2),
            Cell::Number(1e3 * p95, 2),
            Cell::Number(100.0 * median / diameter_m, 2),
            Cell::Number(100.0 * p95 / diameter_m, 2),
            Cell::Number(1e3 * errors.bound_m, 3),
            Cell::Number(1e3 * rms(&errors.errors_m), 2),
            Cell::Number(errors.factor(), 2),
        ]
    };
    Table {
        name: "position",
        title: "Position error of one touch",
        note: format!(
            "Bells of 10 mm and 30 %, {} trials per row ({} positions on the ring, seeded), one \
             frame each; data from {} nodes, images on {}, fit on {} (from 65 dB on {}). Noise: \
             standard deviation of each difference, in decibels below the root mean square of the \
             reference voltages. Ring: fraction of the radius. Bound: Cramer-Rao, root mean square \
             distance, amplitude and radius unknown. Factor: 1.201 times median over bound (1 for \
             a normal error at the bound; below 1 if few are found, because noise favours those). \
             Found: the strongest touch is within {:.0} mm; errors are those of touches found. \
             Elsewhere: it is farther. Images: above the noise floor of one false touch per hour \
             at 20 Hz, for ST-TV measured on {} quiet frames; fit: supported by Schwarz's \
             criterion. ST-TV of a single frame, never below 0 (st-tv ≥ 0).",
            all.first().map_or(0, |e| e.trials),
            grid.places,
            disc.simulation.mesh.surface().nodes().len(),
            disc.model.skin().mesh.surface().nodes().len(),
            disc.model.skin().mesh.surface().nodes().len(),
            disc.fine_fit.mesh.surface().nodes().len(),
            1e3 * WITHIN_M,
            grid.quiet_frames,
        ),
        columns: vec![
            "ring",
            "noise, dB",
            "method",
            "found",
            "elsewhere",
            "median, mm",
            "95 %, mm",
            "median, % of diameter",
            "95 %, % of diameter",
            "bound, mm",
            "rms, mm",
            "factor",
        ],
        rows: all.iter().map(row).collect(),
    }
}
