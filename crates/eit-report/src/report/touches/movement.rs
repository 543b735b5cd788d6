//! The effect of electrode movement on touch estimates: the simulated fabric with a rigid rim, with
//! a compliant rim, with a sliding finger, and with all other effects.

use super::super::statistics::{quantile, rms};
use super::super::table::{Cell, Table};
use super::estimators::{Estimator, TouchEstimators};
use super::grid::Grid;
use super::simulated_disc::{RINGS, SimulatedDisc, distance_m};
use crate::error::ReportError;
use crate::simulate::FabricFrames;
use eit_fem::fabric::{
    FabricSettings, Finger, Instrument, Interpolation, Key, Membrane, Random, Rim, Tip, TouchScript,
};
use eit_inverse::touch::{Bell, Nuisance};
use eit_skin::Progress;
use ndarray::{Array2, Axis};
use std::f64::consts::{SQRT_2, TAU};

/// Number of fabrics.
pub(super) const FABRICS: usize = 4;
/// Noise of the frames.
const NOISE_DB: f64 = 60.0;
/// Force of a light touch, as in the built-in scripts, newtons, and radius of its tip, metres.
const FORCE_N: f64 = 1.5;
const TIP_M: f64 = 0.01;
/// Distance that a sliding finger moves per frame, metres.
const STEP_M: f64 = 0.005;
/// Frames per second of the script.
const RATE_HZ: f64 = 10.0;

/// A fabric and the motion of its finger.
struct FabricCase {
    name: &'static str,
    settings: FabricSettings,
    /// Whether the finger slides to its place.
    slides: bool,
}

/// The fabrics, from rigid to all effects.
fn fabrics() -> [FabricCase; FABRICS] {
    let rigid = FabricSettings::ideal();
    let moving = FabricSettings {
        membrane: Membrane::default(),
        rim: Rim::default(),
        ..FabricSettings::ideal()
    };
    let all = FabricSettings {
        instrument: Instrument { loose: Vec::new(), ..rigid.instrument.clone() },
        ..FabricSettings::default()
    };
    let case = |name, settings, slides| FabricCase { name, settings, slides };
    [
        case("nothing moves", rigid, false),
        case("rim gives way, pressed", moving.clone(), false),
        case("rim gives way, sliding", moving, true),
        case("with weave, memory, drift, sliding", all, true),
    ]
}

/// Creates the table of movement, with one row per ring, fabric and estimator.
pub(super) fn table(
    disc: &SimulatedDisc,
    grid: &Grid,
    bar: &eit_skin::Steps<'_>,
) -> Result<Table, ReportError> {
    let mut estimators = TouchEstimators::new(disc, NOISE_DB, grid.quiet_frames)?;
    let all: Vec<Vec<[f64; 2]>> =
        RINGS.iter().map(|&ring| disc.places(ring, grid.places)).collect();
    let flat: Vec<[f64; 2]> = all.iter().flatten().copied().collect();
    let mut bounds_m = vec![f64::NAN; RINGS.len()];
    let mut still_m = vec![[f64::NAN; Estimator::ALL.len()]; RINGS.len()];
    let mut rows = Vec::new();
    for (number, case) in fabrics().iter().enumerate() {
        let pressed = pressed(disc, case, &flat)?;
        let PressedFrames { values, reference } = &pressed;
        for (ring, places) in all.iter().enumerate() {
            let from = ring * grid.places;
            let frames: Vec<Vec<f64>> =
                (from..from + grid.places).map(|k| values.row(k).to_vec()).collect();
            if number == 0 {
                bounds_m[ring] = bound_m(&mut estimators, &frames, reference)?;
            }
            let trials = grid.trials.div_ceil(grid.places);
            let errors = errors_m(&mut estimators, places, &frames, reference, trials)?;
            for (k, (estimator, errors_m)) in Estimator::ALL.iter().zip(&errors).enumerate() {
                let median = quantile(errors_m, 0.5);
                if number == 0 {
                    still_m[ring][k] = median;
                }
                rows.push(vec![
                    Cell::text(RINGS[ring]),
                    Cell::text(case.name),
                    Cell::text(estimator.name()),
                    Cell::Number(1e3 * median, 2),
                    Cell::Number(1e3 * quantile(errors_m, 0.95), 2),
                    Cell::Number(1e3 * bounds_m[ring], 3),
                    Cell::Number(1.201 * median / bounds_m[ring], 1),
                    Cell::Number(median / still_m[ring][k], 1),
                ]);
            }
            bar.inc();
        }
    }
    Ok(Table {
        name: "movement",
        title: "Position error when electrodes move",
        note: format!(
            "Simulated fabric (docs/FABRIC.md), default parameters except for the effects that a \
             row omits, {FORCE_N} N with a round tip of {:.0} mm, {NOISE_DB} dB, {} trials per \
             row; sliding: {:.0} mm per frame in a random direction, dragging the fabric. Bound: \
             Cramer-Rao bound of the bell that best fits the touch when nothing moves. Factor: \
             1.201 times median over bound. Over still: ratio of the median to that when nothing \
             moves. Other conditions as above.",
            1e3 * TIP_M,
            grid.trials.div_ceil(grid.places) * grid.places,
            1e3 * STEP_M
        ),
        columns: vec![
            "ring",
            "fabric",
            "method",
            "median, mm",
            "95 %, mm",
            "bound, mm",
            "factor",
            "over still",
        ],
        rows,
    })
}

/// Frames without an instrument.
struct PressedFrames {
    /// Voltages, [position, measurement], volts.
    values: Array2<f64>,
    /// Voltages of the untouched skin, volts.
    reference: Vec<f64>,
}

/// Simulates one frame with a finger at each position, and the untouched skin.
fn pressed(
    disc: &SimulatedDisc,
    case: &FabricCase,
    places: &[[f64; 2]],
) -> Result<PressedFrames, ReportError> {
    let mut random = Random::named(29, "direction of sliding", 0);
    let finger = |k: usize, place: [f64; 2]| {
        let angle = TAU * random.uniform();
        let step = if case.slides { STEP_M } else { 0.0 };
        let before = [place[0] - step * angle.cos(), place[1] - step * angle.sin()];
        let key = |frame: usize, position_m| Key {
            time_s: frame as f64 / RATE_HZ,
            position_m,
            force_n: FORCE_N,
            radius_m: TIP_M,
        };
        let id = u32::try_from(k + 1).unwrap_or(u32::MAX);
        let keys = vec![key(2 * k + 1, before), key(2 * k + 2, place)];
        Finger { id, tip: Tip::Round, interpolation: Interpolation::Linear, keys }
    };
    let script = TouchScript {
        name: "presses".to_owned(),
        frame_rate_hz: RATE_HZ,
        frames: 2 * places.len() + 1,
        quiet_frames: 1,
        fingers: places
            .iter()
            .copied()
            .enumerate()
            .map({
                let mut finger = finger;
                move |(k, place)| finger(k, place)
            })
            .collect(),
    };
    let mut silent = Progress::silent();
    let made = FabricFrames::simulate(&disc.simulation, &case.settings, &script, &mut silent)?;
    let wanted: Vec<usize> = (0..places.len()).map(|k| 2 * k + 2).collect();
    let (values, reference) = (made.exact_v.select(Axis(0), &wanted), made.reference_v.to_vec());
    Ok(PressedFrames { values, reference })
}

/// Bound for the bells that fit noise-free frames, root mean square distance, metres.
fn bound_m(
    estimators: &mut TouchEstimators<'_>,
    frames: &[Vec<f64>],
    reference: &[f64],
) -> Result<f64, ReportError> {
    let mut bounds = Vec::new();
    for frame in frames {
        let fitted = estimators.one_bell(frame, reference)?;
        let bells: Vec<Bell> = fitted.touches.iter().map(|touch| touch.bell).collect();
        let found = estimators.fit.bound(&bells, Nuisance::AmplitudeAndRadius)?;
        bounds.extend(found.iter().map(|bound| SQRT_2 * bound.position_std_m));
    }
    Ok(rms(&bounds))
}

/// Distances of each estimator's touch from the truth, metres.
fn errors_m(
    estimators: &mut TouchEstimators<'_>,
    places: &[[f64; 2]],
    frames: &[Vec<f64>],
    reference: &[f64],
    trials: usize,
) -> Result<[Vec<f64>; 3], ReportError> {
    let mut errors: [Vec<f64>; 3] = Default::default();
    for (k, (place, clean)) in places.iter().zip(frames).enumerate() {
        let mut random = Random::named(31, "noise at a place", k as u64);
        if k == 0 {
            let frame = random.noisy(clean, estimators.noise_std_v);
            let frame = Array2::from_shape_vec((1, frame.len()), frame)
                .map_err(|e| ReportError::Failure(e.to_string()))?;
            estimators.prepare_st_tv(frame, reference)?;
        }
        for _ in 0..trials {
            let frame = random.noisy(clean, estimators.noise_std_v);
            let one_step = estimators.one_step(&frame, reference)?;
            errors[0].extend(one_step.first().map(|t| distance_m(t.position_m, *place)));
            let st_tv = estimators.st_tv(&frame, reference)?;
            errors[1].extend(st_tv.first().map(|t| distance_m(t.position_m, *place)));
            let fitted = estimators.one_bell(&frame, reference)?;
            let touch = fitted.touches.first();
            errors[2].extend(touch.map(|t| distance_m(t.bell.position_m, *place)));
        }
    }
    Ok(errors)
}
