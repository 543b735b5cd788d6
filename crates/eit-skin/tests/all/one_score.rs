//! Touches by `[touch] model = "one-score"`, where the search of bells finds fewer or had to learn a rule. Full figures:
//! `docs/validation/rough.md`.

#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test file: a panic is a failed test"
)]

use crate::common::Bench;
use crate::common::score::{Counts, acted_on};
use crate::common::script::{Drawn, QUIET_FRAMES};
use eit_skin::scene::Scene;
use eit_skin::touches::touches;
use eit_skin::{MeshOverride, Progress, Skin};
use std::collections::BTreeSet;
use std::sync::Arc;

const MODEL: &str = "\n[touch]\nmodel = \"one-score\"\n";

fn bench(name: &str) -> Bench {
    let scene = || Scene::parse(&(Scene::text(name).unwrap() + MODEL), name).unwrap();
    Bench::believing(scene(), scene())
}

/// Six fingers that land at once: each alone explains next to nothing of a frame that seems damaged. Unless births are
/// followed to the end, 0.57 are found, and a touch stays after a lift.
#[test]
fn six_fingers_that_land_at_once() {
    let bench = bench("paper-disc");
    let mut counts = Counts::default();
    for seed in [71, 81, 91] {
        let mut drawn = Drawn::new(seed, 6);
        for (radius_m, angle) in [(0.06, 0.0), (0.06, 0.2), (0.05, 0.4), (0.07, 0.1)] {
            drawn.ring(radius_m, angle, 1.5);
        }
        let recording = bench.simulate(&drawn.script(), seed);
        counts.add(&recording, &bench.touches(&recording), QUIET_FRAMES);
    }
    let score = counts.score();
    println!("{score:?}");
    score.check_ghosts();
    // measured 0.992 and 0: a frame in some beginnings
    assert!(score.found >= 0.98 && score.extra <= 0.01, "{score:?}");
}

/// Presses and a slide on fabric with all effects; the search finds 0.45 of the fingers, and 0.49 others beside them.
#[test]
fn rough_fabric() {
    let ([by_score, by_search], mut scores) =
        ([bench("rough-disc"), Bench::of("rough-disc")], [[0.0; 2]; 2]);
    let mut counts = [Counts::default(), Counts::default()];
    for seed in [31, 32] {
        let mut drawn = Drawn::new(seed, 2);
        (0..3).for_each(|_| _ = drawn.press(0.7..2.0));
        drawn.slide(1.5, 0.05);
        let recording = by_score.simulate(&drawn.script(), seed);
        for (counts, bench) in counts.iter_mut().zip([&by_score, &by_search]) {
            counts.add(&recording, &bench.touches(&recording), QUIET_FRAMES);
        }
    }
    for (score, counts) in scores.iter_mut().zip(counts) {
        let counted = counts.score();
        println!("{counted:?}");
        *score = [counted.found, counted.extra];
    }
    let [[found, extra], [searched, _]] = scores;
    // measured 1.000 and 0; the bar is that of rough fabric, with the extra touches of its worst slide (docs/validation/rough.md)
    assert!(found >= 0.95 && extra <= 0.1 && found > searched, "{scores:?}");
}

/// A strong object in a real tank is one touch under one id, and nothing is left of it. Without what its disturbance of the
/// currents looks like elsewhere, second touches stand opposite it in nine of ten frames, and 22 of 30 frames after it show one.
#[test]
fn an_object_in_a_tank_is_one_touch() {
    let Some(folder) = fixtures::shared_data("sciospec_tank_adjacent") else { return };
    let file =
        concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/scenes/sciospec_tank_adjacent.toml");
    let text = std::fs::read_to_string(file).unwrap();
    let text = text.replace("[touch]", "[touch]\nmodel = \"one-score\"");
    let mut progress = Progress::silent();
    let scene = Scene::parse(&text, "tank").unwrap();
    let skin = Skin::set_up(&scene, &MeshOverride::default(), &mut progress).unwrap();
    let frames = skin.read_frames(&[folder], None).unwrap();
    let fitted = Arc::new(skin.linearise(&mut progress).unwrap()).fit(frames).unwrap();
    let found = touches(&fitted, &mut progress).unwrap().unwrap();
    let shown: Vec<(usize, Vec<u64>)> = (0..found.frames)
        .map(|frame| (frame, acted_on(&found, frame).iter().map(|touch| touch.id).collect()))
        .filter(|(_, ids): &(usize, Vec<u64>)| !ids.is_empty())
        .collect();
    let ids: BTreeSet<u64> = shown.iter().flat_map(|(_, ids)| ids.iter().copied()).collect();
    let (first, last) = (shown.first().unwrap().0, shown.last().unwrap().0);
    println!("{} frames from {first} to {last}, ids {ids:?}", shown.len());
    assert!(shown.iter().all(|(_, ids)| ids.len() == 1) && ids.len() == 1, "{ids:?}");
    // it enters in frame 57 and is out in 227; measured 57 to 220
    assert!(first >= 56 && last <= 227 && shown.len() >= 160, "{first} {last} {}", shown.len());
}
