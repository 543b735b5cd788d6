//! GREIT figures of merit across the disc, for every method.

use super::super::scores::{Scores, Truth};
use super::super::solver::{METHODS, Solver};
use super::super::table::{Cell, Table};
use super::grid::Grid;
use super::simulated_disc::{FORCE_N, RADIUS_M, RESPONSE, SIMULATION_NODES, SimulatedDisc};
use crate::error::ReportError;
use crate::simulate::TouchSequence;
use eit_fem::fabric::{Finger, Interpolation, Key, Tip, TouchScript};
use eit_inverse::{DifferenceFrames, Stop};
use eit_skin::Progress;
use eit_skin::scene::Rule;

/// Number of methods compared: all except the absolute one, which takes too long.
pub(super) const COMPARED: usize = METHODS.len() - 1;
/// Noise of the frames.
const NOISE_DB: f64 = 60.0;
/// Number of frames of the held touch.
const FRAMES: usize = 6;
/// Frames per second.
const RATE_HZ: f64 = 10.0;
/// Angle of the touches: between two electrodes, off the axes of symmetry.
const ANGLE: f64 = 0.13;
/// As in `report --quality`.
const TARGET_GAP: f64 = 1e-2;

/// Creates the table, with one row per radius and method.
pub(super) fn table(
    disc: &SimulatedDisc,
    grid: &Grid,
    bar: &eit_skin::Steps<'_>,
) -> Result<Table, ReportError> {
    let model = &disc.model;
    let mut rows = Vec::new();
    for &part in grid.greit_radii {
        let r = part * disc.radius_m;
        let place = [r * f64::cos(ANGLE), r * f64::sin(ANGLE)];
        let sequence = held(place);
        let mut silent = Progress::silent();
        let voltages = sequence.voltages(&disc.simulation, &mut silent)?;
        let pixels =
            model.pixels_of(sequence.truth(disc.conductivity_s(), &model.raster).view())?;
        let truth = Truth { pixels: &pixels, positions_m: &sequence.positions_m() };
        let noise_std_v = voltages.noise_std_v(NOISE_DB);
        let frames = voltages.with_noise(noise_std_v, 1)?;
        let values = frames.differences(model.difference_kind());
        let differences = DifferenceFrames::all_good(values.view());
        for method in &METHODS[..COMPARED] {
            let settings = method.settings(model, Rule::NoiseFigure);
            let fitted = model.fit(&frames, noise_std_v, settings);
            let mut solver = Solver::new(model, &fitted, method.method)?;
            let stop = Stop { target_gap: TARGET_GAP, ..Default::default() };
            let found = solver.run(&differences, &stop)?;
            let scores = Scores::new(model, found.pixels.view(), &truth)?;
            bar.inc();
            let Some(greit) = scores.greit else { continue };
            rows.push(vec![
                Cell::text(part),
                Cell::text(method.name()),
                Cell::Number(greit.amplitude_response, 2),
                Cell::Number(1e3 * greit.position_error_m, 2),
                Cell::Number(greit.resolution, 3),
                Cell::Number(greit.shape_deformation, 2),
                Cell::Number(greit.ringing, 2),
            ]);
        }
    }
    Ok(Table {
        name: "greit",
        title: "GREIT figures of merit across the disc",
        note: format!(
            "A bell of 10 mm and 30 % held for {FRAMES} frames at each radius (relative to the \
             skin's), {NOISE_DB} dB on frames and reference, data from about {SIMULATION_NODES} \
             nodes; means over the frames. Hyperparameter by noise figure 1, weights of total \
             variation by the rule of `eit reconstruct`. AR: amplitude response (1 best); PE: \
             absolute position error along the radius, mm; RES: resolution; SD: shape deformation; \
             RNG: ringing (0 best). The truth's own RES is {:.3}.",
            truth_resolution(disc)
        ),
        columns: vec!["radius", "method", "AR", "PE, mm", "RES", "SD", "RNG"],
        rows,
    })
}

/// A touch held at a position.
fn held(position_m: [f64; 2]) -> TouchSequence {
    let key = |frame: usize| Key {
        time_s: frame as f64 / RATE_HZ,
        position_m,
        force_n: FORCE_N,
        radius_m: RADIUS_M,
    };
    let keys = vec![key(0), key(FRAMES - 1)];
    let finger = Finger { id: 1, tip: Tip::Round, interpolation: Interpolation::Linear, keys };
    let script = TouchScript {
        name: "held".to_owned(),
        frame_rate_hz: RATE_HZ,
        frames: FRAMES,
        quiet_frames: 0,
        fingers: vec![finger],
    };
    TouchSequence { script, response: RESPONSE }
}

/// Resolution of the true bell, which is above a quarter of its peak within `sigma sqrt(2 ln 4)`.
fn truth_resolution(disc: &SimulatedDisc) -> f64 {
    RADIUS_M * (2.0 * 4.0_f64.ln()).sqrt() / disc.radius_m
}
