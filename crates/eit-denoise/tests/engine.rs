//! Engines of training: what is refused, and burn against our kernels.
#![cfg(feature = "train")]
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs, reason = "tests")]

mod common;

use common::{shard, weights};
use eit_denoise::{DenoiseError, Engine, Examples, TrainSettings, Trainer, UnetShape};

const SHAPE: UnetShape = UnetShape { history: 2, width: 2, depth: 1 };

fn settings() -> TrainSettings {
    TrainSettings { shape: SHAPE, seed: 4, epochs: 6, batch: 4, rate: 1e-2, patience: 0 }
}

#[test]
fn engines_have_names_and_others_are_refused() {
    for engine in Engine::ALL {
        assert_eq!(engine.to_string().parse::<Engine>().unwrap(), engine);
    }
    assert_eq!(Engine::default(), Engine::Own);
    let message = "torch".parse::<Engine>().unwrap_err().to_string();
    assert_eq!(message, "no engine is called \"torch\": there are own, burn, cuda and wgpu");
}

/// What was not compiled in says how to get it, and leaves the trainer as it was.
#[test]
fn a_missing_engine_is_refused_before_any_work() {
    let mut trainer = Trainer::new(&settings(), "base").unwrap();
    let compiled = [
        (Engine::Own, true),
        (Engine::Burn, cfg!(feature = "burn")),
        (Engine::Cuda, cfg!(feature = "cuda")),
        (Engine::Wgpu, cfg!(feature = "wgpu")),
    ];
    for (engine, compiled) in compiled {
        let missing = DenoiseError::NoEngine { engine: engine.name() };
        let absent = Err(DenoiseError::NoDevice { engine: engine.name() });
        let found = trainer.set_engine(engine);
        match (engine, compiled) {
            (_, false) => {
                assert_eq!(found, Err(missing.clone()));
                assert_eq!(engine.start(SHAPE, [16, 16], 1).unwrap_err(), missing);
            }
            (Engine::Own | Engine::Burn, true) => assert_eq!(found, Ok(())),
            // whether this machine has such a device is its own affair
            (_, true) => assert!(found == Ok(()) || found == absent, "{found:?}"),
        }
    }
    let message = DenoiseError::NoEngine { engine: "cuda" }.to_string();
    assert!(message.contains("build it with --features cuda"), "{message}");
    trainer.set_engine(Engine::Own).unwrap();
    let examples = Examples::new(&[shard(4, 16)], 2).unwrap();
    let go_on = &mut |_, _| std::ops::ControlFlow::Continue(());
    assert!(trainer.epoch(&examples, &examples, 1, go_on).unwrap().is_some());
}

#[test]
fn a_stepper_refuses_what_does_not_fit() {
    let says = |error: DenoiseError, text: &str| {
        let message = error.to_string();
        assert!(message.contains(text), "{message}");
    };
    says(Engine::Own.start(SHAPE, [16, 16], 0).unwrap_err(), "threads is 0");
    let wide = UnetShape { width: 200, ..SHAPE };
    says(Engine::Own.start(wide, [16, 16], 1).unwrap_err(), "width is 200");
    let examples = Examples::new(&[shard(4, 16)], 2).unwrap();
    let mut steps = Engine::Own.start(SHAPE, [16, 16], 1).unwrap();
    says(steps.step(&examples, &[0]).unwrap_err(), "0 weights where");
    says(steps.load(&[0.0; 3]).unwrap_err(), "3 weights where");
    steps.load(&weights(SHAPE, [16, 16]).parameters).unwrap();
    says(steps.step(&examples, &[]).unwrap_err(), "a batch of none");
    says(steps.error(&examples, &[1, 4]).unwrap_err(), "the index of an example is 4");
    let single = Examples::new(&[shard(4, 16)], 1).unwrap();
    says(steps.step(&single, &[0]).unwrap_err(), "1 frames an example where 2 are wanted");
    let small = Examples::new(&[shard(4, 12)], 2).unwrap();
    says(steps.error(&small, &[0]).unwrap_err(), "12 rows and 12 columns");
    assert!(steps.step(&examples, &[3, 0]).unwrap().0 > 0.0);
}

#[cfg(feature = "burn")]
mod burn {
    use super::*;
    use common::{convolutions, disc, touched};
    use eit_denoise::{Denoiser, Epoch, ImageStack, RasterSymmetry, Shard, TrainStatus};
    use ndarray::Array3;

    /// One size that halving divides, and one that it does not.
    const CASES: [(UnetShape, [usize; 2]); 4] = [
        (UnetShape { history: 1, width: 6, depth: 3 }, [64, 64]),
        (UnetShape { history: 3, width: 4, depth: 2 }, [20, 33]),
        (UnetShape { history: 2, width: 5, depth: 1 }, [17, 9]),
        (UnetShape { history: 1, width: 3, depth: 4 }, [32, 48]),
    ];

    /// Raw images of five frames and other images of the same size as those wanted.
    fn examples(shape: UnetShape, [rows, columns]: [usize; 2]) -> Examples {
        let mask = disc(rows, columns);
        let stack = |images: Array3<f64>| ImageStack::new(images, mask.clone()).unwrap();
        let images = touched(10, &mask);
        let [raw, wanted] = [0..5, 5..10]
            .map(|frames| stack(images.select(ndarray::Axis(0), &frames.collect::<Vec<_>>())));
        Examples::new(&[Shard::new(&raw, &wanted).unwrap()], shape.history).unwrap()
    }

    /// Every parameter's derivative by burn's automatic differentiation against ours. Both add up
    /// `f32` in their own order, which measured 1e-6 of the layer's largest. Where that puts one
    /// pixel of one channel on the other side of a positive part or of a maximum, whose derivatives
    /// jump, the layers before it differ by that pixel's share: measured 3e-4 in the largest net, one
    /// of some hundred thousand decisions. 1e-3 holds both.
    #[test]
    fn derives_by_every_parameter_as_we_do() {
        for (shape, size) in CASES {
            let examples = examples(shape, size);
            let parameters = weights(shape, size).parameters;
            let batch = [4, 0, 2, 1];
            let of = |engine: Engine| {
                let mut steps = engine.start(shape, size, 1).unwrap();
                steps.load(&parameters).unwrap();
                let (sum, gradient) = steps.step(&examples, &batch).unwrap();
                (sum, gradient.to_vec())
            };
            let (own, burn) = (of(Engine::Own), of(Engine::Burn));
            assert!((own.0 - burn.0).abs() < 1e-5 * own.0, "{shape:?}: {} {}", own.0, burn.0);
            assert_eq!(burn.1.len(), own.1.len());
            let mut from = 0;
            for c in convolutions(shape) {
                for count in [c[0] * c[1] * c[2] * c[2], c[0]] {
                    let [own, burn] = [&own.1, &burn.1].map(|list| &list[from..from + count]);
                    let largest = own.iter().fold(0.0_f32, |most, d| most.max(d.abs()));
                    assert!(largest > 0.0, "{shape:?} {c:?}");
                    for (k, (own, burn)) in own.iter().zip(burn).enumerate() {
                        let off = (own - burn).abs();
                        assert!(off < 1e-3 * largest, "{shape:?} {c:?} {k}: {own} {burn}");
                    }
                    from += count;
                }
            }
            assert_eq!(from, parameters.len());
        }
    }

    /// burn's net wants what [`Denoiser`] made of the same images: what is left is the rounding of
    /// `f32` in both, below 1e-5 of the scale as for the definition (`tests/unet.rs`).
    #[test]
    fn runs_as_the_denoiser_does() {
        for (shape, size) in CASES {
            let mask = disc(size[0], size[1]);
            // values that f32 holds, since a shard does
            let images = touched(5, &mask).mapv(|v| f64::from(v as f32));
            let raw = ImageStack::new(images, mask.clone()).unwrap();
            let net = weights(shape, size);
            let made = Denoiser::new(&net, mask.view()).unwrap().denoise(&raw).unwrap();
            let error = |wanted: &ImageStack| {
                let shard = Shard::new(&raw, wanted).unwrap();
                let examples = Examples::new(&[shard], shape.history).unwrap();
                let mut steps = Engine::Burn.start(shape, size, 1).unwrap();
                steps.load(&net.parameters).unwrap();
                let one = |k: usize| steps.error(&examples, &[k]).unwrap();
                (0..5).map(one).fold(0.0_f64, f64::max).sqrt()
            };
            assert!(error(&made) < 1e-5, "{shape:?}: {}", error(&made));
            // and the comparison tells images apart
            assert!(error(&raw) > 1e-2, "{shape:?}: {}", error(&raw));
        }
    }

    fn train(trainer: &mut Trainer, examples: &Examples, epochs: usize) {
        for _ in 0..epochs {
            let go_on = &mut |_, _| std::ops::ControlFlow::Continue(());
            trainer.epoch(examples, examples, 1, go_on).unwrap();
        }
    }

    fn alike(a: &[Epoch], b: &[Epoch]) {
        assert_eq!(a.len(), b.len());
        for (a, b) in a.iter().zip(b) {
            for [a, b] in [[a.train_error, b.train_error], [a.held_out_error, b.held_out_error]] {
                assert!((a - b).abs() < 1e-5 * a, "{a} {b}");
            }
        }
    }

    /// Learning curves over six epochs of three steps: measured 1e-7 of the error, the rounding of
    /// `f32`; 1e-5 leaves room for other processors.
    #[test]
    fn learns_as_we_do_and_goes_on_from_our_checkpoint() {
        let half = RasterSymmetry::of_matrix([[-1.0, 0.0], [0.0, -1.0]]).unwrap();
        let turns = [RasterSymmetry::default(), half];
        let examples = Examples::new(&[shard(12, 16)], 2).unwrap().augmented(&turns).unwrap();
        // two channels alone may be dead from the start
        let shape = UnetShape { width: 6, ..SHAPE };
        let settings = TrainSettings { shape, ..settings() };
        let mut own = Trainer::new(&settings, "base").unwrap();
        let mut burn = own.clone();
        burn.set_engine(Engine::Burn).unwrap();
        train(&mut own, &examples, 6);
        train(&mut burn, &examples, 6);
        alike(own.curve(), burn.curve());
        let [first, last] = [&own.curve()[0], &own.curve()[5]];
        assert!(last.train_error < 0.9 * first.train_error, "{first:?} {last:?}");

        // two epochs by burn, a checkpoint, and the rest by our kernels
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("checkpoint.safetensors");
        let mut mixed = Trainer::new(&settings, "base").unwrap();
        mixed.set_engine(Engine::Burn).unwrap();
        train(&mut mixed, &examples, 2);
        mixed.save(&path).unwrap();
        let mut mixed = Trainer::resume(&path, &settings, "base").unwrap();
        train(&mut mixed, &examples, 4);
        assert_eq!(mixed.status(), TrainStatus::Done);
        alike(own.curve(), mixed.curve());
    }
}
