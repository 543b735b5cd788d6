//! Training by burn: its derivative against the definition, learning, and resuming to the same bits.
#![cfg(feature = "train")]

use crate::common::{convolutions, direct_f64, names, shard, weights};
use eit_denoise::burn::module::{Module as _, ModuleVisitor, Param};
use eit_denoise::burn::optim::GradientsParams;
use eit_denoise::burn::tensor::Tensor;
use eit_denoise::{
    DenoiseError, Denoiser, Examples, ImageStack, RasterSymmetry, Shard, TrainDevice,
    TrainSettings, TrainStatus, TrainStep, Trainer, Unet, UnetShape, Weights, weighted_errors,
};
use fixtures::Random;
use ndarray::{Array2, Array3, Axis, concatenate};
use std::collections::BTreeMap;
use std::ops::ControlFlow;

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
    let image = direct_f64(shape, parameters, planes);
    let inside = || image.iter().zip(wanted).zip(mask).filter(|(_, m)| **m);
    let sum: f64 = inside().map(|((v, w), _)| (v - w) * (v - w)).sum();
    sum / inside().count() as f64
}

/// What errors count: one over the error of the raw image or of an empty one, whichever is smaller, plus a
/// twentieth of the mean of those over the sequence, which is taken in the images' own unit.
fn factors(pairs: &[(Array3<f64>, Array2<f64>)], scales: &[f64], mask: &Array2<bool>) -> Vec<f64> {
    let reference = |(frames, wanted): &(Array3<f64>, Array2<f64>)| {
        let raw = frames.index_axis(Axis(0), frames.len_of(Axis(0)) - 1);
        let inside = || raw.iter().zip(wanted).zip(mask).filter(|(_, m)| **m);
        let of_raw = inside().map(|((v, w), _)| (v - w).powi(2)).sum::<f64>();
        let of_empty = inside().map(|((_, w), _)| w.powi(2)).sum::<f64>();
        of_raw.min(of_empty) / inside().count() as f64
    };
    let errors: Vec<f64> = pairs.iter().map(reference).collect();
    let own = errors.iter().zip(scales).map(|(e, s)| e * s * s);
    let mean = own.sum::<f64>() / errors.len() as f64;
    errors.iter().zip(scales).map(|(e, s)| 1.0 / (e + 0.05 * mean / (s * s))).collect()
}

/// Derivatives by name of tensor.
struct ByName {
    gradients: GradientsParams,
    path: Vec<String>,
    found: BTreeMap<String, Vec<f32>>,
}

impl ModuleVisitor for ByName {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.push(name.to_owned());
    }
    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let values = self.gradients.get::<D>(param.id).unwrap().into_data();
        self.found.insert(self.path.join("."), values.try_into_vec::<f32>().unwrap());
    }
}

/// Mean error of all examples by burn, and its derivatives in the order of the weights.
fn derived(start: &Weights, examples: &Examples) -> (f64, Vec<f32>) {
    let net = Unet::from_weights(start, &TrainDevice::Flex.open().unwrap()).unwrap();
    let all: Vec<usize> = (0..examples.len()).collect();
    let TrainStep { errors, gradients } = TrainStep::of(&net, examples, &all, 2).unwrap();
    let mut by_name = ByName { gradients, path: Vec::new(), found: BTreeMap::new() };
    net.visit(&mut by_name);
    let order = names(start.shape);
    assert_eq!(order.len(), by_name.found.len());
    let lists = order.iter().flat_map(|name| by_name.found[name].clone());
    (errors / all.len() as f64, lists.collect())
}

/// Central differences of the definition in `f64` along random directions within each layer, step
/// 1e-6: they are right to 1e-8; the derivative in `f32` to 1e-4, the rounding of some thousand sums.
#[test]
fn the_derivative_is_that_of_the_definition_in_every_layer() {
    for shape in [
        UnetShape { history: 1, width: 3, depth: 2, ..UnetShape::ONE_IMAGE },
        UnetShape { history: 2, width: 5, depth: 1, ..UnetShape::ONE_IMAGE },
        UnetShape { history: 3, width: 4, depth: 3, ..UnetShape::ONE_IMAGE },
    ] {
        let pixels = 16;
        // more than a thread takes at once
        let shard = shard(10, pixels);
        let examples = Examples::new(std::slice::from_ref(&shard), shape.history).unwrap();
        assert_eq!(examples.len(), 10);
        let start = weights(shape, [pixels, pixels]);
        let (error, gradient) = derived(&start, &examples);
        // the examples once more, in f64
        let mut scales = Vec::new();
        let pairs: Vec<_> = (0..10)
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
            pairs.iter().zip(&factors).map(one).sum::<f64>() / 10.0
        };
        let exact: Vec<f64> = start.parameters.iter().map(|p| f64::from(*p)).collect();
        assert!((error - error_of(&exact)).abs() < 1e-5 * error, "{shape:?}");
        let mut random = Random::new(3);
        let mut from = 0;
        // kernel and biases of each
        let counts =
            convolutions(shape).into_iter().flat_map(|c| [c[0] * c[1] * c[2] * c[2], c[0]]);
        for count in counts {
            let direction: Vec<f64> = (0..count).map(|_| random.between(-1.0, 1.0)).collect();
            let norm = direction.iter().map(|d| d * d).sum::<f64>().sqrt();
            let moved = |step: f64| {
                let mut parameters = exact.clone();
                let pairs = parameters[from..].iter_mut().zip(&direction);
                pairs.for_each(|(p, d)| *p += step * d / norm);
                error_of(&parameters)
            };
            let wanted = (moved(1e-6) - moved(-1e-6)) / 2e-6;
            let own: Vec<f64> =
                gradient[from..from + count].iter().map(|g| f64::from(*g)).collect();
            let slope = own.iter().zip(&direction).map(|(g, d)| g * d / norm).sum::<f64>();
            // relative to the length of the derivative: a direction may lie across it
            let size = own.iter().map(|g| g * g).sum::<f64>().sqrt();
            assert!(size > 0.0, "{shape:?} from {from}");
            assert!(
                (slope - wanted).abs() < 1e-4 * size,
                "{shape:?} from {from}: {slope} {wanted}"
            );
            from += count;
        }
        assert_eq!(from, exact.len());
    }
}

const SHAPE: UnetShape = UnetShape { history: 2, width: 2, depth: 1, ..UnetShape::ONE_IMAGE };

fn settings() -> TrainSettings {
    TrainSettings { seed: 4, epochs: 6, batch: 4, rate: 1e-2, patience: 0 }
}

fn net(shape: UnetShape) -> Unet {
    let device = TrainDevice::Flex.open().unwrap();
    Unet::new(shape, 4, &device).unwrap()
}

fn trainer(shape: UnetShape, settings: &TrainSettings) -> Trainer<Unet> {
    Trainer::new(net(shape), settings, "base").unwrap()
}

/// Trains to the end.
fn finish(trainer: &mut Trainer<Unet>, train: &Examples, held_out: &Examples, threads: usize) {
    while trainer.status() == TrainStatus::Running {
        trainer.epoch(train, held_out, threads, &mut go_on).unwrap();
    }
}

fn go_on(_: usize, _: usize) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// The net that was trained runs as it was trained: error of the learning curve from images that
/// went through [`Denoiser`], to the rounding of `f32`.
#[test]
fn training_lowers_the_error_of_the_net_that_runs() {
    let shard = shard(12, 16);
    let shape = UnetShape { history: 2, width: 6, depth: 2, ..UnetShape::ONE_IMAGE };
    let settings = TrainSettings { epochs: 150, rate: 5e-3, ..settings() };
    let examples = Examples::new(std::slice::from_ref(&shard), 2).unwrap();
    let mut trainer = trainer(shape, &settings);
    finish(&mut trainer, &examples, &examples, 1);
    assert_eq!(trainer.status(), TrainStatus::Done);
    let weights = trainer.weights("skin", [16, 16], &BTreeMap::new()).unwrap();
    let raw = ImageStack::new(shard.raw.mapv(f64::from), shard.mask.clone()).unwrap();
    let made = Denoiser::new(&weights, shard.mask.view()).unwrap().denoise(&raw).unwrap();
    let square = |f: usize, value: &dyn Fn([usize; 3]) -> f64| {
        let inside = shard.mask.indexed_iter().filter(|(_, m)| **m);
        let errors =
            inside.map(|((r, c), _)| value([f, r, c]) - f64::from(shard.wanted[[f, r, c]]));
        let errors: Vec<f64> = errors.collect();
        errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64
    };
    let of = |f: usize| {
        let of_raw = square(f, &|at| raw.values()[at]);
        [square(f, &|at| made.values()[at]), of_raw, of_raw.min(square(f, &|_| 0.0))]
    };
    let errors: Vec<[f64; 3]> = (0..12).map(of).collect();
    let mean = errors.iter().map(|e| e[2]).sum::<f64>() / 12.0;
    let part = |k: usize| errors.iter().map(|e| e[k] / (e[2] + 0.05 * mean)).sum::<f64>() / 12.0;
    let (of_net, of_raw) = (part(0), part(1));
    let best = trainer.best().unwrap().held_out_error;
    assert!((of_net - best).abs() < 1e-4 * best, "{of_net} {best}");
    // raw images are half as large as wanted, and noisy: a net that may learn these frames
    // by heart must at least find the factor
    assert!(of_net < 0.1 * of_raw, "{of_net} {of_raw}");
}

/// Frames in which nothing touches hardly change what the others of their sequence count, and not at all
/// what those of another sequence count.
#[test]
fn quiet_frames_count_for_little() {
    let touched = shard(6, 16);
    let alone = Examples::new(std::slice::from_ref(&touched), 1).unwrap();
    let mut quiet = touched.clone();
    for images in [&mut quiet.raw, &mut quiet.wanted] {
        images.mapv_inplace(|v| 1e-3 * v);
    }
    let other = Examples::new(&[touched.clone(), quiet.clone()], 1).unwrap();
    let join = |a: &Array3<f32>, b: &Array3<f32>| concatenate![Axis(0), a.view(), b.view()];
    let (raw, wanted) = (join(&touched.raw, &quiet.raw), join(&touched.wanted, &quiet.wanted));
    let both = Examples::new(&[Shard { raw, wanted, ..touched }], 1).unwrap();
    let net = net(UnetShape { history: 1, ..SHAPE });
    let error = |examples: &Examples| {
        assert_eq!(examples.len(), 6);
        let errors = weighted_errors(&net, examples, &[0, 1, 2, 3, 4, 5]).unwrap();
        errors.sum().into_data().try_into_vec::<f32>().unwrap()[0]
    };
    // the mean over twice the frames is half as large: a twentieth becomes a fortieth
    let (alone, both, other) = (error(&alone), error(&both), error(&other));
    assert!(both > alone && both < 1.05 * alone, "{alone} {both}");
    assert_eq!(other, alone);
}

/// Learning from turned examples is learning from other ones: the curve differs, and a net that saw
/// only one side of the skin is better on the other: measured 0.007 against 0.66 of the raw images' error.
#[test]
fn turned_examples_teach_the_other_sides_of_the_skin() {
    let shape = UnetShape { history: 1, width: 6, depth: 2, ..UnetShape::ONE_IMAGE };
    let settings = TrainSettings { epochs: 60, rate: 5e-3, ..settings() };
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
        let mut trainer = trainer(shape, &settings);
        finish(&mut trainer, &train, &unseen, 2);
        trainer.curve().last().unwrap().held_out_error
    };
    let (plain, turned) = (error(&[]), error(&[RasterSymmetry::default(), half]));
    println!("{turned:.4} with turned examples, {plain:.4} without");
    assert!(turned < 0.2 * plain, "{turned} {plain}");
}

/// A batch of ten is cut into parts of eight and two, so that threads have something to share.
#[test]
fn a_resumed_training_ends_with_the_bits_of_an_uninterrupted_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.safetensors");
    let (train, held_out) = (shard(20, 16), shard(3, 16));
    let quarter = RasterSymmetry::of_matrix([[0.0, -1.0], [1.0, 0.0]]).unwrap();
    let turns = [RasterSymmetry::default(), quarter];
    let train = Examples::new(&[train], 2).unwrap().augmented(&turns).unwrap();
    let held_out = Examples::new(&[held_out], 2).unwrap();
    let settings = TrainSettings { batch: 10, ..settings() };
    let new = || trainer(SHAPE, &settings);
    let finish = |mut trainer: Trainer<Unet>, threads: usize| {
        self::finish(&mut trainer, &train, &held_out, threads);
        let bits = trainer.weights("s", [16, 16], &BTreeMap::new()).unwrap().parameters;
        (bits.iter().map(|w| w.to_bits()).collect::<Vec<_>>(), trainer.curve().to_vec())
    };
    let wanted = finish(new(), 1);
    assert_eq!(wanted.1.len(), 6);
    assert_ne!(wanted.1[0].held_out_error, wanted.1[5].held_out_error);
    assert_eq!(finish(new(), 3), wanted, "threads");

    let mut trainer = new();
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
    // the weights of the net that takes the checkpoint over do not matter
    let device = TrainDevice::Flex.open().unwrap();
    let other = || Unet::new(SHAPE, 9, &device).unwrap();
    let resumed = Trainer::resume(&path, other(), &settings, "base").unwrap();
    assert_eq!(finish(resumed, 1), wanted, "resumed");

    let says = |net: Unet, settings: &TrainSettings, base: &str, text: &str| {
        let message = Trainer::resume(&path, net, settings, base).unwrap_err().to_string();
        assert!(message.contains(text), "{message}");
    };
    says(other(), &settings, "other", "the learning base is base there, but other here");
    let slower = TrainSettings { rate: 1e-3, ..settings.clone() };
    says(other(), &slower, "base", "the training is");
    let wide = net(UnetShape { width: 3, ..SHAPE });
    says(wide, &settings, "base", "width 2, depth 1, images 1, conditions 0, fold 1 there");
    let mut bytes = std::fs::read(&path).unwrap();
    for end in [0, 7, 100, bytes.len() / 2, bytes.len() - 1] {
        std::fs::write(&path, &bytes[..end]).unwrap();
        says(other(), &settings, "base", "damaged");
    }
    // a bit of a record
    let last = bytes.len() - 40;
    bytes[last] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    says(other(), &settings, "base", "checksum");
}

#[test]
fn training_stops_early_and_refuses_what_cannot_be() {
    let examples = Examples::new(&[shard(4, 16)], 2).unwrap();
    // a rate too small to change anything: never better than the first epoch
    let still = TrainSettings { rate: 1e-30, patience: 2, ..settings() };
    let mut stopped = trainer(SHAPE, &still);
    finish(&mut stopped, &examples, &examples, 1);
    assert_eq!((stopped.status(), stopped.curve().len()), (TrainStatus::Stopped, 3));

    let says = |error: DenoiseError, wanted: &str| {
        let said = error.to_string();
        assert!(said.contains(wanted), "{said}");
    };
    let none = TrainSettings { batch: 0, ..settings() };
    says(Trainer::new(net(SHAPE), &none, "base").err().unwrap(), "batch is 0");
    let empty = UnetShape { width: 0, ..SHAPE };
    let device = TrainDevice::Flex.open().unwrap();
    says(Unet::new(empty, 1, &device).unwrap_err(), "width is 0");
    let mut trainer = trainer(SHAPE, &settings());
    let single = Examples::new(&[shard(4, 16)], 1).unwrap();
    let error = trainer.epoch(&single, &single, 1, &mut go_on).unwrap_err();
    assert_eq!(error, DenoiseError::WrongLength { what: "frames an example", found: 1, wanted: 2 });
    assert!(trainer.epoch(&examples, &examples, 0, &mut go_on).is_err());
    let error = weighted_errors(&net(SHAPE), &examples, &[1, 4]).unwrap_err();
    says(error, "the index of an example is 4");
    assert!(weighted_errors(&net(SHAPE), &examples, &[]).is_err());
    // without automatic differentiation nothing is derived
    let mut plain = Trainer::new(net(SHAPE).valid(), &settings(), "base").unwrap();
    let error = plain.epoch(&examples, &examples, 1, &mut go_on).unwrap_err();
    says(error, "without automatic differentiation");
    let lost = TrainSettings { rate: 1e300, ..settings() };
    let mut lost = self::trainer(SHAPE, &lost);
    assert!(lost.epoch(&examples, &examples, 1, &mut go_on).is_err());
}

/// What was not compiled in says how to get it.
#[test]
fn a_missing_device_is_refused() {
    for (device, compiled) in
        [(TrainDevice::Cuda, cfg!(feature = "cuda")), (TrainDevice::Wgpu, cfg!(feature = "wgpu"))]
    {
        let missing = DenoiseError::NotBuilt { device: device.name() };
        // whether this machine has such a device is its own affair
        assert_eq!(device.open().err() == Some(missing), !compiled, "{device}");
    }
}
