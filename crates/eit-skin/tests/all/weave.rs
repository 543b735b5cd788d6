//! The weave of a fabric, from the reference frame alone, and touches on it.

use crate::common::*;
use eit_skin::eit_fem::fabric::FabricSettings;
use eit_skin::scene::Scene;
use eit_skin::{FoundWeave, Skin, Weave};

/// A scene whose simulated fabric has this weave.
fn woven(name: &str, fabric: FabricSettings, [ratio, angle_deg]: [f64; 2]) -> Scene {
    let mut scene = Scene::load(name).unwrap();
    let fabric = scene.fabric.insert(fabric);
    (fabric.weave.ratio, fabric.weave.angle_deg) = (ratio, angle_deg);
    scene
}

/// The weave found in untouched frames of a fabric, by a scene that states none.
fn found(name: &str, fabric: FabricSettings, weave: [f64; 2], seed: u64) -> Option<FoundWeave> {
    let bench = Bench::believing(&woven(name, fabric, weave), &Scene::load(name).unwrap());
    let mut script = bench.script("random", seed);
    script.frames = QUIET_FRAMES + 1;
    bench.fit(&bench.simulate(&script, seed)).weave
}

/// Differences of a weave from the true one: of the ratio, relative, and of the direction, degrees.
fn off(weave: Weave, [ratio, angle_deg]: [f64; 2]) -> [f64; 2] {
    let turned_deg = (weave.angle_deg - angle_deg).rem_euclid(180.0);
    [(weave.ratio / ratio - 1.0).abs(), turned_deg.min(180.0 - turned_deg)]
}

/// On ideal frames of other meshes: ratio within 1 %, angle within 1 degree.
#[test]
fn a_weave_is_found_on_ideal_frames() {
    for (seed, name, wanted) in [
        (1, "paper-disc", [1.1, 25.0]),
        (2, "paper-disc", [1.6, -50.0]),
        (3, "paper-disc", [2.5, 80.0]),
        (4, "patches", [1.4, 35.0]),
        (5, "plate-with-hole", [2.0, 100.0]),
        (6, "hemisphere", [1.5, 0.0]),
    ] {
        let weave = found(name, FabricSettings::ideal(), wanted, seed).unwrap().weave;
        let [ratio, turned_deg] = off(weave, wanted);
        assert!(ratio < 0.01 && turned_deg < 1.0, "{name} {wanted:?}: {weave:?}");
    }
}

/// Texture, gains and drift, at 60 dB: within 10 % and 10 degrees, and none where there is none.
#[test]
fn a_weave_is_found_in_an_uneven_fabric() {
    for (seed, wanted) in
        [(11, [1.0, 0.0]), (12, [1.0, 0.0]), (13, [1.3, 60.0]), (14, [2.0, -20.0])]
    {
        let mut fabric = FabricSettings::default();
        fabric.weave.amplitude = 0.1;
        // a thousandth of 0.44 V, the root mean square of the voltages
        fabric.instrument.noise_v = [4.4e-4, 4.4e-4];
        let found = found("paper-disc", fabric, wanted, seed);
        assert_eq!(found.is_some(), wanted[0] != 1.0, "{wanted:?}: {found:?}");
        let Some(FoundWeave { weave, ratio_std, angle_std_deg, .. }) = found else { continue };
        let [ratio, turned_deg] = off(weave, wanted);
        assert!(ratio < 0.1 && turned_deg < 10.0, "{wanted:?}: {weave:?}");
        // normal errors, five times out of a million beyond
        let ratio_ln = (weave.ratio / wanted[0]).ln().abs();
        assert!(ratio_ln < 4.5 * ratio_std, "{wanted:?}: {weave:?} {ratio_std}");
        assert!(turned_deg < 4.5 * angle_std_deg, "{wanted:?}: {weave:?} {angle_std_deg}");
    }
}

/// Touches on a fabric of ratio 1.8 are found where they are, although no scene states it, and with the stated weave.
#[test]
fn touches_on_a_weave() {
    let measured = woven("paper-disc", FabricSettings::default(), [1.8, 30.0]);
    let unknown = Scene::load("paper-disc").unwrap();
    let mut stated = unknown.clone();
    (stated.skin.weave_ratio, stated.skin.weave_angle_deg) = (Some(1.8), Some(30.0));
    let [unknown, stated] = [unknown, stated].map(|scene| Bench::believing(&measured, &scene));
    let recordings = unknown.draw([21], 2, |drawn, _| drawn.presses(5, 0.7..2.0));
    for (bench, is_stated) in [(unknown, false), (stated, true)] {
        let fitted = bench.fit(&recordings[0]);
        assert_eq!(fitted.weave.is_some(), !is_stated);
        assert_eq!(fitted.skin.skin.weave.map(|weave| weave.ratio > 1.7), Some(true));
        let bars = Bars { found: 0.99, extra: 0.01, ..ANY };
        bench.score(&recordings).check(if is_stated { "stated" } else { "found" }, &bars);
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
