//! The derivative against the definition, training that resumes to the same bits, and the base.
#![cfg(feature = "train")]
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs, reason = "tests")]

mod common;

use common::{convolutions, direct, disc, shard, weights};
use eit_denoise::{
    BaseSettings, DenoiseError, Denoiser, Engine, Examples, ImageStack, LearningBase,
    RasterSymmetry, Shard, TrainSettings, TrainStatus, Trainer, UnetShape,
};
use fixtures::Random;
use ndarray::{Array2, Array3, Axis};
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;

/// Error of parameters by the definition in `f64`.
fn error_by_definition(
    shape: UnetShape,
    parameters: &[f64],
    frames: &Array3<f64>,
    wanted: &Array2<f64>,
    mask: &Array2<bool>,
) -> f64 {
    let mut planes: Vec<Array2<f64>> = frames.outer_iter().map(|f| f.to_owned()).collect();
    planes.push(mask.mapv(|m| f64::from(u8::from(m))));
    let image = common::direct_f64(shape, parameters, planes);
    let inside = || image.iter().zip(wanted).zip(mask).filter(|(_, m)| **m);
    let sum: f64 = inside().map(|((v, w), _)| (v - w) * (v - w)).sum();
    sum / inside().count() as f64
}

/// What errors count: one over the raw image's error plus a fiftieth of the mean of those, which is
/// taken in the images' own unit.
fn factors(pairs: &[(Array3<f64>, Array2<f64>)], scales: &[f64], mask: &Array2<bool>) -> Vec<f64> {
    let of_raw = |(frames, wanted): &(Array3<f64>, Array2<f64>)| {
        let raw = frames.index_axis(Axis(0), frames.len_of(Axis(0)) - 1);
        let inside = || raw.iter().zip(wanted).zip(mask).filter(|(_, m)| **m);
        inside().map(|((v, w), _)| (v - w).powi(2)).sum::<f64>() / inside().count() as f64
    };
    let errors: Vec<f64> = pairs.iter().map(of_raw).collect();
    let own = errors.iter().zip(scales).map(|(e, s)| e * s * s);
    let mean = own.sum::<f64>() / errors.len() as f64;
    errors.iter().zip(scales).map(|(e, s)| 1.0 / (e + 0.02 * mean / (s * s))).collect()
}

/// Central differences of the definition in `f64` along random directions within each layer, step
/// 1e-6: they are right to 1e-8; the derivative in `f32` to 1e-4, the rounding of some thousand sums.
#[test]
fn the_derivative_is_that_of_the_definition_in_every_layer() {
    for shape in [
        UnetShape { history: 1, width: 3, depth: 2 },
        UnetShape { history: 2, width: 5, depth: 1 },
        UnetShape { history: 3, width: 4, depth: 3 },
    ] {
        let pixels = 16;
        let shard = shard(3, pixels);
        let examples = Examples::new(std::slice::from_ref(&shard), shape.history).unwrap();
        assert_eq!(examples.len(), 3);
        let parameters = weights(shape, [pixels, pixels]).parameters;
        let mut steps = Engine::Own.start(shape, [pixels, pixels], 1).unwrap();
        steps.load(&parameters).unwrap();
        let (sum, gradient) = steps.step(&examples, &[0, 1, 2]).unwrap();
        let error = sum / 3.0;
        // the examples once more, in f64
        let mut scales = Vec::new();
        let pairs: Vec<_> = (0..3)
            .map(|last| {
                let seen = Array3::from_shape_fn((shape.history, pixels, pixels), |(k, r, c)| {
                    let f = (last + k + 1).checked_sub(shape.history);
                    f.map_or(0.0, |f| f64::from(shard.raw[[f, r, c]]))
                });
                let scale = seen.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
                scales.push(scale);
                let wanted = shard.wanted.index_axis(Axis(0), last);
                (seen / scale, wanted.mapv(|v| f64::from(v) / scale))
            })
            .collect();
        let factors = factors(&pairs, &scales, &shard.mask);
        let error_of = |parameters: &[f64]| {
            let one = |((frames, wanted), factor): (&(Array3<f64>, Array2<f64>), &f64)| {
                factor * error_by_definition(shape, parameters, frames, wanted, &shard.mask)
            };
            pairs.iter().zip(&factors).map(one).sum::<f64>() / 3.0
        };
        let exact: Vec<f64> = parameters.iter().map(|p| f64::from(*p)).collect();
        assert!((error - error_of(&exact)).abs() < 1e-5 * error, "{shape:?}");
        let mut random = Random::new(3);
        let mut from = 0;
        for c in convolutions(shape) {
            let kernel = c[0] * c[1] * c[2] * c[2];
            for count in [kernel, c[0]] {
                let direction: Vec<f64> = (0..count).map(|_| random.between(-1.0, 1.0)).collect();
                let norm = direction.iter().map(|d| d * d).sum::<f64>().sqrt();
                let moved = |step: f64| {
                    let mut parameters = exact.clone();
                    for (p, d) in parameters[from..].iter_mut().zip(&direction) {
                        *p += step * d / norm;
                    }
                    error_of(&parameters)
                };
                let wanted = (moved(1e-6) - moved(-1e-6)) / 2e-6;
                let own = &gradient[from..from + count];
                let slope = own.iter().zip(&direction).map(|(g, d)| f64::from(*g) * d / norm);
                let slope: f64 = slope.sum();
                // relative to the length of the derivative: a direction may lie across it
                let size = own.iter().map(|g| f64::from(*g).powi(2)).sum::<f64>().sqrt();
                assert!(size > 0.0, "{shape:?} {c:?}");
                assert!((slope - wanted).abs() < 1e-4 * size, "{shape:?} {c:?}: {slope} {wanted}");
                from += count;
            }
        }
        assert_eq!(from, parameters.len());
    }
}

fn settings() -> TrainSettings {
    let shape = UnetShape { history: 2, width: 2, depth: 1 };
    TrainSettings { shape, seed: 4, epochs: 6, batch: 4, rate: 1e-2, patience: 0 }
}

fn go_on(_: usize, _: usize) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// The net that was trained runs as it was trained: error of the learning curve from images that
/// went through [`Denoiser`], to the rounding of `f32`.
#[test]
fn training_lowers_the_error_of_the_net_that_runs() {
    let shard = shard(12, 16);
    let shape = UnetShape { history: 2, width: 6, depth: 2 };
    let settings = TrainSettings { shape, epochs: 150, rate: 5e-3, ..settings() };
    let examples = Examples::new(std::slice::from_ref(&shard), 2).unwrap();
    let mut trainer = Trainer::new(&settings, "base").unwrap();
    while trainer.status() == TrainStatus::Running {
        trainer.epoch(&examples, &examples, 1, &mut go_on).unwrap();
    }
    assert_eq!(trainer.status(), TrainStatus::Done);
    let weights = trainer.weights("skin", [16, 16], BTreeMap::new());
    let outside_nan =
        |images: &Array3<f32>| ImageStack::new(images.mapv(f64::from), shard.mask.clone()).unwrap();
    let raw = outside_nan(&shard.raw);
    let made = Denoiser::new(&weights, shard.mask.view()).unwrap().denoise(&raw).unwrap();
    let mut errors = Vec::new();
    for f in 0..12 {
        let mut inside = 0.0;
        let (mut net_sum, mut raw_sum) = (0.0, 0.0);
        for (place, _) in shard.mask.indexed_iter().filter(|(_, m)| **m) {
            let at = [f, place.0, place.1];
            let wanted = f64::from(shard.wanted[at]);
            net_sum += (made.values()[at] - wanted).powi(2);
            raw_sum += (raw.values()[at] - wanted).powi(2);
            inside += 1.0;
        }
        errors.push([net_sum / inside, raw_sum / inside]);
    }
    let mean_raw = errors.iter().map(|e| e[1]).sum::<f64>() / 12.0;
    let part =
        |k: usize| errors.iter().map(|e| e[k] / (e[1] + 0.02 * mean_raw)).sum::<f64>() / 12.0;
    let (of_net, of_raw) = (part(0), part(1));
    let best = trainer.best().unwrap().held_out_error;
    assert!((of_net - best).abs() < 1e-4 * best, "{of_net} {best}");
    // raw images are half as large as wanted, and noisy: a net that may learn these frames
    // by heart must at least find the factor
    assert!(of_net < 0.1 * of_raw, "{of_net} {of_raw}");
}

/// Frames in which nothing touches are no examples, and do not change what the others count.
#[test]
fn quiet_frames_are_passed_over() {
    let touched = shard(6, 16);
    let alone = Examples::new(std::slice::from_ref(&touched), 1).unwrap();
    let mut quiet = touched.clone();
    for images in [&mut quiet.raw, &mut quiet.wanted] {
        images.mapv_inplace(|v| 1e-3 * v);
    }
    let both = Examples::new(&[touched, quiet], 1).unwrap();
    assert_eq!((alone.len(), both.len()), (6, 6));
    let shape = UnetShape { history: 1, width: 2, depth: 1 };
    let parameters = weights(shape, [16, 16]).parameters;
    let error = |examples: &Examples| {
        let mut steps = Engine::Own.start(shape, [16, 16], 1).unwrap();
        steps.load(&parameters).unwrap();
        steps.error(examples, &[0, 1, 2, 3, 4, 5]).unwrap()
    };
    // the mean over twice the frames is half as large: a fiftieth becomes a hundredth
    let (alone, both) = (error(&alone), error(&both));
    assert!(both > alone && both < 1.02 * alone, "{alone} {both}");
}

/// Learning from turned examples is learning from other ones: the curve differs, and a net that saw
/// only one side of the skin is better on the other: measured 0.003 against 0.2 of the raw images' error.
#[test]
fn turned_examples_teach_the_other_sides_of_the_skin() {
    let shape = UnetShape { history: 1, width: 6, depth: 2 };
    let settings = TrainSettings { shape, epochs: 150, rate: 5e-3, ..settings() };
    let half = RasterSymmetry::of_matrix([[-1.0, 0.0], [0.0, -1.0]]).unwrap();
    let seen = shard(12, 16);
    let mut other = seen.clone();
    for images in [&mut other.raw, &mut other.wanted] {
        images.invert_axis(Axis(1));
        images.invert_axis(Axis(2));
    }
    let unseen = Examples::new(&[other], 1).unwrap();
    let error = |turns: &[RasterSymmetry]| {
        let train =
            Examples::new(std::slice::from_ref(&seen), 1).unwrap().augmented(turns).unwrap();
        let mut trainer = Trainer::new(&settings, "base").unwrap();
        while trainer.status() == TrainStatus::Running {
            trainer.epoch(&train, &unseen, 2, &mut go_on).unwrap();
        }
        trainer.curve().last().unwrap().held_out_error
    };
    let (plain, turned) = (error(&[]), error(&[RasterSymmetry::default(), half]));
    assert!(turned < 0.2 * plain, "{turned} {plain}");
}

#[test]
fn a_resumed_training_ends_with_the_bits_of_an_uninterrupted_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.safetensors");
    let (train, held_out) = (shard(10, 16), shard(3, 16));
    let quarter = RasterSymmetry::of_matrix([[0.0, -1.0], [1.0, 0.0]]).unwrap();
    let turns = [RasterSymmetry::default(), quarter];
    let train = Examples::new(&[train], 2).unwrap().augmented(&turns).unwrap();
    let held_out = Examples::new(&[held_out], 2).unwrap();
    let settings = settings();
    let finish = |mut trainer: Trainer, threads: usize| {
        while trainer.status() == TrainStatus::Running {
            trainer.epoch(&train, &held_out, threads, &mut go_on).unwrap();
        }
        let bits = trainer.weights("s", [16, 16], BTreeMap::new()).parameters;
        (bits.iter().map(|w| w.to_bits()).collect::<Vec<_>>(), trainer.curve().to_vec())
    };
    let wanted = finish(Trainer::new(&settings, "base").unwrap(), 1);
    assert_eq!(wanted.1.len(), 6);
    assert_eq!(finish(Trainer::new(&settings, "base").unwrap(), 3), wanted, "threads");

    let mut trainer = Trainer::new(&settings, "base").unwrap();
    for _ in 0..2 {
        trainer.epoch(&train, &held_out, 2, &mut go_on).unwrap();
    }
    trainer.save(&path).unwrap();
    // an epoch that is broken off leaves no trace
    let mut stop = |step: usize, _: usize| match step {
        2 => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    };
    assert_eq!(trainer.epoch(&train, &held_out, 1, &mut stop).unwrap(), None);
    assert_eq!(finish(trainer, 1), wanted, "broken off");
    assert_eq!(finish(Trainer::resume(&path, &settings, "base").unwrap(), 1), wanted, "resumed");

    let says = |settings: &TrainSettings, base: &str, text: &str| {
        let message = Trainer::resume(&path, settings, base).unwrap_err().to_string();
        assert!(message.contains(text), "{message}");
    };
    says(&settings, "other", "the learning base is base there, but other here");
    says(&TrainSettings { rate: 1e-3, ..settings.clone() }, "base", "the training is");
    let bytes = std::fs::read(&path).unwrap();
    for end in [0, 7, 100, bytes.len() / 2, bytes.len() - 1] {
        std::fs::write(&path, &bytes[..end]).unwrap();
        says(&settings, "base", "damaged");
    }
}

#[test]
fn training_stops_early_and_refuses_what_cannot_be() {
    let examples = Examples::new(&[shard(4, 16)], 2).unwrap();
    // a rate too small to change anything: never better than the first epoch
    let still = TrainSettings { rate: 1e-30, patience: 2, ..settings() };
    let mut trainer = Trainer::new(&still, "base").unwrap();
    while trainer.status() == TrainStatus::Running {
        trainer.epoch(&examples, &examples, 1, &mut go_on).unwrap();
    }
    assert_eq!((trainer.status(), trainer.curve().len()), (TrainStatus::Stopped, 3));

    let refused = |settings: TrainSettings, text: &str| {
        let message = Trainer::new(&settings, "base").unwrap_err().to_string();
        assert!(message.contains(text), "{message}");
    };
    refused(TrainSettings { rate: f64::NAN, ..settings() }, "rate is NaN");
    refused(TrainSettings { batch: 0, ..settings() }, "batch is 0");
    let shape = UnetShape { width: 0, ..settings().shape };
    refused(TrainSettings { shape, ..settings() }, "width is 0");
    let mut trainer = Trainer::new(&settings(), "base").unwrap();
    let single = Examples::new(&[shard(4, 16)], 1).unwrap();
    let error = trainer.epoch(&single, &single, 1, &mut go_on).unwrap_err();
    assert_eq!(error, DenoiseError::WrongLength { what: "frames an example", found: 1, wanted: 2 });
    assert!(trainer.epoch(&examples, &examples, 0, &mut go_on).is_err());
    let lost = TrainSettings { rate: 1e300, ..settings() };
    let error = Trainer::new(&lost, "base").unwrap().epoch(&examples, &examples, 1, &mut go_on);
    assert!(error.is_err());
    assert!(matches!(Examples::new(&[], 1), Err(DenoiseError::NothingToLearn { .. })));
}

fn base_settings() -> BaseSettings {
    let (skin, recipe) = ("a skin".to_owned(), "bells".to_owned());
    BaseSettings { skin, pixels: [16, 16], seed: 3, shards: 3, recipe }
}

fn filled(folder: &Path) -> LearningBase {
    let mut base = LearningBase::create(folder, &base_settings()).unwrap();
    for index in base.missing() {
        base.write(index, &shard(2 + index, 16)).unwrap();
    }
    base
}

#[test]
fn a_base_goes_on_where_it_was_killed() {
    let folder = tempfile::tempdir().unwrap();
    let mut base = LearningBase::create(folder.path(), &base_settings()).unwrap();
    assert_eq!(base.missing(), [0, 1, 2]);
    base.write(1, &shard(3, 16)).unwrap();
    // killed after a shard was in its place, before the manifest was: it is made again
    std::fs::write(folder.path().join("shard-00002.safetensors"), b"half").unwrap();
    let base = LearningBase::create(folder.path(), &base_settings()).unwrap();
    assert_eq!(base.missing(), [0, 2]);
    assert!(base.read(2).unwrap_err().to_string().contains("not made yet"));
    let base = filled(folder.path());
    assert!(base.missing().is_empty());
    assert_eq!(base.frames(), 2 + 3 + 4);
    assert_eq!(base.read(1).unwrap(), shard(3, 16));
    let whole = tempfile::tempdir().unwrap();
    assert_eq!(filled(whole.path()).checksum().unwrap(), base.checksum().unwrap());

    // a shard that lost its end, and one that lost a bit
    let path = folder.path().join("shard-00001.safetensors");
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() - 5]).unwrap();
    let message = base.read(1).unwrap_err().to_string();
    assert!(message.contains(&format!("{} bytes with checksum", bytes.len() - 5)), "{message}");
    let mut changed = bytes.clone();
    changed[500] ^= 1;
    std::fs::write(&path, &changed).unwrap();
    assert_eq!(base.missing(), [1]);
    assert!(filled(folder.path()).missing().is_empty());
    assert_eq!(std::fs::read(&path).unwrap(), bytes);
}

#[test]
fn a_base_refuses_other_settings_and_empty_pairs() {
    let folder = tempfile::tempdir().unwrap();
    let mut base = filled(folder.path());
    let other = BaseSettings { seed: 4, ..base_settings() };
    let message = LearningBase::create(folder.path(), &other).unwrap_err().to_string();
    assert!(message.contains("the seed is 3 there, but 4 here"), "{message}");
    let none = BaseSettings { shards: 0, ..base_settings() };
    assert!(LearningBase::create(folder.path(), &none).is_err());
    assert!(base.write(3, &shard(2, 16)).is_err());
    assert!(matches!(base.write(0, &shard(2, 20)), Err(DenoiseError::ShapeMismatch { .. })));
    std::fs::write(folder.path().join("manifest.json"), b"{ \"version\": 1").unwrap();
    let message = LearningBase::open(folder.path()).unwrap_err().to_string();
    assert!(message.contains("manifest.json: damaged"), "{message}");
    assert!(LearningBase::open(&folder.path().join("nowhere")).is_err());

    let stack = |frames: usize, value: f64| {
        ImageStack::new(Array3::from_elem((frames, 16, 16), value), disc(16, 16)).unwrap()
    };
    let refused = |raw: &ImageStack, wanted: &ImageStack| Shard::new(raw, wanted).unwrap_err();
    assert!(matches!(refused(&stack(2, 0.0), &stack(2, 1.0)), DenoiseError::NothingToLearn { .. }));
    assert!(matches!(refused(&stack(2, 1.0), &stack(3, 1.0)), DenoiseError::WrongLength { .. }));
}

/// `direct` for weights in files, so that both forms of the definition are one.
#[test]
fn the_definition_takes_both_kinds_of_weights() {
    let shape = UnetShape { history: 1, width: 1, depth: 1 };
    let net = weights(shape, [4, 4]);
    let planes = vec![Array2::eye(4), Array2::ones((4, 4))];
    let exact: Vec<f64> = net.parameters.iter().map(|p| f64::from(*p)).collect();
    assert_eq!(direct(&net, planes.clone()), common::direct_f64(shape, &exact, planes));
}
