//! One to four fingers that move on the simulated fabric: found, false, confused.

use super::eyes::{difference, one_step, total_variation};
use super::lab::{Lab, Random};
use super::movement::simulate;
use super::position::distance_m;
use super::table::{Cell, Table, quantile};
use super::{Grid, at_each};
use crate::error::ReportError;
use eit_fem::fabric::{FabricSettings, Finger, Interpolation, Key, Tip, TouchScript};
use eit_inverse::touch::{Touch, TouchState, TouchStream, TouchStreamSettings};
use eit_inverse::{AdaptiveReference, ReferenceSettings, StTvStream, StreamSettings};
use ndarray::{Array2, Axis};
use std::f64::consts::TAU;

/// Most fingers at once.
pub(super) const MOST: usize = 4;
/// Frames a second and quiet ones at the start.
const RATE_HZ: f64 = 10.0;
const QUIET: usize = 20;
/// A finger weaker than this is on its way: neither to be found nor false, newton.
const FULL_N: f64 = 0.7;
/// A touch farther than this from every finger is false, metres.
const WITHIN_M: f64 = 0.025;
/// Names of the methods.
const STREAMS: [&str; 2] = ["one-step", "st-tv stream"];

/// True places of a frame: finger and place; and whether it is fully there.
pub(super) type Present = Vec<(u32, [f64; 2], bool)>;

/// What a stream did over a recording.
#[derive(Debug, Clone, Default)]
pub(super) struct Tally {
    pub fingers: usize,
    pub found: usize,
    pub errors_m: Vec<f64>,
    pub frames: usize,
    pub false_touches: usize,
    switches: usize,
    /// Name that each finger had last.
    names: Vec<Option<u64>>,
}

/// The table: one row for each number of fingers, noise and method.
pub(super) fn table(
    lab: &Lab,
    grid: &Grid,
    bar: &eit_skin::Steps<'_>,
) -> Result<Table, ReportError> {
    let settings =
        FabricSettings { instrument: FabricSettings::ideal().instrument, ..Default::default() };
    let mut recordings = Vec::new();
    for fingers in 1..=MOST {
        let script = script(lab, fingers, grid.track_frames);
        let (frames, reference) = simulate(lab, &settings, &script)?;
        let present: Vec<Present> = (0..script.frames).map(|f| present(&script, f)).collect();
        recordings.push((fingers, frames, reference, present));
        bar.inc();
    }
    let rows = at_each(grid.noise_db, |noise_db| {
        let mut rows = Vec::new();
        for (fingers, frames, reference, present) in &recordings {
            let noise = lab.noise_std_v(noise_db);
            let mut random = Random::new(41, *fingers as u64);
            let mut noisy = frames.clone();
            noisy.iter_mut().for_each(|v| *v += noise * random.normal());
            for method in 0..STREAMS.len() {
                let tally = follow(lab, (&noisy, reference), (method, noise), present)?;
                rows.push(row(*fingers, noise_db, method, &tally));
            }
            bar.inc();
        }
        Ok(rows)
    })?;
    Ok(Table {
        name: "tracks",
        title: "Fingers that move and tap, followed over time",
        note: format!(
            "Simulated fabric with all its defaults (weave, memory, drift, friction, electrodes that \
             move) but the instrument; {} frames at {RATE_HZ} Hz, {QUIET} of them quiet first; each \
             finger keeps to a sector, presses with 1 to 2 N, slides at up to 60 mm/s, lifts and \
             comes back elsewhere (seeded). Adaptive reference learnt from the quiet frames, then \
             `TouchStream` with its defaults. Found: part of the fingers of at least {FULL_N} N that \
             have a touch of their own within {:.0} mm; false: touches a frame near no finger; \
             switches: how often a finger's touch has another name than before (after a lift it \
             must have). ST-TV: window 8, lag 3, judged against the frame that its image is of, \
             above the one-step noise floor.",
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

fn row(fingers: usize, noise_db: f64, method: usize, tally: &Tally) -> Vec<Cell> {
    vec![
        Cell::text(fingers),
        Cell::text(noise_db),
        Cell::text(STREAMS[method]),
        Cell::Number(tally.found as f64 / tally.fingers as f64, 3),
        Cell::Number(1e3 * quantile(&tally.errors_m, 0.5), 1),
        Cell::Number(1e3 * quantile(&tally.errors_m, 0.95), 1),
        Cell::Number(tally.false_touches as f64 / tally.frames as f64, 3),
        Cell::Number(tally.switches as f64, 0),
    ]
}

/// Fingers in sectors of their own, between 0.35 and 0.75 of the radius, that press, slide and lift.
fn script(lab: &Lab, fingers: usize, frames: usize) -> TouchScript {
    let end_s = frames as f64 / RATE_HZ;
    let finger = |k: usize| {
        let mut random = Random::new(43, (10 * fingers + k) as u64);
        let middle = TAU * k as f64 / fingers as f64;
        let half = (0.25 * TAU / fingers as f64).min(0.6);
        let mut now_s = QUIET as f64 / RATE_HZ + 0.5 + k as f64 * 0.4;
        let mut keys = Vec::new();
        while now_s + 4.0 < end_s {
            let mut place = || {
                let r = lab.radius_m * (0.35 + 0.4 * random.uniform());
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

fn present(script: &TouchScript, frame: usize) -> Present {
    let touches = script.touches(frame);
    touches.iter().map(|t| (t.finger, t.position_m, t.force_n >= FULL_N)).collect()
}

/// Runs a recording through a method.
fn follow(
    lab: &Lab,
    (frames, untouched): (&Array2<f64>, &[f64]),
    (method, noise_std_v): (usize, f64),
    present: &[Present],
) -> Result<Tally, ReportError> {
    let (reconstructor, floor) = one_step(lab, noise_std_v)?;
    let settings = TouchStreamSettings { frame_rate_hz: RATE_HZ, ..Default::default() };
    let mut stream = TouchStream::new(lab.cells.clone(), floor, settings)?;
    let quiet = frames.slice_axis(Axis(0), ndarray::Slice::from(..QUIET));
    let mut reference = AdaptiveReference::of_quiet_frames(quiet, ReferenceSettings::default())?;
    let how = StreamSettings::default();
    let mut tv = match method {
        0 => None,
        _ => {
            // frames of the first touches choose the weights
            let few: Vec<usize> = (QUIET + 10..QUIET + 18).collect();
            let few = frames.select(Axis(0), &few);
            let solver = total_variation(lab, few, untouched, noise_std_v)?;
            Some(StTvStream::new(solver, how)?)
        }
    };
    let mut workspace = reconstructor.workspace();
    let mut image = vec![0.0; reconstructor.image_len()];
    let mut tally = Tally { names: vec![None; MOST + 1], ..Default::default() };
    let mut contact = false;
    for (k, frame) in frames.rows().into_iter().enumerate() {
        let (frame, time_s) = (frame.to_vec(), k as f64 / RATE_HZ);
        reference.push(&frame, time_s, contact)?;
        let shown = match &mut tv {
            None => {
                let memory = &mut workspace;
                reconstructor.reconstruct_into(
                    &frame,
                    reference.reference(),
                    memory,
                    &mut image,
                )?;
                Some((image.as_slice(), k))
            }
            Some(tv) => {
                let values = difference(lab, &frame, reference.reference());
                let step = tv.push(values.as_slice().unwrap_or_default(), None)?;
                step.image.map(|image| (image, k.saturating_sub(how.lag)))
            }
        };
        let Some((image, of)) = shown else { continue };
        let touches = stream.push(image, time_s)?;
        contact = touches.iter().any(|touch| touch.state != TouchState::End);
        if of >= QUIET {
            tally.add(&present[of], touches);
        }
    }
    Ok(tally)
}

impl Tally {
    /// Pairs touches and fingers, the nearest first, and counts.
    pub fn add(&mut self, present: &Present, touches: &[Touch]) {
        let alive: Vec<&Touch> =
            touches.iter().filter(|t| t.state != TouchState::End && t.valid).collect();
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        for (f, (_, place, _)) in present.iter().enumerate() {
            let near = |(t, touch): (usize, &&Touch)| (distance_m(touch.position_m, *place), f, t);
            pairs.extend(alive.iter().enumerate().map(near).filter(|pair| pair.0 <= WITHIN_M));
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut finger_of = vec![None; alive.len()];
        let mut touch_of = vec![None; present.len()];
        for (error_m, f, t) in pairs {
            if finger_of[t].is_none() && touch_of[f].is_none() {
                (finger_of[t], touch_of[f]) = (Some(f), Some((t, error_m)));
            }
        }
        self.frames += 1;
        // a finger on its way may be seen, a second touch on a finger is false
        self.false_touches += finger_of.iter().filter(|finger| finger.is_none()).count();
        for (slot, name) in self.names.iter_mut().enumerate() {
            // lifted: its next touch has a new name
            if !present.iter().any(|(finger, ..)| *finger as usize == slot) {
                *name = None;
            }
        }
        for ((finger, _, full), touch) in present.iter().zip(touch_of) {
            self.fingers += usize::from(*full);
            let Some((t, error_m)) = touch else { continue };
            if *full {
                self.found += 1;
                self.errors_m.push(error_m);
            }
            if let Some(name) = self.names.get_mut(*finger as usize) {
                self.switches += usize::from(name.is_some_and(|old| old != alive[t].id));
                *name = Some(alive[t].id);
            }
        }
    }
}
