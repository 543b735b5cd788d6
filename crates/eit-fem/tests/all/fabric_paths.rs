//! Random paths stay inside and apart, keep their speed, and are determined by the seed.

use crate::common::skins::disc;
use crate::common::{RADIUS_M, refused};
use eit_fem::fabric::{PlayCircle, RandomPaths, Tip, TouchScript};
use eit_mesh::Outline;

/// Steps of a slow and a fast finger, metres.
const STEPS_M: [f64; 2] = [0.002, 0.012];

fn circle() -> PlayCircle {
    PlayCircle::of_outline(&Outline::disc(RADIUS_M).unwrap()).unwrap()
}

fn paths() -> RandomPaths {
    RandomPaths {
        fingers: 1,
        frames: 12,
        frame_rate_hz: 8.0,
        step_m: 0.002,
        apart_m: 0.048,
        tip: Tip::Round,
        radius_m: 0.012,
        force_n: 1.0,
        seed: 1,
    }
}

/// Positions, metres, `[frame][finger]`.
fn positions_m(script: &TouchScript) -> Vec<Vec<[f64; 2]>> {
    let of = |frame| script.touches(frame).iter().map(|touch| touch.position_m).collect();
    (0..script.frames).map(of).collect()
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[test]
fn fingers_stay_inside_and_apart_and_keep_their_speed() {
    for fingers in 1..=4 {
        for seed in 0..50 {
            for step_m in STEPS_M {
                let paths = RandomPaths { fingers, seed, step_m, frames: 60, ..paths() };
                let positions_m = positions_m(&paths.script(&circle()).unwrap());
                assert_eq!(positions_m.len(), 60);
                for places in &positions_m {
                    assert_eq!(places.len(), fingers);
                    for (k, &place) in places.iter().enumerate() {
                        // the bounds hold exactly, up to rounding
                        assert!(distance(place, [0.0; 2]) <= 0.08 + 1e-15);
                        let others = &places[..k];
                        assert!(others.iter().all(|&o| distance(place, o) >= 0.048 - 1e-15));
                    }
                }
                for pair in positions_m.windows(2) {
                    for (&a, &b) in pair[0].iter().zip(&pair[1]) {
                        // a chord is no longer than its arc, whose ends are known to 2.3e-7 m
                        // (|p''| du^2 / 8); at the sharpest bends it is 0.54 of the arc (measured)
                        let chord = distance(a, b);
                        assert!(chord <= step_m + 5e-7, "{chord}");
                        assert!(chord >= 0.5 * step_m, "{fingers} {seed} {chord}");
                    }
                }
            }
        }
    }
}

#[test]
fn steps_are_measured_along_the_path() {
    for seed in 0..10 {
        let paths = RandomPaths { seed, step_m: 1e-4, frames: 4001, ..paths() };
        let positions_m = positions_m(&paths.script(&circle()).unwrap());
        let way: f64 = positions_m.windows(2).map(|pair| distance(pair[0][0], pair[1][0])).sum();
        // chords of 1e-4 m on bends of radius 10 mm are too short by 4e-6, the path's table by less
        assert!((way / 0.4 - 1.0).abs() < 1e-5, "{way}");
    }
}

#[test]
fn the_seed_decides_and_more_frames_go_on() {
    let places = |seed, frames| {
        positions_m(&RandomPaths { seed, frames, fingers: 3, ..paths() }.script(&circle()).unwrap())
    };
    assert_eq!(places(1, 12)[..], places(1, 40)[..12]);
    assert_ne!(places(1, 12), places(2, 12));
}

/// On a rectangle, fingers stay around the centre, within 0.8 of half its shorter side.
#[test]
fn other_outlines_have_paths_too() {
    let circle = PlayCircle::of_outline(&Outline::rectangle(0.3, 0.2).unwrap()).unwrap();
    let script = RandomPaths { fingers: 4, ..paths() }.script(&circle).unwrap();
    for place in positions_m(&script).into_iter().flatten() {
        assert!(distance(place, [0.0; 2]) <= 0.08 + 1e-15, "{place:?}");
    }
}

#[test]
fn paths_that_cannot_be_are_refused() {
    let refused = |paths: RandomPaths, words: &str| refused(paths.script(&circle()), words);
    for fingers in [0, 5] {
        let words = format!("fingers is {fingers}: it must be from 1 to 4");
        refused(RandomPaths { fingers, ..paths() }, &words);
    }
    for frames in [0, usize::MAX] {
        refused(RandomPaths { frames, ..paths() }, "frames is");
    }
    for step_m in [-1e-3, 0.09, f64::NAN, f64::INFINITY] {
        refused(RandomPaths { step_m, ..paths() }, "step_m is");
    }
    for apart_m in [-1.0, f64::NAN, f64::INFINITY] {
        refused(RandomPaths { apart_m, ..paths() }, "apart_m is");
    }
    refused(RandomPaths { fingers: 2, apart_m: 0.164, ..paths() }, "cannot stay 0.164 m apart");
    // force, radius and rate are validated as for any script
    let mesh = disc(0.02);
    for radius_m in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let script = RandomPaths { radius_m, ..paths() }.script(&circle()).unwrap();
        assert!(script.validate(&mesh).is_err(), "{radius_m}");
    }
}

#[test]
fn a_centroid_off_the_skin_has_no_play_circle() {
    let square = |half: f64| vec![[-half, -half], [half, -half], [half, half], [-half, half]];
    let ring = Outline::polygon(&square(0.1), &[square(0.02)]).unwrap();
    let [a, b, c, d] = [0.0, 0.02, 0.18, 0.2];
    let corners = [[a, a], [d, a], [d, d], [a, d], [a, c], [c, c], [c, b], [a, b]];
    let bracket = Outline::polygon(&corners, &[]).unwrap();
    for outline in [ring, bracket] {
        refused(PlayCircle::of_outline(&outline), "the centroid of the outline, ");
    }
}
