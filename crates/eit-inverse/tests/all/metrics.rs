//! Figures of merit on images with known figures.

#![allow(missing_docs, clippy::unwrap_used, reason = "a test file: a panic is a failed test")]

use crate::common::{disc, target};
use eit_inverse::metrics::ChangeSign::{Decrease, Increase};
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
    // side lobes of the other sign and below half the maximum are ignored
    let lobe = target(&surface, [-0.05, 0.05], 0.02, 0.9);
    image.iter_mut().zip(&lobe).for_each(|(x, l)| *x += l);
    let error_m = metrics::position_error_m(&image, &surface, place).unwrap();
    // a staircase of elements of 0.005 m on a rim of 0.02 m radius
    assert!(error_m < 0.001, "{error_m}");
    let zero = vec![0.0; image.len()];
    assert_eq!(metrics::half_amplitude_centre_m(&zero, &surface).unwrap(), None);
    assert_eq!(metrics::position_error_m(&zero, &surface, place).unwrap(), f64::INFINITY);
    let wrong = metrics::position_error_m(&zero[1..], &surface, place).unwrap_err();
    let (what, found, wanted) = ("image", zero.len() - 1, zero.len());
    assert_eq!(wrong, InverseError::WrongLength { what, found, wanted });
}

#[test]
fn half_maximum_centre_is_weighted_by_value_and_area() {
    let positions = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [5.0, 5.0], [9.0, 9.0]];
    let areas = [1.0, 2.0, 4.0, 1.0, 1.0];
    let values = [4.0, 2.0, 1.9, -3.0, f64::NAN];
    let centre = |values: &[f64], sign| {
        metrics::half_maximum_centre_m(values, &areas, &positions, sign).unwrap()
    };
    // half of 4 counts, 1.9 does not: (4 * 1 * (0, 0) + 2 * 2 * (1, 0)) / 8
    assert_eq!(centre(&values, Increase), Some([0.5, 0.0]));
    assert_eq!(centre(&values, Decrease), Some([5.0, 5.0]));
    assert_eq!(centre(&[1.0, 2.0, 0.0, 0.0, f64::INFINITY], Decrease), None);
    assert_eq!(centre(&[f64::NAN, 0.0, -0.0, -1.0, f64::INFINITY], Increase), None);
    // values whose products with areas are outside the range of doubles
    for unit in [1e-320, 1e308] {
        let values = [unit, unit, 0.0, -unit, f64::NAN];
        assert_eq!(centre(&values, Increase), Some([2.0 / 3.0, 0.0]), "{unit:e}");
    }
    for (areas, positions) in [(&areas[1..], &positions[..]), (&areas[..], &positions[1..])] {
        let wrong = metrics::half_maximum_centre_m(&values, areas, positions, Increase);
        assert!(matches!(wrong, Err(InverseError::WrongLength { found: 4, wanted: 5, .. })));
    }
}

/// The same touch has the same position on elements and on pixels.
#[test]
fn elements_and_pixels_share_one_definition() {
    let surface = disc(0.1, 24);
    let raster = eit_mesh::Raster::new(&surface, 48).unwrap();
    let hill = |c: [f64; 3]| (-((c[0] - 0.03).powi(2) + (c[1] + 0.02).powi(2)) / 0.0008).exp();
    let image: Vec<f64> = surface.centroids().into_iter().map(hill).collect();
    let mut pixels = vec![0.0; raster.masked_pixels().len()];
    raster.pixel_from_element().apply(&image, &mut pixels).unwrap();
    let positions: Vec<[f64; 2]> =
        raster.masked_pixels().iter().map(|&[r, c]| raster.centre_m(r, c)).collect();
    let areas = raster.covered_areas_m2();
    let shown = metrics::half_maximum_centre_m(&pixels, areas, &positions, Increase).unwrap();
    let own = metrics::half_amplitude_centre_m(&image, &surface).unwrap();
    for ([x, y], who) in [(shown.unwrap(), "pixels"), (own.map(|[x, y, _]| [x, y]).unwrap(), "own")]
    {
        // a staircase of 0.004 m on a rim of 0.024 m radius (measured: 0.0005 m on pixels)
        assert!((x - 0.03).hypot(y + 0.02) < 6e-4, "{who}: {x} {y}");
    }
}

proptest! {
    #![proptest_config(fixtures::cases(64))]

    /// The correlation does not depend on contrast and offset, nor the position on the sign of the image.
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
