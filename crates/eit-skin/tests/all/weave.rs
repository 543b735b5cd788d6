//! The weave of a fabric, from the reference frame alone, and touches on it.

#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test file: a panic is a failed test"
)]

use crate::common::Bench;
use crate::common::score::Counts;
use crate::common::script::{Drawn, QUIET_FRAMES};
use eit_skin::eit_fem::fabric::FabricSettings;
use eit_skin::scene::Scene;
use eit_skin::{FoundWeave, Skin, Weave};

/// A scene whose simulated fabric has this weave.
fn woven(name: &str, fabric: FabricSettings, ratio: f64, angle_deg: f64) -> Scene {
    let mut scene = Scene::load(name).unwrap();
    let fabric = scene.fabric.insert(fabric);
    (fabric.weave.ratio, fabric.weave.angle_deg) = (ratio, angle_deg);
    scene
}

/// The weave found in untouched frames of a fabric, by a scene that states none.
fn found(
    name: &str,
    fabric: FabricSettings,
    [ratio, angle_deg]: [f64; 2],
    seed: u64,
) -> Option<FoundWeave> {
    let measured = woven(name, fabric, ratio, angle_deg);
    let bench = Bench::believing(measured, Scene::load(name).unwrap());
    let mut script = bench.script("random", seed);
    script.frames = QUIET_FRAMES + 1;
    bench.fit(&bench.simulate(&script, seed)).weave
}

/// Difference of two directions, degrees.
fn turned(a: f64, b: f64) -> f64 {
    let turned = (a - b).rem_euclid(180.0);
    turned.min(180.0 - turned)
}

/// On ideal frames of other meshes: ratio within 1 %, angle within 1 degree.
#[test]
fn a_weave_is_found_on_ideal_frames() {
    for (seed, name, ratio, angle_deg) in [
        (1, "paper-disc", 1.1, 25.0),
        (2, "paper-disc", 1.6, -50.0),
        (3, "paper-disc", 2.5, 80.0),
        (4, "patches", 1.4, 35.0),
        (5, "plate-with-hole", 2.0, 100.0),
        (6, "hemisphere", 1.5, 0.0),
    ] {
        let weave = found(name, FabricSettings::ideal(), [ratio, angle_deg], seed).unwrap().weave;
        println!("{name} {ratio} {angle_deg}: {weave:?}");
        assert!((weave.ratio / ratio - 1.0).abs() < 0.01, "{name} {ratio}: {weave:?}");
        assert!(turned(weave.angle_deg, angle_deg) < 1.0, "{name} {angle_deg}: {weave:?}");
    }
}

/// Texture, gains and drift, at 60 dB: within 10 % and 10 degrees, and none where there is none.
#[test]
fn a_weave_is_found_in_an_uneven_fabric() {
    for (seed, ratio, angle_deg) in
        [(11, 1.0, 0.0), (12, 1.0, 0.0), (13, 1.3, 60.0), (14, 2.0, -20.0)]
    {
        let mut fabric = FabricSettings::default();
        fabric.weave.amplitude = 0.1;
        // a thousandth of 0.44 V, the root mean square of the voltages
        fabric.instrument.noise_v = [4.4e-4, 4.4e-4];
        let found = found("paper-disc", fabric, [ratio, angle_deg], seed);
        println!("{ratio} {angle_deg}: {found:?}");
        if ratio == 1.0 {
            assert_eq!(found, None);
            continue;
        }
        let FoundWeave { weave, ratio_std, angle_std_deg, .. } = found.unwrap();
        assert!((weave.ratio / ratio - 1.0).abs() < 0.1, "{ratio}: {weave:?}");
        assert!(turned(weave.angle_deg, angle_deg) < 10.0, "{angle_deg}: {weave:?}");
        // normal errors, five times out of a million beyond
        assert!(
            (weave.ratio / ratio).ln().abs() < 4.5 * ratio_std,
            "{ratio}: {weave:?} {ratio_std}"
        );
        assert!(
            turned(weave.angle_deg, angle_deg) < 4.5 * angle_std_deg,
            "{weave:?} {angle_std_deg}"
        );
    }
}

/// Touches on a fabric of ratio 1.8 are found where they are, although no scene states it, and with the stated weave.
#[test]
fn touches_on_a_weave() {
    let measured = woven("paper-disc", FabricSettings::default(), 1.8, 30.0);
    let mut stated = Scene::load("paper-disc").unwrap();
    (stated.skin.weave_ratio, stated.skin.weave_angle_deg) = (Some(1.8), Some(30.0));
    for scene in [Scene::load("paper-disc").unwrap(), stated] {
        let is_stated = scene.skin.weave_ratio.is_some();
        let bench = Bench::believing(measured.clone(), scene);
        let mut drawn = Drawn::new(21, 2);
        (0..5).for_each(|_| _ = drawn.press(0.7..2.0));
        let recording = bench.simulate(&drawn.script(), 21);
        let (fitted, mut counts) = (bench.fit(&recording), Counts::default());
        assert_eq!(fitted.weave.is_some(), !is_stated);
        assert_eq!(fitted.skin.skin.weave.map(|weave| weave.ratio > 1.7), Some(true));
        counts.add(&recording, &bench.touches(&recording), QUIET_FRAMES);
        let score = counts.score();
        println!("{score:?}");
        score.check_ghosts();
        assert!(score.found >= 0.99 && score.extra <= 0.01, "{score:?}");
    }
}

/// A weave of 1 is a scalar sheet, a ratio below 1 another direction.
#[test]
fn ratios_about_one() {
    let skin = Skin::load("paper-disc").unwrap();
    let voltages = |ratio: f64, angle_deg: f64| {
        let skin = skin.with_weave(Weave { ratio, angle_deg }).unwrap();
        skin.model.forward(&skin.background_s()).unwrap()
    };
    assert_eq!(voltages(1.0, 40.0), skin.model.forward(&skin.background_s()).unwrap());
    let (along, across) = (voltages(1.6, 20.0), voltages(1.0 / 1.6, 110.0));
    let largest = along.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    assert!((&along - &across).iter().all(|d| d.abs() < 1e-12 * largest));
}
