//! Time from a frame to its list of touches.

use super::super::statistics::quantile;
use super::super::table::{Cell, Table};
use super::detectors::{OneStepDetector, difference, total_variation};
use super::grid::Grid;
use super::simulated_disc::SimulatedDisc;
use crate::error::ReportError;
use eit_fem::fabric::Random;
use eit_inverse::touch::{NoiseFloor, TouchState, TouchStream, TouchStreamSettings};
use eit_inverse::{AdaptiveReference, CausalSettings, CausalStream, ReferenceSettings};
use ndarray::Array2;
use std::f64::consts::TAU;
use std::time::Instant;

/// Noise of the frames.
const NOISE_DB: f64 = 60.0;
/// Frames per second of the clock given to the streams.
const RATE_HZ: f64 = 100.0;
/// Number of untouched frames at the start, in which reference and filters settle.
const QUIET: usize = 50;
/// Number of different frames of the moving touch, which are repeated with new noise.
const AROUND: usize = 40;

/// Measures one-step images and ST-TV, frame by frame.
pub(super) fn table(
    disc: &SimulatedDisc,
    grid: &Grid,
    bar: &eit_skin::Steps<'_>,
) -> Result<Table, ReportError> {
    let clean = circle(disc)?;
    let one_step = one_step_times(disc, &clean, grid.latency_frames)?;
    bar.inc();
    let tv = tv_times(disc, &clean, grid.latency_frames.div_ceil(8))?;
    bar.inc();
    let rows =
        [("one-step", one_step), ("st-tv, linked to the image before", tv)].map(|(name, run)| {
            let at = |part| Cell::Number(1e3 * quantile(&run.seconds, part), 3);
            vec![
                Cell::text(name),
                Cell::Number(run.seconds.len() as f64, 0),
                Cell::Number(run.touched, 2),
                at(0.5),
                at(0.95),
                at(0.99),
                at(1.0),
            ]
        });
    Ok(Table {
        name: "latency",
        title: "Time from a frame to its touches",
        note: format!(
            "One thread, from a frame in memory to the list of touches: adaptive reference, {0} x \
             {0} pixels, segmentation, tracking; milliseconds. Two touches on a circle of half the \
             radius, {1} dB, after {QUIET} quiet frames. ST-TV: certified gap of 1 %, touches \
             detected in its images (`eit live` detects them earlier, from frames). Touched: share \
             of frames with a touch in the list.",
            disc.model.raster.pixels(),
            NOISE_DB
        ),
        columns: vec!["method", "frames", "touched", "median", "95 %", "99 %", "worst"],
        rows: rows.into(),
    })
}

/// Times of a run, seconds, and the fraction of the frames with a touch.
struct Run {
    seconds: Vec<f64>,
    touched: f64,
}

/// Noise-free frames of two opposite touches that rotate.
fn circle(disc: &SimulatedDisc) -> Result<Vec<Vec<f64>>, ReportError> {
    let at = |k: usize| {
        let angle = TAU * k as f64 / AROUND as f64;
        let r = 0.5 * disc.radius_m;
        [1.0, -1.0].map(|s| [s * r * angle.cos(), s * r * angle.sin()])
    };
    (0..AROUND).map(|k| disc.voltages(&at(k))).collect()
}

/// The noise-free voltages of a frame of the run.
fn shown<'a>(disc: &'a SimulatedDisc, clean: &'a [Vec<f64>], frame: usize) -> &'a [f64] {
    if frame < QUIET { &disc.reference_v } else { &clean[frame % clean.len()] }
}

fn follow(disc: &SimulatedDisc) -> Result<AdaptiveReference, ReportError> {
    let noise = vec![disc.noise_std_v(NOISE_DB); disc.reference_v.len()];
    let settings = ReferenceSettings::default();
    Ok(AdaptiveReference::with_noise(&disc.reference_v, &noise, settings)?)
}

fn one_step_times(
    disc: &SimulatedDisc,
    clean: &[Vec<f64>],
    frames: usize,
) -> Result<Run, ReportError> {
    let noise = disc.noise_std_v(NOISE_DB);
    let OneStepDetector { reconstructor, floor } = OneStepDetector::new(disc, noise)?;
    let mut workspace = reconstructor.workspace();
    let mut image = vec![0.0; reconstructor.image_len()];
    let mut stream = tracker(disc, floor)?;
    let mut reference = follow(disc)?;
    let mut random = Random::named(3, "noise, one-step", 0);
    let (mut seconds, mut touched, mut contact) = (Vec::with_capacity(frames), 0, false);
    for k in 0..QUIET + frames {
        let frame = random.noisy(shown(disc, clean, k), noise);
        let start = Instant::now();
        reference.push(&frame, k as f64 / RATE_HZ, contact)?;
        reconstructor.reconstruct_into(
            &frame,
            reference.reference(),
            &mut workspace,
            &mut image,
        )?;
        let touches = stream.push(&image, k as f64 / RATE_HZ)?;
        contact = touches.iter().any(|touch| touch.state != TouchState::End);
        if k >= QUIET {
            seconds.push(start.elapsed().as_secs_f64());
            touched += usize::from(contact);
        }
    }
    Ok(Run { seconds, touched: touched as f64 / frames as f64 })
}

fn tv_times(disc: &SimulatedDisc, clean: &[Vec<f64>], frames: usize) -> Result<Run, ReportError> {
    let noise = disc.noise_std_v(NOISE_DB);
    let mut random = Random::named(3, "noise, total variation", 0);
    let mut few = Array2::zeros((8, disc.reference_v.len()));
    for (mut row, voltages) in few.rows_mut().into_iter().zip(clean) {
        row.iter_mut().zip(random.noisy(voltages, noise)).for_each(|(r, v)| *r = v);
    }
    let solver = total_variation(disc, few, &disc.reference_v, noise)?;
    let mut images = CausalStream::new(solver, CausalSettings::default())?;
    // the noise floor of one-step images is too high for these, so it causes no false touches
    let OneStepDetector { floor, .. } = OneStepDetector::new(disc, noise)?;
    let mut touches = tracker(disc, floor)?;
    let mut reference = follow(disc)?;
    let (mut seconds, mut touched, mut contact) = (Vec::with_capacity(frames), 0, false);
    for k in 0..QUIET + frames {
        let frame = random.noisy(shown(disc, clean, k), noise);
        let start = Instant::now();
        reference.push(&frame, k as f64 / RATE_HZ, contact)?;
        let values = difference(disc, &frame, reference.reference());
        let row = values.as_slice().unwrap_or_default();
        let image = images.push(row, None)?.image;
        let found = touches.push(image, k as f64 / RATE_HZ)?;
        contact = found.iter().any(|touch| touch.state != TouchState::End);
        if k >= QUIET {
            seconds.push(start.elapsed().as_secs_f64());
            touched += usize::from(contact);
        }
    }
    Ok(Run { seconds, touched: touched as f64 / frames as f64 })
}

fn tracker(disc: &SimulatedDisc, floor: NoiseFloor) -> Result<TouchStream, ReportError> {
    let settings = TouchStreamSettings { frame_rate_hz: RATE_HZ, ..Default::default() };
    Ok(TouchStream::new(disc.cells.clone(), floor, settings)?)
}
