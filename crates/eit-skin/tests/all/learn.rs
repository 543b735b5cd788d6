//! Position and force learnt from presses on the simulated fabric, and their file.
#![cfg(feature = "learn")]
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "tests"
)]

use crate::common::Recording;
use crate::common::score::quantile_of;
use crate::common::script::{QUIET_FRAMES, RATE_HZ, distance_m};
use eit_skin::FittedFrames;
use eit_skin::Progress;
use eit_skin::eit_fem::fabric::{Finger, Key, Random, Tip, TouchScript};
use eit_skin::learn::{Frame, LearnedSkin, Press, PressFrames, PressTable};
use eit_skin::touches::{Touches, touches};
use std::sync::Arc;

/// Number of presses of each script that are learnt.
const LEARNT: usize = 12;
const TESTED: usize = 28;
/// Presses reach to 0.85 of the radius.
const WITHIN_M: f64 = 0.085;
const TIP_M: f64 = 0.01;
const FIRST_FRAME: usize = 42;
/// Frames from one press to the next; its force rises in 4, stays for 14 and falls in 4.
const EACH: usize = 32;

/// Presses of 0.2 to 3 N anywhere within 0.85 of the radius; the learnt places are spread as a person would:
/// four near the middle, eight toward the rim.
struct Presses {
    script: TouchScript,
    places_m: Vec<[f64; 2]>,
    forces_n: Vec<f64>,
}

impl Presses {
    fn new(seed: u64) -> Self {
        let mut random = Random::named(seed, "presses", 0);
        let (mut places_m, mut forces_n, mut keys) = (Vec::new(), Vec::new(), Vec::new());
        for k in 0..LEARNT + TESTED {
            let place = if k < LEARNT { spread(k) } else { anywhere(&mut random) };
            // learnt forces cover the range
            let force = if k < LEARNT {
                0.2 * 15.0_f64.powf((5 * k % LEARNT) as f64 / (LEARNT - 1) as f64)
            } else {
                random.log_between(0.2, 3.0)
            };
            let begin = (FIRST_FRAME + k * EACH) as f64 / RATE_HZ;
            for (after, part) in [(0.0, 0.0), (0.2, 1.0), (0.9, 1.0), (1.1, 0.0)] {
                keys.push(Key {
                    time_s: begin + after,
                    position_m: place,
                    force_n: part * force,
                    radius_m: TIP_M,
                });
            }
            places_m.push(place);
            forces_n.push(force);
        }
        let finger = Finger { id: 1, tip: Tip::Round, interpolation: Default::default(), keys };
        let script = TouchScript {
            name: String::new(),
            frame_rate_hz: RATE_HZ,
            frames: FIRST_FRAME + (LEARNT + TESTED) * EACH + 10,
            quiet_frames: QUIET_FRAMES,
            fingers: vec![finger],
        };
        Self { script, places_m, forces_n }
    }

    /// The table of some presses: the last frames of each, and those before it.
    fn table(&self, range: std::ops::Range<usize>) -> PressTable {
        let press = |k: usize| Press {
            x_m: self.places_m[k][0],
            y_m: self.places_m[k][1],
            z_m: None,
            force_n: Some(self.forces_n[k]),
            depth_m: None,
            first_frame: Some(held(k).start),
            last_frame: Some(held(k).end - 1),
            before_first: Some(FIRST_FRAME + k * EACH - 4),
            before_last: Some(FIRST_FRAME + k * EACH - 1),
        };
        PressTable::new(range.map(press).collect(), "table").unwrap()
    }
}

/// Frames in which a press is steady.
fn held(press: usize) -> std::ops::Range<usize> {
    let begin = FIRST_FRAME + press * EACH;
    begin + 11..begin + 17
}

fn spread(k: usize) -> [f64; 2] {
    let (radius, turn) = match k {
        0..4 => (0.3 * 0.1, (k as f64 + 0.5) / 4.0),
        _ => (0.75 * 0.1, (k as f64 - 4.0) / 8.0),
    };
    let (sin, cos) = (turn * std::f64::consts::TAU).sin_cos();
    [radius * cos, radius * sin]
}

fn anywhere(random: &mut Random) -> [f64; 2] {
    loop {
        let place = [0; 2].map(|_| random.between(-WITHIN_M, WITHIN_M));
        if place[0].hypot(place[1]) <= WITHIN_M {
            return place;
        }
    }
}

/// Touches with what was learnt applied, as for a scene that names the file.
fn with_file(fitted: &FittedFrames, file: &std::path::Path) -> Touches {
    let mut fitted = fitted.clone();
    let mut linearised = (*fitted.skin).clone();
    linearised.skin.settings.touch.learned = Some(file.to_path_buf());
    fitted.skin = Arc::new(linearised);
    touches(&fitted, &mut Progress::silent()).unwrap().unwrap()
}

/// Errors in the steady frames of tested presses: of positions, metres, and of forces, relative; and frames
/// without a touch.
fn errors(presses: &Presses, touches: &Touches) -> (Vec<f64>, Vec<f64>, usize) {
    let (mut places, mut forces, mut missed) = (Vec::new(), Vec::new(), 0);
    for k in LEARNT..LEARNT + TESTED {
        for frame in held(k) {
            let here = touches.rows.iter().filter(|row| row.frame == frame);
            let strongest = here.max_by(|a, b| {
                a.touch.intensity_s_m2.abs().total_cmp(&b.touch.intensity_s_m2.abs())
            });
            let Some(row) = strongest else {
                missed += 1;
                continue;
            };
            let [x, y, _] = row.touch.position_m;
            places.push(distance_m([x, y], presses.places_m[k]));
            if let Some(force_n) = row.touch.force_n() {
                forces.push((force_n / presses.forces_n[k] - 1.0).abs());
            }
        }
    }
    (places, forces, missed)
}

/// The file is identical except for the last digit of numbers, which JSON may lose.
fn assert_same(read: &LearnedSkin, written: &LearnedSkin) {
    assert_eq!(read.channels, written.channels);
    assert_eq!(
        (&read.fingerprint, read.measurements, read.places_by, read.presses.places_m.len()),
        (&written.fingerprint, written.measurements, written.places_by, LEARNT)
    );
    let (read, written) = (&read.presses.frames, &written.presses.frames);
    assert_eq!(read.dim(), written.dim());
    assert!(read.iter().zip(written).all(|(a, b)| (a - b).abs() <= 1e-15 * b.abs()));
}

#[test]
fn twelve_presses_give_newtons() {
    let folder = tempfile::tempdir().unwrap();
    for seed in 1..=3 {
        let presses = Presses::new(seed);
        let recording = Recording::simulate(&presses.script, seed);
        let fitted = recording.fitted();
        let table = presses.table(0..LEARNT);
        let pressed = PressFrames::new(&table, &fitted.frames).unwrap();
        let learned =
            LearnedSkin::learn(&fitted, &pressed, Frame::Scene, None, &mut Progress::silent())
                .unwrap()
                .skin;
        let file = folder.path().join(format!("{seed}.learned"));
        std::fs::write(&file, learned.to_bytes().unwrap()).unwrap();
        assert_same(&LearnedSkin::read(&file).unwrap(), &learned);
        let (untrained, none, _) = errors(&presses, &recording.touches());
        assert!(none.is_empty());
        let (places, forces, missed) = errors(&presses, &with_file(&fitted, &file));
        let force = learned.force.as_ref().unwrap();
        println!(
            "seed {seed}: places by {:?}, {:?}; leave-one-out {:.3}, {:?}\n  places untrained {:.2} mm, learnt {:.2} mm; \
             force median {:.3}, 90 % {:.3}, 95 % {:.3}, most {:.3} of {} frames, {missed} missed",
            learned.places_by,
            learned.held_out,
            force.error_ln,
            force.coefficients,
            1e3 * quantile_of(&untrained, 0.5),
            1e3 * quantile_of(&places, 0.5),
            quantile_of(&forces, 0.5),
            quantile_of(&forces, 0.9),
            quantile_of(&forces, 0.95),
            quantile_of(&forces, 1.0),
            forces.len(),
        );
        // measured: 0.024 to 0.030 (median), 0.075 to 0.078 (90 % quantile), positions as without learning
        assert!(quantile_of(&forces, 0.5) < 0.05, "seed {seed}");
        assert!(quantile_of(&forces, 0.9) < 0.1, "seed {seed}");
        let [before, after] = [&untrained, &places].map(|of| quantile_of(of, 0.5));
        assert!(after <= 1.1 * before, "seed {seed}: {after} m learnt, {before} m untrained");
    }
}
