//! How far single touches are found from where they are, beside the Cramer-Rao bound.

use super::eyes::Eyes;
use super::lab::{Lab, RADIUS_M, RINGS, Random, bell};
use super::table::{Cell, Table, quantile, rms};
use super::{Grid, METHODS, at_each};
use crate::error::ReportError;
use eit_inverse::touch::Nuisance;
use ndarray::Array2;
use std::f64::consts::{SQRT_2, TAU};

/// Root mean square over median of the length of a plane normal vector: `sqrt(1 / ln 2)`.
const RMS_OVER_MEDIAN: f64 = 1.201;

/// A touch farther than this is not the one sought: three radii of it, metres.
const WITHIN_M: f64 = 3.0 * RADIUS_M;

/// Frames that the weights of ST-TV are chosen on.
const WEIGHT_FRAMES: usize = 3;

/// One method at one ring and noise.
pub(super) struct Errors {
    pub ring: f64,
    pub noise_db: f64,
    pub method: usize,
    pub trials: usize,
    /// Distances of the found touches, metres.
    pub errors_m: Vec<f64>,
    /// Trials whose strongest touch is somewhere else.
    pub elsewhere: usize,
    /// Least root mean square distance, metres.
    pub bound_m: f64,
}

impl Errors {
    /// Typical error over the bound: by the median, so that outliers do not decide.
    pub fn factor(&self) -> f64 {
        RMS_OVER_MEDIAN * quantile(&self.errors_m, 0.5) / self.bound_m
    }
}

/// Places of a ring: equal steps of the angle between two electrodes from a seeded start, so that
/// no symmetry helps. The centre is one place.
pub(super) fn places(lab: &Lab, ring: f64, count: usize) -> Vec<[f64; 2]> {
    let electrodes = lab.data.mesh.electrodes().len() as f64;
    let first = TAU * Random::new(17, (100.0 * ring) as u64).uniform();
    let at = |k: usize| {
        // once around the skin, and once through the gap between electrodes
        let part = k as f64 / count as f64;
        let angle = first + TAU * part + TAU / electrodes * part;
        let r = ring * lab.radius_m;
        [r * angle.cos(), r * angle.sin()]
    };
    (0..count).map(at).collect()
}

/// Every method at every ring and noise.
pub(super) fn measure(
    lab: &Lab,
    grid: &Grid,
    bar: &eit_skin::Steps<'_>,
) -> Result<Vec<Errors>, ReportError> {
    at_each(grid.noise_db, |noise_db| {
        let mut eyes = Eyes::new(lab, noise_db)?;
        let mut all = Vec::new();
        for ring in RINGS {
            all.extend(at_ring(lab, &mut eyes, (ring, noise_db), grid)?);
            bar.inc();
        }
        Ok(all)
    })
}

fn at_ring(
    lab: &Lab,
    eyes: &mut Eyes<'_>,
    (ring, noise_db): (f64, f64),
    grid: &Grid,
) -> Result<Vec<Errors>, ReportError> {
    let reference = &lab.reference_v;
    let mut errors: [Vec<f64>; 3] = Default::default();
    let mut elsewhere = [0; 3];
    let mut bounds_m = Vec::new();
    for (k, place) in places(lab, ring, grid.places).into_iter().enumerate() {
        let truth = bell(place);
        let clean = lab.voltages(&[truth])?;
        let bounds = eyes.fit.bound(&[truth], Nuisance::AmplitudeAndRadius)?;
        bounds_m.extend(bounds.iter().map(|b| SQRT_2 * b.position_std_m));
        let mut random = Random::new(k as u64, (10.0 * noise_db + 1000.0 * ring) as u64);
        let noise = eyes.noise_std_v;
        if k == 0 {
            let few = (0..WEIGHT_FRAMES).flat_map(|_| random.noisy(&clean, noise)).collect();
            let shape = (WEIGHT_FRAMES, clean.len());
            let few = Array2::from_shape_vec(shape, few)
                .map_err(|e| ReportError::Failure(e.to_string()))?;
            eyes.open_tv(few, reference)?;
        }
        for _ in 0..grid.trials.div_ceil(grid.places) {
            let frame = random.noisy(&clean, noise);
            let found = found_at(eyes, &frame, reference)?;
            for (method, at) in found.into_iter().enumerate() {
                let Some(error_m) = at.map(|at| distance_m(at, place)) else { continue };
                if error_m <= WITHIN_M {
                    errors[method].push(error_m);
                } else {
                    elsewhere[method] += 1;
                }
            }
        }
    }
    let trials = grid.places * grid.trials.div_ceil(grid.places);
    let bound_m = rms(&bounds_m);
    let of = |(method, errors_m)| {
        let elsewhere = elsewhere[method];
        Errors { ring, noise_db, method, trials, errors_m, elsewhere, bound_m }
    };
    Ok(errors.into_iter().enumerate().map(of).collect())
}

/// Place of the strongest touch that each method finds in a frame.
///
/// The fit of one bell counts where Schwarz's criterion asks for it (`TouchFit::fit_number`).
fn found_at(
    eyes: &mut Eyes<'_>,
    frame: &[f64],
    reference: &[f64],
) -> Result<[Option<[f64; 3]>; 3], ReportError> {
    let one_step = eyes.one_step(frame, reference)?.first().map(|t| t.position_m);
    let tv = eyes.tv(frame, reference)?.first().map(|t| t.position_m);
    let fit = eyes.one_bell(frame, reference)?;
    let gain = (fit.chi_square_without - fit.chi_square) / fit.reduced_chi_square().max(1.0);
    let wanted = fit.covariance.nrows() as f64 * (frame.len() as f64).ln();
    let bell = fit.touches.first().filter(|_| gain > wanted).map(|t| t.bell.position_m);
    Ok([one_step, tv, bell])
}

/// Straight distance in the plane, metres.
pub(super) fn distance_m(found: [f64; 3], place: [f64; 2]) -> f64 {
    (found[0] - place[0]).hypot(found[1] - place[1])
}

/// The table of positions.
pub(super) fn table(lab: &Lab, grid: &Grid, all: &[Errors]) -> Table {
    let diameter_m = 2.0 * lab.radius_m;
    let row = |errors: &Errors| {
        let [median, p95] = [0.5, 0.95].map(|part| quantile(&errors.errors_m, part));
        let found = errors.errors_m.len() as f64 / errors.trials as f64;
        vec![
            Cell::text(errors.ring),
            Cell::text(errors.noise_db),
            Cell::text(METHODS[errors.method]),
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
            "Bells of 10 mm and 30 %, {} trials a row ({} places of the ring, seeded), one frame \
             each; data of {} nodes, images of {}, fit on {} (from 65 dB on {}). Noise: standard \
             deviation of each difference, in decibel below the root mean square of the reference \
             voltages. Ring: part of the radius. Bound: Cramer-Rao, root mean square distance, \
             amplitude and radius unknown. Factor: 1.201 times median over bound (1 for a normal \
             error at the bound; below 1 where few are found, those that noise has helped). \
             Found: the strongest touch is within {:.0} mm; errors are those of the found. \
             Elsewhere: it is farther. Images: above the noise floor of one false touch an hour at \
             20 Hz, of ST-TV measured on {} quiet frames; fit: Schwarz's criterion asks for it. \
             ST-TV of a single frame, never below 0 (st-tv ≥ 0).",
            all.first().map_or(0, |e| e.trials),
            grid.places,
            lab.data.mesh.surface().nodes().len(),
            lab.bench.skin().mesh.surface().nodes().len(),
            lab.bench.skin().mesh.surface().nodes().len(),
            lab.fine_fit.mesh.surface().nodes().len(),
            1e3 * WITHIN_M,
            lab.quiet,
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
