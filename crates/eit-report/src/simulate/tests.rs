//! Paths keep their promises, noise has its level, truth lies where the fingers are.

use super::*;
use eit_inverse::metrics::{Cells, ChangeSign, half_maximum_centre_m, touch_position_errors_m};
use eit_skin::scene::MeshSource;
use eit_skin::{MeshOverride, Scene};
use ndarray::{Array1, Array2, Axis};
use voltages::SequenceVoltages;

/// The paper's skin on so many nodes.
fn skin(nodes: usize) -> Skin {
    let mesh = MeshOverride { nodes: Some(nodes), ..Default::default() };
    let scene = Scene::load("paper-disc").unwrap();
    Skin::set_up(&scene, &mesh, &mut Progress::default()).unwrap()
}

fn source() -> MeshSource {
    Scene::load("paper-disc").unwrap().mesh(None).unwrap()
}

fn source_of(skin: &str, electrodes: &str) -> MeshSource {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    let text = format!(
        "[skin]\nconductivity_s = 1e-5\n{skin}\n[electrodes]\n{electrodes}\n\
         contact_impedance_ohm_m = 1e3\n"
    );
    std::fs::write(&path, text).unwrap();
    Scene::load(path.to_str().unwrap()).unwrap().mesh(None).unwrap()
}

const EIGHT: &str = "count = 8\nwidth_m = 0.01";

/// Small enough for a test: 1500 nodes solve in a millisecond.
fn small() -> SequenceSettings {
    SequenceSettings { nodes: 1500, frames: 12, ..SequenceSettings::default() }
}

fn voltages(settings: &SequenceSettings) -> SequenceVoltages {
    let skin = skin(settings.nodes);
    let sequence = TouchSequence::random(&skin.source, settings).unwrap();
    sequence.voltages(&skin, &mut Progress::default()).unwrap()
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[test]
fn fingers_stay_inside_and_apart_and_keep_their_speed() {
    let source = source();
    for touches in 1..=4 {
        for path_seed in 0..50 {
            for step_m in [SLOW_M, FAST_M] {
                let settings =
                    SequenceSettings { touches, path_seed, step_m, frames: 60, ..small() };
                let sequence = TouchSequence::random(&source, &settings).unwrap();
                for fingers in &sequence.positions_m {
                    assert_eq!(fingers.len(), touches);
                    for (k, &finger) in fingers.iter().enumerate() {
                        // the bounds are met exactly but for rounding
                        assert!(distance(finger, [0.0; 2]) <= 0.08 + 1e-15);
                        let others = &fingers[..k];
                        assert!(others.iter().all(|&o| distance(finger, o) >= 0.048 - 1e-15));
                    }
                }
                for pair in sequence.positions_m.windows(2) {
                    for (&a, &b) in pair[0].iter().zip(&pair[1]) {
                        // a chord is no longer than its arc, each end of which the table of
                        // lengths places to |p''| du^2 / 8 = 2.3e-7 m; and at the sharpest bends
                        // of the smallest paths 0.54 of it (measured)
                        let chord = distance(a, b);
                        assert!(chord <= step_m + 5e-7, "{chord}");
                        assert!(chord >= 0.5 * step_m, "{touches} {path_seed} {chord}");
                    }
                }
            }
        }
    }
}

/// Short steps add up to the same way as the path's own measure.
#[test]
fn steps_are_measured_along_the_path() {
    let settings = SequenceSettings { step_m: 1e-4, frames: 4001, ..small() };
    for path_seed in 0..10 {
        let settings = SequenceSettings { path_seed, ..settings.clone() };
        let sequence = TouchSequence::random(&source(), &settings).unwrap();
        let way: f64 =
            sequence.positions_m.windows(2).map(|pair| distance(pair[0][0], pair[1][0])).sum();
        // chords of 1e-4 m on bends of 10 mm are short by 4e-6, the path's table by less
        assert!((way / 0.4 - 1.0).abs() < 1e-5, "{way}");
    }
}

#[test]
fn seeds_decide_and_nothing_else() {
    let source = source();
    let path = |path_seed, frames, nodes| {
        let settings = SequenceSettings { path_seed, frames, nodes, touches: 3, ..small() };
        TouchSequence::random(&source, &settings).unwrap().positions_m
    };
    assert_eq!(path(1, 12, 1500), path(1, 12, 1600));
    assert_eq!(path(1, 12, 1500)[..], path(1, 40, 1500)[..12]);
    assert_ne!(path(1, 12, 1500), path(2, 12, 1500));
    let bytes = |noise_seed| {
        let skin = skin(1400);
        let raster = Raster::new(skin.mesh.surface(), 16).unwrap();
        let settings = SequenceSettings { noise_seed, touches: 2, ..small() };
        let sequence = simulate(&skin, &settings, &raster, &mut Progress::default()).unwrap();
        assert_eq!(sequence.frames.values.dim(), (12, 208));
        assert_eq!((sequence.truth.dim(), sequence.positions_m.len()), ((12, 16, 16), 12));
        assert!(sequence.nodes > 1000 && sequence.noise_std_v > 0.0);
        let bits = |values: &mut dyn Iterator<Item = f64>| -> Vec<u64> {
            values.map(f64::to_bits).collect()
        };
        let frames = bits(&mut sequence.frames.values.iter().copied());
        let reference = bits(&mut sequence.frames.reference.iter().copied());
        (frames, reference, bits(&mut sequence.truth.iter().copied()))
    };
    let first = bytes(1);
    assert!(first == bytes(1), "the same seed gives other bytes");
    let other = bytes(2);
    assert!(first.0 != other.0 && first.1 != other.1, "the noise seed changes nothing");
    assert!(first.2 == other.2, "the noise seed moves the fingers");
}

#[test]
fn noise_has_its_level() {
    let voltages = voltages(&SequenceSettings { frames: 100, ..small() });
    let rms = |values: &Array2<f64>| {
        (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
    };
    let reference = voltages.reference.clone().insert_axis(Axis(0));
    for decibel in [30.0, 50.0, 70.0] {
        let stated = voltages.noise_std_v(decibel);
        let frames = voltages.with_noise(stated, 7).unwrap();
        let noise = rms(&(&frames.values - &voltages.frames));
        let found = 20.0 * (rms(&reference) / noise).log10();
        // 20 800 samples: the deviation is known to 0.5 %, 0.04 dB; four times that
        assert!((found - decibel).abs() < 0.17, "{decibel}: {found}");
        let noise = Array1::from_vec(frames.reference.clone()) - &voltages.reference;
        let noise = rms(&noise.insert_axis(Axis(0)));
        // 208 samples: 5 %
        assert!((noise / stated - 1.0).abs() < 0.2, "{decibel}: {noise}");
    }
    let clean = voltages.with_noise(0.0, 7).unwrap();
    assert_eq!(clean.values, voltages.frames);
    assert_eq!(clean.reference, voltages.reference.to_vec());
}

/// Noise of one seed only grows with its level.
#[test]
fn noise_of_one_seed_scales() {
    let voltages = voltages(&small());
    let noise = |std| {
        let frames = voltages.with_noise(std, 3).unwrap();
        &frames.values - &voltages.frames
    };
    let (small, large) = (noise(1e-3), noise(1e-2));
    // each sum of voltage (below 10 V) and noise is rounded once, ten times that for the small
    for (s, l) in small.iter().zip(&large) {
        assert!((10.0 * s - l).abs() < 2e-14, "{s} {l}");
    }
}

/// Each frame is the forward solve of its own conductivity, also where frames share a solve.
#[test]
fn frames_are_forward_solves() {
    let skin = skin(1500);
    let place = [0.03, -0.02];
    let sequence = TouchSequence {
        positions_m: vec![vec![], vec![place], vec![place], vec![], vec![place, [-0.05, 0.0]]],
        finger: Finger { sigma_m: 0.01, change: 2.0, ..Finger::default() },
        rate_hz: 8.0,
    };
    let found = sequence.voltages(&skin, &mut Progress::default()).unwrap();
    for (frame, fingers) in found.frames.rows().into_iter().zip(&sequence.positions_m) {
        let sigma = |c: [f64; 3]| {
            let bell = |f: &[f64; 2]| (-distance([c[0], c[1]], *f).powi(2) / 2e-4).exp();
            1e-5 * (1.0 + 2.0 * fingers.iter().map(bell).sum::<f64>())
        };
        let conductivity: Vec<f64> =
            skin.mesh.surface().centroids().into_iter().map(sigma).collect();
        let wanted = skin.model.forward(&conductivity).unwrap();
        let largest = wanted.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        // the same formula in another order: rounding of the conductivities
        assert!(frame.iter().zip(&wanted).all(|(a, b)| (a - b).abs() < 1e-12 * largest));
    }
    assert_eq!(found.frames.row(0), found.reference);
    assert_eq!(found.frames.row(1), found.frames.row(2));
    assert_ne!(found.frames.row(1), found.frames.row(0));
}

#[test]
fn truth_lies_where_the_fingers_are() {
    let skin = Skin::load("paper-disc").unwrap();
    let raster = Raster::new(skin.mesh.surface(), 64).unwrap();
    let cells = Cells::of_raster(&raster);
    for touches in 1..=4 {
        let settings = SequenceSettings { touches, step_m: FAST_M, frames: 20, ..small() };
        let sequence = TouchSequence::random(&skin.source, &settings).unwrap();
        let truth = sequence.truth(skin.conductivity_s, &raster);
        for (image, fingers) in truth.outer_iter().zip(&sequence.positions_m) {
            assert!(image.iter().zip(raster.mask()).all(|(x, inside)| x.is_nan() != *inside));
            let mut pixels = vec![0.0; raster.masked_pixels().len()];
            raster.pixels_from_image_into(image, &mut pixels).unwrap();
            let found =
                touch_position_errors_m(&pixels, &cells, fingers, &Default::default()).unwrap();
            assert_eq!((found.missed, found.extra), (0, 0));
            // half maximum sets of 14 mm radius in pixels of 3.1 mm
            assert!(found.errors_m.iter().all(|e| e.unwrap() < 5e-4), "{found:?}");
            if let [finger] = fingers[..] {
                let (areas, places) = (cells.areas_m2(), cells.positions_m());
                let centre = half_maximum_centre_m(&pixels, areas, places, ChangeSign::Increase);
                assert!(distance(centre.unwrap().unwrap(), finger) < 1e-3);
                // height and amount of the bell, 5e-6 S and 2 pi sigma^2 times that; the mean of
                // the pixel at the top is lower by (pixel / sigma)^2 / 12, and its centre may be
                // half a diagonal off: 0.6 and 1.7 %
                let largest = pixels.iter().fold(0.0, |m: f64, x| m.max(*x));
                assert!((0.97 * 5e-6..=5e-6).contains(&largest), "{largest:e}");
                let amount = cells.integral(&pixels).unwrap();
                let whole = 5e-6 * std::f64::consts::TAU * 0.012_f64.powi(2);
                // 5 % of a bell 20 mm from the rim lies beyond it
                assert!((0.94..1.01).contains(&(amount / whole)), "{}", amount / whole);
            }
        }
    }
}

#[test]
fn invalid_sequences_are_refused() {
    let refused = |source: &MeshSource, settings: SequenceSettings, words: &str| {
        let message = TouchSequence::random(source, &settings).unwrap_err().to_string();
        assert!(message.contains(words), "{message}");
    };
    let disc = source();
    refused(&disc, SequenceSettings { touches: 0, ..small() }, "1 to 4 touches, not 0");
    refused(&disc, SequenceSettings { touches: 5, ..small() }, "1 to 4 touches, not 5");
    refused(&disc, SequenceSettings { frames: 0, ..small() }, "frames, not 0");
    refused(&disc, SequenceSettings { frames: usize::MAX, ..small() }, "frames, not");
    for step_m in [-1e-3, 0.09, f64::NAN, f64::INFINITY] {
        refused(&disc, SequenceSettings { step_m, ..small() }, "step_m is");
    }
    for sigma_m in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let finger = Finger { sigma_m, ..Finger::default() };
        refused(&disc, SequenceSettings { finger, ..small() }, "finger.sigma_m is");
    }
    for change in [-1.0, f64::NAN] {
        let finger = Finger { change, ..Finger::default() };
        refused(&disc, SequenceSettings { finger, ..small() }, "finger.change is");
    }
    let finger = Finger { sigma_m: 0.041, ..Finger::default() };
    refused(&disc, SequenceSettings { finger, touches: 2, ..small() }, "4 standard deviations");
    let ring = "shape = \"polygon\"\noutline = [[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]]
        holes = [[[-0.02, -0.02], [0.02, -0.02], [0.02, 0.02], [-0.02, 0.02]]]";
    refused(&source_of(ring, EIGHT), small(), "is not on the skin");
    let bracket = "shape = \"polygon\"\noutline = [[0, 0], [0.2, 0], [0.2, 0.2], [0.0, 0.2],
        [0, 0.18], [0.18, 0.18], [0.18, 0.02], [0, 0.02]]";
    refused(&source_of(bracket, EIGHT), small(), "is not on the skin");
    refused(&source_of("shape = \"mesh\"\nfile = \"skin.msh\"", ""), small(), "not a mesh file");
    let voltages = voltages(&SequenceSettings { frames: 1, ..small() });
    for std in [-1.0, f64::NAN, f64::INFINITY] {
        let message = voltages.with_noise(std, 1).err().unwrap().to_string();
        assert!(message.contains("it must be finite"), "{message}");
    }
}

/// A rectangle's fingers play around its middle, within 0.8 of half its shorter side.
#[test]
fn other_skins_have_sequences_too() {
    let source = source_of("shape = \"rectangle\"\nwidth_m = 0.3\nheight_m = 0.2", EIGHT);
    let settings = SequenceSettings { touches: 4, ..small() };
    let sequence = TouchSequence::random(&source, &settings).unwrap();
    for finger in sequence.positions_m.iter().flatten() {
        assert!(distance(*finger, [0.0; 2]) <= 0.08 + 1e-15, "{finger:?}");
    }
}
