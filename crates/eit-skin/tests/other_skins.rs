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
use common::script::{Drawn, QUIET_FRAMES, RATE_HZ};
use eit_skin::Progress;
use eit_skin::eit_fem::fabric::Random;
use eit_skin::touches::TouchFinder;

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

/// Four fingers are explained to their noise, and most are found.
///
/// Without dents 5.5 of the noise is left per row, which hides fingers or is shown as others.
#[test]
fn four_on_the_plate() {
    let bench = Bench::of("plate-with-hole");
    let (mut counts, mut left) = (Counts::default(), Vec::new());
    for seed in [72, 73, 74] {
        let mut drawn = Drawn::new(seed, 4);
        let mut random = Random::named(seed, "places on the plate", 0);
        (0..5).for_each(|_| _ = drawn.press_at(&places(&mut random), 0.7..2.0));
        let recording = bench.simulate(&drawn.script(), seed);
        counts.add(&recording, &bench.touches(&recording), QUIET_FRAMES);
        let fitted = bench.fit(&recording);
        let mut finder =
            TouchFinder::new(&fitted, RATE_HZ, &mut Progress::silent()).unwrap().unwrap();
        for (frame, values) in recording.values.rows().into_iter().enumerate() {
            finder.push(&values.to_vec(), |_| true, frame as f64 / RATE_HZ).unwrap();
            let step = finder.step().unwrap();
            let pressed = recording.truth.iter().filter(|t| t.frame == frame && t.force_n >= 0.7);
            if pressed.count() == 4 {
                left.push(step.chi_square_rest / step.rows as f64);
            }
        }
    }
    left.sort_by(f64::total_cmp);
    let (score, left) = (counts.score(), left[left.len() / 2]);
    println!("{score:?}; {left:.2} of the noise left per row, median of frames with four fingers");
    assert_eq!(score.ghosts, 0, "{score:?}");
    // measured 1.1; noise alone leaves 0.7, and a quarter more is within what other draws differ by
    assert!(left <= 1.4, "{left}");
    // measured 0.84 and 0.10: a poorly sensed skin, where presses beyond the electrodes hold little evidence
    assert!(score.found >= 0.78 && score.extra <= 0.15, "{score:?}");
}
