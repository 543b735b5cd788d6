//! Tracking one to four fingers on the simulated fabric: fingers found, false touches, changes of
//! id.

use super::super::statistics::quantile;
use super::super::table::{Cell, Table};
use super::detectors::{OneStepDetector, difference, total_variation};
use super::grid::Grid;
use super::noise_levels::at_each;
use super::simulated_disc::SimulatedDisc;
use super::tracking_scores::{FULL_N, PresentFinger, TrackingScores, WITHIN_M};
use crate::error::ReportError;
use crate::simulate::FabricFrames;
use eit_fem::fabric::{FabricSettings, Finger, Interpolation, Key, Random, Tip, TouchScript};
use eit_inverse::touch::{TouchState, TouchStream, TouchStreamSettings};
use eit_inverse::{AdaptiveReference, CausalSettings, CausalStream, ReferenceSettings};
use eit_skin::Progress;
use ndarray::{Array2, Axis};
use std::f64::consts::TAU;

/// Maximum number of simultaneous fingers.
pub(super) const MOST: usize = 4;
/// Frames per second, and number of quiet frames at the start.
const RATE_HZ: f64 = 10.0;
const QUIET: usize = 20;

/// The images in which touches are tracked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ImageStream {
    OneStep,
    StTv,
}

impl ImageStream {
    const ALL: [Self; 2] = [Self::OneStep, Self::StTv];

    fn name(self) -> &'static str {
        match self {
            Self::OneStep => "one-step",
            Self::StTv => "st-tv stream",
        }
    }
}

/// A recording of several fingers.
struct Recording {
    fingers: usize,
    /// Frames without noise.
    frames: FabricFrames,
    /// True fingers, `[frame]`.
    present: Vec<Vec<PresentFinger>>,
}

/// Creates the table, with one row per number of fingers, noise level and stream.
pub(super) fn table(
    disc: &SimulatedDisc,
    grid: &Grid,
    bar: &eit_skin::Steps<'_>,
) -> Result<Table, ReportError> {
    let settings =
        FabricSettings { instrument: FabricSettings::ideal().instrument, ..Default::default() };
    let (mut recordings, mut silent) = (Vec::new(), Progress::silent());
    for fingers in 1..=MOST {
        let script = script(disc, fingers, grid.track_frames);
        let frames = FabricFrames::simulate(&disc.simulation, &settings, &script, &mut silent)?;
        let present = (0..script.frames).map(|frame| present(&script, frame)).collect();
        recordings.push(Recording { fingers, frames, present });
        bar.inc();
    }
    let rows = at_each(grid.noise_db, |noise_db| {
        let mut rows = Vec::new();
        for recording in &recordings {
            for stream in ImageStream::ALL {
                let scores = follow(disc, recording, stream, disc.noise_std_v(noise_db))?;
                rows.push(row(recording.fingers, noise_db, stream, &scores));
            }
            bar.inc();
        }
        Ok(rows)
    })?;
    Ok(Table {
        name: "tracks",
        title: "Fingers that move and tap, followed over time",
        note: format!(
            "Simulated fabric with all its defaults (weave, memory, drift, friction, electrodes \
             that move) except the instrument; {} frames at {RATE_HZ} Hz, the first {QUIET} quiet; \
             each finger stays in its sector, presses with 1 to 2 N, slides at up to 60 mm/s, \
             lifts and returns elsewhere (seeded). Adaptive reference learnt from the quiet \
             frames, then `TouchStream` with its defaults. Found: fraction of the fingers with at \
             least {FULL_N} N that have their own touch within {:.0} mm; false: touches per frame \
             that are near no finger; switches: number of times that a finger's touch has a \
             different id than before (expected after a lift). ST-TV: each frame linked to the \
             previous image, above the one-step noise floor.",
            grid.track_frames,
            1e3 * WITHIN_M
        ),
        columns: vec![
            "fingers",
            "noise, dB",
            "method",
            "found",
            "median error, mm",
            "95 %, mm",
            "false a frame",
            "id switches",
        ],
        rows,
    })
}

fn row(fingers: usize, noise_db: f64, stream: ImageStream, scores: &TrackingScores) -> Vec<Cell> {
    vec![
        Cell::text(fingers),
        Cell::text(noise_db),
        Cell::text(stream.name()),
        Cell::Number(scores.found as f64 / scores.fingers as f64, 3),
        Cell::Number(1e3 * quantile(&scores.errors_m, 0.5), 1),
        Cell::Number(1e3 * quantile(&scores.errors_m, 0.95), 1),
        Cell::Number(scores.false_touches as f64 / scores.frames as f64, 3),
        Cell::Number(scores.switches as f64, 0),
    ]
}

/// A script of fingers in separate sectors, between 0.35 and 0.75 of the radius, that press, slide
/// and lift.
fn script(disc: &SimulatedDisc, fingers: usize, frames: usize) -> TouchScript {
    let end_s = frames as f64 / RATE_HZ;
    let finger = |k: usize| {
        let mut random = Random::named(43, "fingers", (10 * fingers + k) as u64);
        let middle = TAU * k as f64 / fingers as f64;
        let half = (0.25 * TAU / fingers as f64).min(0.6);
        let mut now_s = QUIET as f64 / RATE_HZ + 0.5 + k as f64 * 0.4;
        let mut keys = Vec::new();
        while now_s + 4.0 < end_s {
            let mut place = || {
                let r = disc.radius_m * (0.35 + 0.4 * random.uniform());
                let angle = middle + half * (2.0 * random.uniform() - 1.0);
                [r * angle.cos(), r * angle.sin()]
            };
            let [from, to] = [place(), place()];
            let way = (to[0] - from[0]).hypot(to[1] - from[1]);
            let slide_s = (way / 0.06).max(1.0);
            let force_n = 1.0 + random.uniform();
            let mut key = |after_s: f64, position_m, force_n| {
                let time_s = now_s + after_s;
                keys.push(Key { time_s, position_m, force_n, radius_m: 0.01 });
            };
            key(0.0, from, 0.0);
            key(0.3, from, force_n);
            key(0.3 + slide_s, to, force_n);
            key(0.6 + slide_s, to, 0.0);
            now_s += 0.6 + slide_s + 1.0 + random.uniform();
        }
        let id = u32::try_from(k + 1).unwrap_or(u32::MAX);
        Finger { id, tip: Tip::Round, interpolation: Interpolation::Linear, keys }
    };
    TouchScript {
        name: format!("{fingers} fingers"),
        frame_rate_hz: RATE_HZ,
        frames,
        quiet_frames: QUIET,
        fingers: (0..fingers).map(finger).collect(),
    }
}

fn present(script: &TouchScript, frame: usize) -> Vec<PresentFinger> {
    let touches = script.touches(frame);
    touches
        .iter()
        .map(|t| PresentFinger {
            finger: t.finger,
            position_m: t.position_m,
            is_full: t.force_n >= FULL_N,
        })
        .collect()
}

/// Adds noise to a recording, with a seed that depends on its number of fingers.
fn noisy(recording: &Recording, noise_std_v: f64) -> Array2<f64> {
    let mut random = Random::named(41, "noise", recording.fingers as u64);
    let mut noisy = recording.frames.exact_v.clone();
    noisy.iter_mut().for_each(|v| *v += noise_std_v * random.normal());
    noisy
}

/// Tracks the fingers of a recording with noise.
fn follow(
    disc: &SimulatedDisc,
    recording: &Recording,
    stream: ImageStream,
    noise_std_v: f64,
) -> Result<TrackingScores, ReportError> {
    let frames = noisy(recording, noise_std_v);
    let OneStepDetector { reconstructor, floor } = OneStepDetector::new(disc, noise_std_v)?;
    let settings = TouchStreamSettings { frame_rate_hz: RATE_HZ, ..Default::default() };
    let mut tracker = TouchStream::new(disc.cells.clone(), floor, settings)?;
    let quiet = frames.slice_axis(Axis(0), ndarray::Slice::from(..QUIET));
    let mut reference = AdaptiveReference::of_quiet_frames(quiet, ReferenceSettings::default())?;
    let mut st_tv = match stream {
        ImageStream::OneStep => None,
        ImageStream::StTv => {
            // the weights are chosen on frames of the first touches
            let few: Vec<usize> = (QUIET + 10..QUIET + 18).collect();
            let few = frames.select(Axis(0), &few);
            let untouched = recording.frames.reference_v.as_slice().unwrap_or_default();
            let solver = total_variation(disc, few, untouched, noise_std_v)?;
            Some(CausalStream::new(solver, CausalSettings::default())?)
        }
    };
    let mut workspace = reconstructor.workspace();
    let mut image = vec![0.0; reconstructor.image_len()];
    let mut scores = TrackingScores::of_fingers(MOST);
    let mut contact = false;
    for (k, frame) in frames.rows().into_iter().enumerate() {
        let (frame, time_s) = (frame.to_vec(), k as f64 / RATE_HZ);
        reference.push(&frame, time_s, contact)?;
        let shown = match &mut st_tv {
            None => {
                let memory = &mut workspace;
                reconstructor.reconstruct_into(
                    &frame,
                    reference.reference(),
                    memory,
                    &mut image,
                )?;
                image.as_slice()
            }
            Some(st_tv) => {
                let values = difference(disc, &frame, reference.reference());
                st_tv.push(values.as_slice().unwrap_or_default(), None)?.image
            }
        };
        let touches = tracker.push(shown, time_s)?;
        contact = touches.iter().any(|touch| touch.state != TouchState::End);
        if k >= QUIET {
            scores.add(&recording.present[k], touches);
        }
    }
    Ok(scores)
}
