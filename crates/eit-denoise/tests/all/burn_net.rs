//! The U-net as a module of burn against the one that runs on frames, and their common file.
#![cfg(feature = "burn")]

use crate::common;
use crate::common::{CASES, disc, names, touched, weights};
use eit_denoise::burn::module::Module as _;
use eit_denoise::burn::store::{ModuleSnapshot as _, SafetensorsStore};
use eit_denoise::burn::tensor::Device;
use eit_denoise::{Denoiser, ImageStack, TrainDevice, Unet, UnetShape, Weights, images_through};
use std::collections::BTreeMap;

fn flex() -> Device {
    TrainDevice::Flex.open().unwrap()
}

/// Images as a burn net makes them, against the denoiser's: the largest difference as a part of the largest value is the
/// rounding of `f32`, added up in another order through eleven layers, as for the definition (`unet.rs`).
fn are_alike(made: &ImageStack, wanted: &ImageStack, case: &str) {
    assert!(made.max_abs() > 0.0, "{case}");
    let both = made.values().into_iter().zip(wanted.values()).filter(|(a, _)| a.is_finite());
    let off = both.fold(0.0_f64, |most, (a, b)| most.max((a - b).abs())) / wanted.max_abs();
    assert!(off < 1e-5, "{case}: {off}");
}

#[test]
fn makes_the_images_of_the_denoiser() {
    let shipped = Weights::paper_disc().unwrap();
    let cases = CASES.map(|(shape, size)| weights(shape, size)).into_iter();
    for weights in cases.chain([shipped.clone()]) {
        let mask = disc(weights.pixels[0], weights.pixels[1]);
        let mut images = touched(5, &mask);
        // the frame in between is an untouched skin
        images.index_axis_mut(ndarray::Axis(0), 2).zip_mut_with(&mask, |v, inside| {
            *v = if *inside { 0.0 } else { f64::NAN };
        });
        let raw = ImageStack::new(images, mask.clone()).unwrap();
        let wanted = Denoiser::new(&weights, mask.view()).unwrap().denoise(&raw).unwrap();
        let net = Unet::from_weights(&weights, &flex()).unwrap();
        are_alike(&images_through(&net, &raw).unwrap(), &wanted, &format!("{:?}", weights.shape));
    }
    // and the comparison tells nets apart
    let mut other = shipped.clone();
    other.parameters[0] += 0.1;
    let mask = disc(64, 64);
    let raw = ImageStack::new(touched(2, &mask), mask.clone()).unwrap();
    let [a, b] = [&other, &shipped]
        .map(|w| Denoiser::new(w, mask.view()).unwrap().denoise(&raw).unwrap().max_abs());
    assert!((a / b - 1.0).abs() > 1e-4);
}

/// Nets of several images and conditions, folded and not, on sizes that folding does not divide.
#[cfg(feature = "base")]
#[test]
fn makes_the_images_of_the_denoiser_from_several_inputs() {
    use eit_denoise::{Beside, shard_through};
    for (fold, pixels) in [(1, 20), (2, 32), (2, 21)] {
        let shape = UnetShape { history: 2, width: 4, depth: 2, images: 2, conditions: 1, fold };
        let weights = weights(shape, [pixels; 2]);
        let mut shard = common::shard(4, pixels);
        let conditions = ndarray::Array2::from_shape_fn((4, 1), |(f, _)| 0.2 * f as f32);
        let other = shard.raw.mapv(|v| 3.0 * v.abs());
        // before the raw images, where it sets the scale, or behind them
        let (first, images) =
            if pixels == 32 { (Some(other), vec![]) } else { (None, vec![other]) };
        shard.beside = Beside { first, images, conditions: Some(conditions) };
        let wanted = shard.denoise(&mut Denoiser::new(&weights, shard.mask.view()).unwrap());
        let net = Unet::from_weights(&weights, &flex()).unwrap();
        let made = shard_through(&net, &shard).unwrap();
        are_alike(&made, &wanted.unwrap(), &format!("fold {fold}, {pixels} pixels"));
        let raw = ImageStack::new(shard.raw.mapv(f64::from), shard.mask.clone()).unwrap();
        assert!(images_through(&net, &raw).is_err(), "one image where the net wants two");
    }
}

/// The shipped file through burn's store and back: the same bits, names, metadata. The model error is not the
/// net's and stays behind.
#[test]
fn both_read_and_write_one_file() {
    let device = flex();
    let shipped = Weights::paper_disc().unwrap();
    let net = Unet::from_bytes(&shipped.to_bytes().unwrap(), &device).unwrap();
    assert_eq!(net.shape(), shipped.shape);
    assert_eq!(net.num_params(), shipped.parameters.len());
    let back = net.to_weights(&shipped.skin, shipped.pixels, &shipped.about).unwrap();
    assert!(back.model_error.is_none());
    assert!(Weights { model_error: shipped.model_error.clone(), ..back } == shipped);
    for (shape, size) in CASES {
        let mut weights = weights(shape, size);
        weights.about.insert("seed".to_owned(), "7".to_owned());
        let net = Unet::from_weights(&weights, &device).unwrap();
        let bytes = net.to_bytes(&weights.skin, size, &weights.about).unwrap();
        assert_eq!(Weights::from_bytes(&bytes).unwrap(), weights);
        assert_eq!(bytes.len(), weights.to_bytes().unwrap().len());
    }
    // another program of burn, which knows our file only by its tensors
    let mut net = Unet::new(shipped.shape, 1, &device).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("w.safetensors");
    std::fs::write(&path, shipped.to_bytes().unwrap()).unwrap();
    let applied = net.load_from(&mut SafetensorsStore::from_file(&path)).unwrap();
    let mut found = applied.applied.clone();
    let mut wanted = names(shipped.shape);
    found.sort();
    wanted.sort();
    assert_eq!(found, wanted);
    assert_eq!(
        net.to_weights("", [1, 1], &BTreeMap::new()).unwrap().parameters,
        shipped.parameters
    );
}

#[test]
fn bad_files_and_sizes_are_refused() {
    let device = flex();
    let good =
        weights(UnetShape { history: 1, width: 2, depth: 1, ..UnetShape::ONE_IMAGE }, [16, 16]);
    let bytes = good.to_bytes().unwrap();
    for end in [0, 8, 100, bytes.len() / 2, bytes.len() - 1] {
        refused!(Unet::from_bytes(&bytes[..end], &device), Format { .. });
    }
    let mut lost = good.clone();
    lost.parameters[3] = f32::NAN;
    refused!(Unet::from_weights(&lost, &device), NonFiniteWeight { index: 3, .. });
    let net = Unet::from_weights(&good, &device).unwrap();
    let about = BTreeMap::from([("width".to_owned(), "3".to_owned())]);
    let error = net.to_bytes("s", [16, 16], &about).unwrap_err().to_string();
    assert!(error.contains("\"width\" belongs to the format"), "{error}");
    for (shape, text) in [
        (UnetShape { history: 0, ..UnetShape::ONE_IMAGE }, "history is 0"),
        (UnetShape { width: 200, ..UnetShape::ONE_IMAGE }, "width is 200"),
        (UnetShape { depth: 7, ..UnetShape::ONE_IMAGE }, "depth is 7"),
    ] {
        let error = Unet::new(shape, 1, &device).unwrap_err().to_string();
        assert!(error.contains(text), "{error}");
    }
}

/// The seed alone determines the first weights.
#[test]
fn the_same_seed_gives_the_same_net() {
    let of = |seed| {
        let net = Unet::new(CASES[2].0, seed, &flex()).unwrap();
        net.to_weights("", [1, 1], &BTreeMap::new()).unwrap()
    };
    assert_eq!(of(5), of(5));
    assert_ne!(of(5), of(6));
    assert_eq!(of(5).shape, CASES[2].0);
}
