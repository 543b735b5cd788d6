//! Cost of finding touches.

use super::electrodes;
use super::machine::Machine;
use super::rates::{DECOMPOSITION_FLOPS_PER_S, PRODUCT_FLOPS_PER_S, SWEEP_FLOPS_PER_S};
use super::stage::{Stage, scale};
use crate::skin::Skin;
use eit_inverse::touch::DetectorSettings;

/// Flops per second of the scan over places, which reads a dictionary larger than any cache of one core.
const SCAN_FLOPS_PER_S: f64 = 4e9;
/// Bell and its two derivatives at each element within its reach, seconds per place and element.
const BELL_S: f64 = 1e-9;

/// Distance between neighbouring bells as a fraction of the skin's longer side (see `UnevenSheet`), and the
/// fraction of grid squares that contain a place.
const BELLS_APART: f64 = 0.06;
const FILLED: f64 = 0.9;
/// Number of sheets fitted in sequence, and factorisations for each.
const SHEETS: f64 = 2.0;
const TRIALS: f64 = 32.0;

/// Returns the stages of the set-up and of each frame.
pub(crate) fn of(skin: &Skin, machine: &Machine) -> Vec<Stage> {
    let cost = skin.model.cost();
    let (m, n) = (skin.protocol.measurements() as f64, skin.model.elements() as f64);
    // a measurement and its reciprocal count once
    let rows = cost.field_products as f64;
    let surface = skin.mesh.surface();
    let settings = DetectorSettings::with_least(1.0);
    let radius_m = skin.settings.touch.radius_m.unwrap_or(settings.radius_m);
    let area: f64 = surface.areas_m2().iter().sum();
    let [low, high] = surface.bounds_m();
    let side_m = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
    let spread = |apart_m: f64, most: f64| (FILLED * area / apart_m.powi(2)).min(most).ceil();
    let (bells, places) = (spread(BELLS_APART * side_m, 500.0), spread(settings.spacing_m, 2000.0));
    let solve = cost.factor_flops + 2.0 * cost.factor_entries as f64 * cost.field_solves as f64;
    let sheet = 2.0 * m * n * bells + 2.0 * m * m * bells;
    let choice = TRIALS * m.powi(3) / 3.0;
    let columns = 3.0 * places;
    let dictionary = 2.0 * rows * n * columns + rows * rows * columns;
    let frame = rows * rows + 2.0 * rows * places;
    let mut stages = vec![
        Stage {
            name: "sheet as it is",
            size: format!("{bells:.0} bells, {m} voltages of the reference"),
            flops: SHEETS * (solve + sheet + choice),
            bytes: 8.0 * (n * bells + m * n),
            time_s: SHEETS
                * (solve / SWEEP_FLOPS_PER_S
                    + sheet / PRODUCT_FLOPS_PER_S
                    + choice / DECOMPOSITION_FLOPS_PER_S)
                + n * bells * BELL_S,
            why: "touches are fitted on the uneven sheet found in the reference frame, if there is one"
                .to_owned(),
        },
        Stage {
            name: "detector of touches",
            size: format!("{rows} rows, at most {places:.0} places"),
            flops: dictionary + solve,
            bytes: 8.0 * rows * 2.0 * columns,
            time_s: dictionary / PRODUCT_FLOPS_PER_S
                + electrodes::jacobian_s(skin)
                + n * places * BELL_S,
            why: format!(
                "bells of {:.0} mm, whitened for noise, electrode movement, contacts and gain",
                1e3 * radius_m
            ),
        },
        Stage {
            name: "touches of each frame",
            size: "without touches; six fingers take 20 times as long".to_owned(),
            flops: frame,
            bytes: 8.0 * rows * places,
            time_s: frame / SCAN_FLOPS_PER_S,
            why: "straight from the voltages: no image, no net".to_owned(),
        },
    ];
    scale(&mut stages, machine);
    stages
}
