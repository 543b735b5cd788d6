//! Figures of merit on images whose figures are known.

#![allow(missing_docs, clippy::unwrap_used, reason = "a test file: a panic is a failed test")]

mod common;

use common::{disc, target};
use eit_inverse::{InverseError, metrics};
use proptest::prelude::*;

#[test]
fn correlation_of_known_images() {
    let areas = [1.0, 2.0, 1.0];
    let cc = |x: &[f64], t: &[f64]| metrics::correlation_coefficient(x, t, &areas).unwrap();
    // (1, 2, 3) about its mean 2 is the negative of (1, 0, -1) about its mean 0
    assert!((cc(&[1.0, 2.0, 3.0], &[1.0, 0.0, -1.0]) + 1.0).abs() < 1e-15);
    // (0, 1, 0) about its mean 1/2 is even, (1, 0, -1) odd: no correlation
    assert!(cc(&[0.0, 1.0, 0.0], &[1.0, 0.0, -1.0]).abs() < 1e-15);
    assert!(cc(&[1.0; 3], &[1.0, 2.0, 3.0]).is_nan());
    assert_eq!(
        metrics::correlation_coefficient(&[1.0], &[1.0, 2.0], &[1.0]).unwrap_err(),
        InverseError::WrongLength { what: "truth", found: 2, wanted: 1 }
    );
}

#[test]
fn positions_of_known_images() {
    let surface = disc(0.1, 20);
    let place = [0.03, -0.02, 0.0];
    let mut image = target(&surface, [place[0], place[1]], 0.02, -2.0);
    // side lobes of the other sign and below half do not count
    let lobe = target(&surface, [-0.05, 0.05], 0.02, 0.9);
    image.iter_mut().zip(&lobe).for_each(|(x, l)| *x += l);
    let error_m = metrics::position_error_m(&image, &surface, place).unwrap();
    // a staircase of elements of 0.005 m on a rim of 0.02 m radius
    assert!(error_m < 0.001, "{error_m}");
    let peak = image.iter().position(|&x| x < -1.0).unwrap();
    image[peak] = -3.0;
    let centroid = surface.centroids()[peak];
    assert_eq!(metrics::peak_position_m(&image, &surface).unwrap(), Some(centroid));
    let zero = vec![0.0; image.len()];
    assert_eq!(metrics::peak_position_m(&zero, &surface).unwrap(), None);
    assert_eq!(metrics::half_amplitude_centre_m(&zero, &surface).unwrap(), None);
    assert_eq!(metrics::position_error_m(&zero, &surface, place).unwrap(), f64::INFINITY);
    let wrong = metrics::position_error_m(&zero[1..], &surface, place).unwrap_err();
    let (what, found, wanted) = ("image", zero.len() - 1, zero.len());
    assert_eq!(wrong, InverseError::WrongLength { what, found, wanted });
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 64,
        failure_persistence: None,
        ..Default::default()
    })]

    /// Contrast and offset are no part of the correlation; the sign of the image is no part of
    /// its position.
    #[test]
    fn figures_are_free_of_contrast(gain in 0.01..100.0_f64, offset in -10.0..10.0_f64,
                                    x in -0.06..0.06_f64, y in -0.06..0.06_f64) {
        let surface = disc(0.1, 8);
        let truth = target(&surface, [x, y], 0.03, 1.0);
        let image: Vec<f64> = truth.iter().map(|t| gain * t + offset).collect();
        let found =
            metrics::correlation_coefficient(&image, &truth, surface.areas_m2()).unwrap();
        prop_assert!((found - 1.0).abs() < 1e-9);
        let centre = metrics::half_amplitude_centre_m(&truth, &surface).unwrap();
        let negative: Vec<f64> = truth.iter().map(|t| -gain * t).collect();
        prop_assert_eq!(centre, metrics::half_amplitude_centre_m(&negative, &surface).unwrap());
    }
}
