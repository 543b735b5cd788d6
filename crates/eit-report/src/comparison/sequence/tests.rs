//! Seeds determine the sequence, noise has the requested level, and the truth is where the fingers
//! are.

use super::*;
use eit_inverse::metrics::{Cells, ChangeSign, half_maximum_centre_m, touch_position_errors_m};
use eit_skin::scene::MeshSource;
use eit_skin::{MeshOverride, Scene};
use ndarray::{Array1, Array2, Axis};
use voltages::SequenceVoltages;

/// The skin of the paper with the given number of nodes.
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
fn seeds_decide_and_nothing_else() {
    let source = source();
    let path = |path_seed, frames, nodes| {
        let settings = SequenceSettings { path_seed, frames, nodes, touches: 3, ..small() };
        TouchSequence::random(&source, &settings).unwrap().positions_m()
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
        // 20 800 samples: the standard deviation is known to 0.5 %, or 0.04 dB; the tolerance is
        // four times that
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

/// Noise of one seed has the same shape at every level.
#[test]
fn noise_of_one_seed_scales() {
    let voltages = voltages(&small());
    let noise = |std| {
        let frames = voltages.with_noise(std, 3).unwrap();
        &frames.values - &voltages.frames
    };
    let (small, large) = (noise(1e-3), noise(1e-2));
    // each sum of voltage (below 10 V) and noise is rounded once; the small noise is scaled by ten
    for (s, l) in small.iter().zip(&large) {
        assert!((10.0 * s - l).abs() < 2e-14, "{s} {l}");
    }
}

/// Each frame is the forward solution for its own fingers, a 12 mm bell or a pad with the same
/// total change.
#[test]
fn frames_are_forward_solves() {
    let skin = skin(1500);
    let centroids = skin.mesh.surface().centroids();
    for shape in FingerShape::ALL {
        let finger = Finger { shape, change: 2.0, ..Finger::default() };
        let settings = SequenceSettings { finger, touches: 2, frames: 3, ..small() };
        let sequence = TouchSequence::random(&skin.source, &settings).unwrap();
        let found = sequence.voltages(&skin, &mut Progress::default()).unwrap();
        for (frame, fingers) in found.frames.rows().into_iter().zip(sequence.positions_m()) {
            let of_one = |c: &[f64; 3], f: &[f64; 2]| {
                let square = distance([c[0], c[1]], *f).powi(2) / 0.012_f64.powi(2);
                match shape {
                    FingerShape::Bell => (-0.5 * square).exp(),
                    FingerShape::Pad => f64::from(square <= 2.0),
                }
            };
            let change = |c: &[f64; 3]| 2.0 * fingers.iter().map(|f| of_one(c, f)).sum::<f64>();
            let conductivity: Vec<f64> =
                centroids.iter().map(|c| 1e-5 * (1.0 + change(c))).collect();
            let wanted = skin.model.forward(&conductivity).unwrap();
            let largest = wanted.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
            // the same formula in a different order: rounding of the conductivities
            assert!(frame.iter().zip(&wanted).all(|(a, b)| (a - b).abs() < 1e-12 * largest));
        }
        let untouched = skin.model.forward(&skin.background_s()).unwrap();
        assert_eq!(found.reference, untouched);
    }
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
        for (image, fingers) in truth.outer_iter().zip(&sequence.positions_m()) {
            assert!(image.iter().zip(raster.mask()).all(|(x, inside)| x.is_nan() != *inside));
            let mut pixels = vec![0.0; raster.masked_pixels().len()];
            raster.pixels_from_image_into(image, &mut pixels).unwrap();
            let found =
                touch_position_errors_m(&pixels, &cells, fingers, &Default::default()).unwrap();
            assert_eq!((found.missed, found.extra), (0, 0));
            // half-maximum sets of 14 mm radius in pixels of 3.1 mm
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
                // 5 % of a bell centred 20 mm from the rim lies beyond it
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
    refused(
        &disc,
        SequenceSettings { touches: 0, ..small() },
        "fingers is 0: it must be from 1 to 4",
    );
    refused(
        &disc,
        SequenceSettings { touches: 5, ..small() },
        "fingers is 5: it must be from 1 to 4",
    );
    refused(&disc, SequenceSettings { frames: 0, ..small() }, "frames is 0");
    refused(&disc, SequenceSettings { step_m: 0.09, ..small() }, "step_m is 0.09");
    for sigma_m in [-1.0, f64::NAN, f64::INFINITY] {
        let finger = Finger { sigma_m, ..Finger::default() };
        refused(&disc, SequenceSettings { finger, ..small() }, "apart_m is");
    }
    let finger = Finger { sigma_m: 0.041, ..Finger::default() };
    refused(&disc, SequenceSettings { finger, touches: 2, ..small() }, "cannot stay 0.164 m apart");
    refused(&source_of("shape = \"mesh\"\nfile = \"skin.msh\"", ""), small(), "not a mesh file");
    let hemisphere = "shape = \"hemisphere\"\nradius_m = 0.1";
    refused(&source_of(hemisphere, "count = 8\nwidth_m = 0.01"), small(), "not a hemisphere");
    // values for one finger that frames reject
    let skin = skin(1500);
    for (sigma_m, change) in [(0.0, 0.5), (0.012, -1.01), (0.012, f64::NAN)] {
        let finger = Finger { sigma_m, change, ..Finger::default() };
        let settings = SequenceSettings { finger, frames: 1, ..small() };
        let sequence = TouchSequence::random(&disc, &settings).unwrap();
        assert!(sequence.voltages(&skin, &mut Progress::default()).is_err(), "{sigma_m} {change}");
    }
    let voltages = voltages(&SequenceSettings { frames: 1, ..small() });
    for std in [-1.0, f64::NAN, f64::INFINITY] {
        let message = voltages.with_noise(std, 1).err().unwrap().to_string();
        assert!(message.contains("it must be finite"), "{message}");
    }
}
