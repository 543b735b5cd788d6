//! Touches on the plate with a hole, with default settings. Full figures: `docs/validation/touch_skins.md`.

#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test file: a panic is a failed test"
)]

mod common;

use common::Bench;
use common::score::Counts;
use common::script::{Drawn, QUIET_FRAMES};
use eit_skin::eit_fem::fabric::Random;

/// Places of four fingers on the plate with a hole, 40 mm apart and 8 mm from every edge.
fn places(random: &mut Random) -> Vec<[f64; 2]> {
    let mut places: Vec<[f64; 2]> = Vec::new();
    while places.len() < 4 {
        let [x, y] = [random.between(-0.142, 0.142), random.between(-0.092, 0.092)];
        let is_off_the_hole = x.abs() > 0.038 || y.abs() > 0.038;
        if is_off_the_hole && places.iter().all(|p| (p[0] - x).hypot(p[1] - y) >= 0.04) {
            places.push([x, y]);
        }
    }
    places
}

/// Four fingers. Gains read off small voltages and dents that only moved electrodes left ten times the residual, and
/// touches were shown where there was no finger.
#[test]
fn four_on_the_plate() {
    let bench = Bench::of("plate-with-hole");
    let mut counts = Counts::default();
    for seed in [72, 73, 74] {
        let mut drawn = Drawn::new(seed, 4);
        let mut random = Random::named(seed, "places on the plate", 0);
        (0..5).for_each(|_| _ = drawn.press_at(&places(&mut random), 0.7..2.0));
        let recording = bench.simulate(&drawn.script(), seed);
        counts.add(&recording, &bench.touches(&recording), QUIET_FRAMES);
    }
    let score = counts.score();
    println!("{score:?}");
    assert_eq!(score.ghosts, 0, "{score:?}");
    assert!(score.found >= 0.5 && score.extra <= 0.5, "{score:?}");
}
