//! An image against the measurements it came from.
#![cfg(feature = "unet")]

use crate::common::disc;
use eit_denoise::DataConsistency;
use fixtures::Random;
use ndarray::{Array1, Array2};
use std::sync::LazyLock;

const MEASUREMENTS: usize = 30;

struct Known {
    mask: Array2<bool>,
    jacobian: Array2<f64>,
    image: Array2<f64>,
    differences: Vec<f64>,
    noise: Vec<f64>,
}

/// A skin of 12 x 12 pixels with a random Jacobian, an image, its differences, and the noise.
static KNOWN: LazyLock<Known> = LazyLock::new(|| {
    let mask = disc(12, 12);
    let mut random = Random::new(4);
    let inside = mask.iter().filter(|m| **m).count();
    let jacobian =
        Array2::from_shape_fn((MEASUREMENTS, inside), |_| 1e3 * random.between(-1.0, 1.0));
    let image = Array2::from_shape_fn((12, 12), |place| match mask[place] {
        true => 1e-6 * random.between(-1.0, 1.0),
        false => f64::NAN,
    });
    let pixels: Array1<f64> = image.iter().filter(|v| !v.is_nan()).copied().collect();
    let differences = jacobian.dot(&pixels).to_vec();
    let noise = (0..MEASUREMENTS).map(|k| 1e-6 * (1.0 + k as f64)).collect();
    Known { mask, jacobian, image, differences, noise }
});

fn consistency() -> DataConsistency {
    DataConsistency::new(KNOWN.jacobian.view(), &KNOWN.noise, KNOWN.mask.view()).unwrap()
}

/// Energies by the definition in `f64`; the product in `f32` over a hundred pixels is right to 1e-6
/// of the largest term, its square to 1e-5.
#[test]
fn the_energies_are_those_of_the_definition() {
    let (Known { image, differences, noise, .. }, mut consistency) = (&*KNOWN, consistency());
    let half = image.mapv(|v| 0.5 * v);
    let misfit = consistency.misfit(half.view(), differences).unwrap();
    let data: f64 = differences.iter().zip(noise).map(|(d, s)| (d / s).powi(2)).sum();
    assert!((misfit.data - data).abs() < 1e-12 * data);
    // half of a linear image leaves half of the data
    assert!((misfit.residual - 0.25 * data).abs() < 1e-5 * data);
    assert_eq!(misfit.measurements, MEASUREMENTS);
    let exact = consistency.misfit(image.view(), differences).unwrap();
    assert!(exact.residual < 1e-9 * data, "{exact:?}");
    assert!(exact.score(0.5) < 1.0);
}

#[test]
fn what_is_invented_is_not_believed_and_silence_is() {
    let (Known { image, differences, noise, .. }, mut consistency) = (&*KNOWN, consistency());
    let quiet: Vec<f64> =
        noise.iter().enumerate().map(|(k, s)| if k % 2 == 0 { *s } else { -s }).collect();
    let nothing = Array2::zeros((12, 12));
    // noise of one deviation, no image: all is left, and it is noise
    let silent = consistency.misfit(nothing.view(), &quiet).unwrap();
    assert!((silent.residual - MEASUREMENTS as f64).abs() < 1e-9 && silent.score(0.5) < 1.0);
    // a finger where nothing was measured
    assert!(consistency.misfit(image.view(), &quiet).unwrap().score(0.5) > 10.0);
    // nothing where much was measured
    let missed = consistency.misfit(nothing.view(), differences).unwrap();
    assert!((missed.score(0.5) - 2.0).abs() < 1e-12);
    // the finger turned over
    assert!(consistency.misfit(image.mapv(|v| -v).view(), differences).unwrap().score(0.5) > 7.9);
}

#[test]
fn missing_and_unused_measurements_do_not_count() {
    let Known { mask, image, .. } = &*KNOWN;
    let (mut jacobian, mut differences, mut noise) =
        (KNOWN.jacobian.clone(), KNOWN.differences.clone(), KNOWN.noise.clone());
    jacobian.row_mut(3).fill(f64::NAN);
    (noise[3], differences[3], differences[7]) = (f64::INFINITY, 1e9, f64::NAN);
    let mut consistency = DataConsistency::new(jacobian.view(), &noise, mask.view()).unwrap();
    let misfit = consistency.misfit(image.view(), &differences).unwrap();
    assert_eq!(misfit.measurements, MEASUREMENTS - 2);
    assert!(misfit.residual < 1e-9 * misfit.data);
}

#[test]
fn what_does_not_fit_is_refused() {
    let Known { mask, jacobian, image, differences, noise } = &*KNOWN;
    let new = |noise: &[f64], mask: &Array2<bool>| {
        DataConsistency::new(jacobian.view(), noise, mask.view())
    };
    refused!(new(&noise[1..], mask), WrongLength { .. });
    refused!(new(noise, &disc(10, 10)), WrongLength { .. });
    for bad in [0.0, -1.0, f64::NAN] {
        let mut noise = noise.clone();
        noise[2] = bad;
        refused!(new(&noise, mask), OutOfRange { .. });
    }
    refused!(consistency().misfit(image.view(), &differences[1..]), WrongLength { .. });
    let other = Array2::zeros((12, 11));
    refused!(consistency().misfit(other.view(), differences), ShapeMismatch { .. });
}
