//! Figures of merit on images whose figures follow from geometry or come from another program.

use crate::common::{RADIUS_M, disc, grid, target};
use eit_inverse::metrics::ChangeSign::{Decrease, Increase};
use eit_inverse::metrics::{self, Blob, Cells, GreitFigures, GreitTarget, TouchSettings};
use eit_mesh::{Raster, Surface};
use ndarray::{Array2, Axis};
use proptest::prelude::*;
use std::array::from_fn;
use std::f64::consts::PI;
use std::sync::LazyLock;

/// Disc skin of 0.1 m under 128 pixels of 1.6 mm, and its cells.
static SKIN: LazyLock<(Surface, Raster, Cells<2>)> = LazyLock::new(|| {
    let surface = disc(RADIUS_M, 40);
    let raster = Raster::new(&surface, 128).unwrap();
    let cells = Cells::of_raster(&raster);
    (surface, raster, cells)
});

fn cells() -> &'static Cells<2> {
    &SKIN.2
}

/// Values at the cells' centres.
fn image<const D: usize>(cells: &Cells<D>, value: impl Fn(f64, f64) -> f64) -> Vec<f64> {
    cells.positions_m().iter().map(|p| value(p[0], p[1])).collect()
}

fn bell(x: f64, y: f64, [cx, cy]: [f64; 2], sigma_m: f64) -> f64 {
    (-0.5 * ((x - cx).powi(2) + (y - cy).powi(2)) / sigma_m.powi(2)).exp()
}

fn distance([x, y]: [f64; 2], [cx, cy]: [f64; 2]) -> f64 {
    (x - cx).hypot(y - cy)
}

fn inside(x: f64, y: f64, centre: [f64; 2], radius_m: f64) -> bool {
    distance([x, y], centre) <= radius_m
}

fn greit(values: &[f64], cells: &Cells<2>, position_m: [f64; 2], amount: f64) -> GreitFigures<2> {
    let target = GreitTarget { position_m, amount_s_m2: amount };
    let sign = if amount > 0.0 { Increase } else { Decrease };
    metrics::greit_figures(values, cells, sign, &target).unwrap().unwrap()
}

#[test]
fn correlation_of_known_images() {
    let areas = [1.0, 2.0, 1.0];
    let cc = |x: &[f64], t: &[f64]| metrics::correlation_coefficient(x, t, &areas).unwrap();
    // (1, 2, 3) about its mean 2 is the negative of (1, 0, -1) about its mean 0
    assert!((cc(&[1.0, 2.0, 3.0], &[1.0, 0.0, -1.0]) + 1.0).abs() < 1e-15);
    // (0, 1, 0) about its mean 1/2 is even, (1, 0, -1) odd: no correlation
    assert!(cc(&[0.0, 1.0, 0.0], &[1.0, 0.0, -1.0]).abs() < 1e-15);
    assert!(cc(&[1.0; 3], &[1.0, 2.0, 3.0]).is_nan());
    let wrong = metrics::correlation_coefficient(&[1.0], &[1.0, 2.0], &[1.0]);
    refused!(wrong, WrongLength { what: "truth", found: 2, wanted: 1 });
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
    // 6 * 20^2 elements
    let wrong = metrics::position_error_m(&zero[1..], &surface, place);
    refused!(wrong, WrongLength { what: "image", found: 2399, wanted: 2400 });
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
        let short = metrics::half_maximum_centre_m(&values, areas, positions, Increase);
        refused!(short, WrongLength { found: 4, wanted: 5, .. });
    }
}

#[test]
fn relative_error_of_known_images() {
    let areas = [1.0, 4.0];
    let error = |x: &[f64], t: &[f64]| metrics::relative_error(x, t, &areas).unwrap();
    // |x - t|^2 = 1 + 4 * 1, |t|^2 = 1 + 4 * 4
    assert!((error(&[2.0, 1.0], &[1.0, 2.0]) - (5.0_f64 / 17.0).sqrt()).abs() < 1e-15);
    assert_eq!(error(&[1.0, 2.0], &[1.0, 2.0]), 0.0);
    assert_eq!(error(&[0.0; 2], &[1.0, 2.0]), 1.0);
    assert_eq!(error(&[1.0, 0.0], &[0.0; 2]), f64::INFINITY);
    assert!(error(&[0.0; 2], &[0.0; 2]).is_nan());
    assert!(error(&[f64::NAN, 0.0], &[1.0; 2]).is_nan());
    // squares of these are outside the range of doubles
    for unit in [1e-300, 1e300] {
        assert!((error(&[2.0 * unit, unit], &[unit, unit]) - 0.2_f64.sqrt()).abs() < 1e-15);
    }
    for (x, t, a) in [(1, 2, 2), (2, 1, 2), (2, 2, 1)] {
        let wrong = metrics::relative_error(&vec![1.0; x], &vec![1.0; t], &vec![1.0; a]);
        refused!(wrong, WrongLength { .. });
    }
}

/// The two images of [`similarity_is_that_of_scikit_image`].
fn similarity_images() -> [Array2<f64>; 2] {
    let wave = |i: f64, j: f64| (0.9 * i).cos() * (0.7 * j).sin();
    let image = |i, j| 0.8 * bell(i, j, [11.0, 9.0], 12_f64.sqrt()) + 0.05 * wave(i, j);
    let truth = |i, j| bell(i, j, [9.0, 11.0], 3.0);
    let [image, truth]: [&dyn Fn(f64, f64) -> f64; 2] = [&image, &truth];
    [image, truth].map(|of| Array2::from_shape_fn((24, 20), |(i, j)| of(i as f64, j as f64)))
}

/// Reference values of scikit-image 0.26.0 (NumPy 2.4.6) on the same two images `x` and `t`:
///
/// ```python
/// m, S = structural_similarity(x, t, data_range=t.max() - t.min(), gaussian_weights=True,
///                              sigma=1.5, use_sample_covariance=False, full=True)
/// ```
///
/// Its mean covers pixels with whole windows, five from the rim, and so does this test's.
#[test]
fn similarity_is_that_of_scikit_image() {
    let [image, truth] = similarity_images();
    let mask = Array2::from_elem(image.raw_dim(), true);
    let map =
        |range| metrics::structural_similarity_map(image.view(), truth.view(), mask.view(), range);
    let mean = |map: &Array2<f64>| {
        let rows = map.slice_axis(Axis(0), (5..19).into());
        rows.slice_axis(Axis(1), (5..15).into()).mean().unwrap()
    };
    let [own, wide] = [None, Some(2.0)].map(|range| map(range).unwrap().unwrap());
    // both programs sum a window in their own order: a few dozen roundings (measured 1.3e-15)
    let tolerance = 1e-13;
    assert!((mean(&own) - 0.493_138_216_753_249_04).abs() < tolerance, "{}", mean(&own));
    for (place, wanted) in [
        ((5, 5), 0.813_919_001_076_963_2),
        ((9, 11), 0.316_996_434_984_974),
        ((11, 9), 0.168_795_599_823_872_6),
        ((18, 14), 0.381_764_069_755_008_1),
    ] {
        assert!((own[place] - wanted).abs() < tolerance, "{place:?}: {}", own[place]);
    }
    assert!((mean(&wide) - 0.509_257_971_453_471_4).abs() < tolerance, "{}", mean(&wide));
}

#[test]
fn similarity_looks_at_the_mask_only() {
    let [mut image, mut truth] = similarity_images();
    let inside = |i: usize, j: usize| (i as f64 - 12.0).hypot(j as f64 - 10.0) < 8.0;
    let mask = Array2::from_shape_fn(image.raw_dim(), |(i, j)| inside(i, j));
    let score = |image: &Array2<f64>, truth: &Array2<f64>, range| {
        metrics::structural_similarity(image.view(), truth.view(), mask.view(), range)
    };
    let before = score(&image, &truth, None).unwrap().unwrap();
    let outside = |a: &mut Array2<f64>, value| {
        a.indexed_iter_mut().filter(|((i, j), _)| !inside(*i, *j)).for_each(|(_, x)| *x = value);
    };
    outside(&mut image, f64::NAN);
    outside(&mut truth, 1e6);
    assert_eq!(score(&image, &truth, None).unwrap().unwrap(), before);
    let map = metrics::structural_similarity_map(image.view(), truth.view(), mask.view(), None);
    let map = map.unwrap().unwrap();
    assert!(map.iter().zip(&mask).all(|(x, inside)| x.is_nan() != *inside));
    // constant images: no window, whole or cut, has a variance, so only the means matter
    let (x, t) = (0.4, 0.7);
    let flat = |value| Array2::from_elem(image.raw_dim(), value);
    let wanted = (2.0 * x * t + 1e-4) / (x * x + t * t + 1e-4);
    let found = score(&flat(x), &flat(t), Some(1.0)).unwrap().unwrap();
    // weights of up to 121 pixels sum to one within their rounding
    assert!((found - wanted).abs() < 1e-13, "{found} {wanted}");
    assert_eq!(score(&flat(x), &flat(t), None).unwrap(), None);
    let (image, truth) = (image.view(), truth.view());
    let nothing = Array2::from_elem(image.raw_dim(), false);
    for range in [None, Some(1.0)] {
        let none = metrics::structural_similarity(image, truth, nothing.view(), range);
        assert_eq!(none.unwrap(), None);
    }
}

#[test]
fn similarity_refuses_what_it_cannot_measure() {
    let [image, truth] = similarity_images();
    let mask = Array2::from_elem(image.raw_dim(), true);
    let score = |x: &Array2<f64>, t: &Array2<f64>, range| {
        metrics::structural_similarity(x.view(), t.view(), mask.view(), range)
    };
    for range in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        refused!(score(&image, &truth, Some(range)), OutOfRange { quantity: "data_range", .. });
    }
    let mut bad = image.clone();
    bad[(3, 4)] = f64::NAN;
    refused!(score(&bad, &truth, None), OutOfRange { .. });
    refused!(score(&image, &bad, None), OutOfRange { .. });
    let small = score(&Array2::zeros((24, 19)), &truth, None);
    refused!(small, WrongLength { what: "image", found: 19, wanted: 20 });
}

/// A disc of radius 30 mm and height 2, at the skin's centre and then off it.
#[test]
fn greit_figures_of_a_disc() {
    let cells = cells();
    for (centre, truth) in [([0.0, 0.0], [0.0, 0.0]), ([0.05, 0.02], [0.03, 0.06])] {
        let values = image(cells, |x, y| 2.0 * f64::from(inside(x, y, centre, 0.03)));
        let found = greit(&values, cells, truth, 4.0 * PI * 0.03_f64.powi(2));
        // 120 of the 1160 pixels lie on the rim, randomly in or out: sqrt(120) / 2 pixels, 0.5 %
        assert!((found.amplitude_response - 0.5).abs() < 0.005, "{found:?}");
        assert!((found.resolution - 0.3).abs() < 0.003, "{found:?}");
        // rim pixels with centres between the two circles, which differ by half a percent
        assert!(found.shape_deformation < 0.02, "{found:?}");
        assert_eq!(found.ringing, 0.0);
        assert!(distance(found.centre_m, centre) < 2e-4, "{found:?}");
        let radial = truth[0].hypot(truth[1]) - centre[0].hypot(centre[1]);
        assert!((found.position_error_m - radial).abs() < 2e-4, "{found:?}");
        // a decrease gives the same figures with the sign reversed
        let negative: Vec<f64> = values.iter().map(|x| -x).collect();
        assert_eq!(greit(&negative, cells, truth, -4.0 * PI * 0.03_f64.powi(2)), found);
    }
}

/// Of an ellipse with semi-axes `a = t b`, the fraction `2 / pi (atan sqrt t - atan 1 / sqrt t)` lies
/// outside the circle of equal area: the two curves meet at the polar angle `atan 1 / sqrt t`.
#[test]
fn greit_shape_deformation_of_ellipses() {
    let cells = cells();
    for ratio in [1.5, 2.0, 4.0_f64] {
        let (a, b) = (0.03 * ratio.sqrt(), 0.03 / ratio.sqrt());
        let within = |x: f64, y: f64| ((x - 0.02) / a).powi(2) + (y / b).powi(2) <= 1.0;
        let values = image(cells, |x, y| f64::from(within(x, y)));
        let found = greit(&values, cells, [0.02, 0.0], PI * a * b);
        let wanted = 2.0 / PI * (ratio.sqrt().atan() - ratio.sqrt().recip().atan());
        // rim pixels of 1.6 mm on either side, at random: 1 % of the set
        assert!((found.shape_deformation - wanted).abs() < 0.01, "{ratio}: {found:?} {wanted}");
        assert!((found.resolution - 0.3).abs() < 0.003, "{found:?}");
    }
}

/// The quarter amplitude set of a bell of standard deviation s has the radius `s sqrt(2 ln 4)`. A ring of
/// -v around it has the ringing `v ring area / integral of the bell over that circle`, and that integral is
/// three quarters of the whole bell.
#[test]
fn greit_figures_of_a_bell_with_a_ring() {
    let cells = cells();
    // off the grid's symmetries, where all rim errors would have the same sign
    let (sigma, v, place) = (0.012, 0.1, [0.0031, -0.0017]);
    let ring = |x: f64, y: f64| f64::from((0.05..0.06).contains(&distance([x, y], place)));
    let values = image(cells, |x, y| bell(x, y, place, sigma) - v * ring(x, y));
    let bell_amount = 2.0 * PI * sigma * sigma;
    let ring_m2 = PI * (0.06_f64.powi(2) - 0.05_f64.powi(2));
    let found = greit(&values, cells, place, bell_amount);
    // 510 pixels in the set and 1400 in the ring, of which 80 and 420 lie on the rims
    let resolution = sigma * (2.0 * 4.0_f64.ln()).sqrt() / RADIUS_M;
    assert!((found.resolution / resolution - 1.0).abs() < 0.01, "{found:?} {resolution}");
    // the tail of the bell under the ring compensates 1e-4 of it
    let ringing = v * ring_m2 / (0.75 * bell_amount);
    assert!((found.ringing / ringing - 1.0).abs() < 0.02, "{found:?} {ringing}");
    let response = 1.0 - v * ring_m2 / bell_amount;
    assert!((found.amplitude_response - response).abs() < 0.01, "{found:?} {response}");
    assert!(found.shape_deformation < 0.02, "{found:?}");
}

#[test]
fn greit_refuses_impossible_targets() {
    let cells = cells();
    let values = image(cells, |_, _| 1.0);
    let figures = |values: &[f64], position_m, amount_s_m2, sign| {
        metrics::greit_figures(values, cells, sign, &GreitTarget { position_m, amount_s_m2 })
    };
    assert_eq!(figures(&values, [0.0; 2], 1.0, Decrease).unwrap(), None);
    for (y, amount) in [(0.0, 0.0), (0.0, f64::NAN), (0.0, f64::INFINITY), (f64::NAN, 1.0)] {
        refused!(figures(&values, [0.0, y], amount, Increase), OutOfRange { .. });
    }
    refused!(figures(&values[1..], [0.0; 2], 1.0, Increase), WrongLength { .. });
    // two distant discs of equal size: nothing at their common centre
    let two = |x, y| inside(x, y, [0.07, 0.0], 0.01) || inside(x, y, [-0.07, 0.0], 0.01);
    let values = image(cells, |x, y| f64::from(two(x, y)));
    let found = figures(&values, [0.0; 2], 1.0, Increase).unwrap().unwrap();
    assert_eq!((found.ringing, found.shape_deformation), (f64::INFINITY, 1.0));
}

/// Pixels that share a side are joined, in a row or a column; pixels on a diagonal are not.
#[test]
fn blobs_are_joined_across_sides() {
    // four squares of 1 m, two triangles each
    let surface = grid(2, |i, j| [i as f64, j as f64, 0.0]);
    let pixels = Cells::of_raster(&Raster::new(&surface, 2).unwrap());
    let count = |values: &[f64]| metrics::blobs(values, &pixels, Increase, 0.5).unwrap().len();
    // row by row: a row, a column, a diagonal
    let joined = [[1.0, 1.0, 0.0, 0.0], [1.0, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, 1.0]];
    assert_eq!(joined.map(|values| count(&values)), [1, 1, 2]);
    assert_eq!([1.0, 0.0].map(|value| count(&[value; 4])), [1, 0]);
    let elements = Cells::of_surface(&surface);
    let values = [3.0, 1.5, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0];
    let found = metrics::blobs(&values, &elements, Increase, 0.5).unwrap();
    let peaks: Vec<(f64, f64)> = found.iter().map(|b| (b.peak, b.area_m2)).collect();
    assert_eq!(peaks, [(3.0, 1.0), (2.0, 0.5)]);
    // (3 (1/3, 1/3) + 1.5 (2/3, 2/3)) / 4.5, each of half a square metre
    let [x, y, z] = found[0].centre_m;
    assert!((x - 4.0 / 9.0).abs() + (y - 4.0 / 9.0).abs() < 1e-15 && z == 0.0);
}

#[test]
fn touches_are_paired_with_blobs() {
    let cells = cells();
    let truth = [[0.05, 0.0], [-0.03, 0.04], [-0.03, -0.05]];
    let shift = [[0.004, 0.0], [0.0, -0.003], [-0.003, 0.004]];
    let shown: [_; 3] = from_fn(|k| [truth[k][0] + shift[k][0], truth[k][1] + shift[k][1]]);
    let values = image(cells, |x, y| shown.iter().map(|c| bell(x, y, *c, 0.01)).sum());
    let errors = |truth: &[[f64; 2]], settings: &TouchSettings| {
        metrics::touch_position_errors_m(&values, cells, truth, settings).unwrap()
    };
    let settings = TouchSettings::default();
    let found = errors(&truth, &settings);
    assert_eq!((found.missed, found.extra), (0, 0));
    for ((error, centre), (wanted, place)) in
        found.errors_m.iter().zip(&found.centres_m).zip([0.004, 0.003, 0.005].iter().zip(&shown))
    {
        // pixels of 1.6 mm on a rim of 12 mm radius (measured: at most 0.08 mm)
        assert!((error.unwrap() - wanted).abs() < 2e-4, "{found:?}");
        assert!(distance(centre.unwrap(), *place) < 2e-4, "{found:?}");
    }
    // one touch fewer is an extra blob, one more is missed, and so is one too far away
    let count = |found: metrics::TouchErrors<2>| (found.missed, found.extra);
    assert_eq!(count(errors(&truth[..2], &settings)), (0, 1));
    let found = errors(&[truth[0], truth[1], truth[2], [0.0, 0.09]], &settings);
    assert_eq!((found.missed, found.extra, found.errors_m[3]), (1, 0, None));
    let found = errors(&truth, &TouchSettings { within_m: 0.0045, ..settings });
    assert_eq!((found.missed, found.extra), (1, 1));
    assert_eq!((found.errors_m[2], found.centres_m[2]), (None, None));
    assert_eq!(count(errors(&[], &settings)), (0, 3));
    assert_eq!(count(errors(&[[0.0; 2]; 11], &settings)), (8, 0));
    // far beyond any skin; the first distance overflows
    assert_eq!(count(errors(&[[1e200, 0.0]], &settings)), (1, 3));
    assert_eq!(count(errors(&[[1e150, 0.0], [0.0, 1e150]], &settings)), (0, 1));
    assert_eq!(count(errors(&truth, &TouchSettings { sign: Decrease, ..settings })), (3, 0));

    let refused = |truth: &[[f64; 2]], settings: TouchSettings| {
        let errors = metrics::touch_position_errors_m(&values, cells, truth, &settings);
        refused!(errors, OutOfRange { .. });
    };
    for level in [0.0, -0.1, 1.1, f64::NAN] {
        refused(&[], TouchSettings { level, ..settings });
    }
    for within_m in [-1.0, f64::NAN] {
        refused(&[], TouchSettings { within_m, ..settings });
    }
    refused(&[[0.0, f64::NAN]], settings);
}

#[test]
fn smoothness_of_known_tracks() {
    let rms = metrics::rms_second_difference_m::<2>;
    let line: Vec<_> = (0..9).map(|k| Some([0.5 * f64::from(k), -0.25 * f64::from(k)])).collect();
    assert_eq!(rms(&line), Some(0.0));
    // p(k + 1) - 2 p(k) + p(k - 1) = 2 (cos angle - 1) p(k) on a circle
    let (radius, angle) = (0.05, 0.2_f64);
    let turn = |k: i32| (f64::from(k) * angle).sin_cos();
    let circle: Vec<_> = (0..30).map(|k| Some([radius * turn(k).1, radius * turn(k).0])).collect();
    let wanted = 2.0 * radius * (1.0 - angle.cos());
    assert!((rms(&circle).unwrap() - wanted).abs() < 1e-15);
    // a gap removes the three frames that need it
    let (at, end) = (Some([0.0; 2]), Some([3.0, 4.0]));
    assert_eq!(rms(&[at, at, at, None, at, at, end]), Some((25.0_f64 / 2.0).sqrt()));
    assert_eq!([rms(&circle[..2]), rms(&[at, None, at, at])], [None, None]);
}

/// The fraction `exp(-d^2 / sigma^2)` of a bell's energy lies farther away than `d`.
#[test]
fn artefact_energy_of_a_bell() {
    let cells = cells();
    let (place, sigma) = ([0.02, -0.03], 0.012);
    let values = image(cells, |x, y| -1e-6 * bell(x, y, place, sigma));
    let energy = |touches: &[[f64; 2]], d| {
        metrics::artefact_energy(&values, cells, touches, d).unwrap().unwrap()
    };
    for d in [0.006, 0.012, 0.02] {
        let wanted = (-(d * d) / (sigma * sigma)).exp();
        // pixels of 1.6 mm on the rim, at random (measured: at most 0.007)
        assert!((energy(&[place], d) - wanted).abs() < 0.01, "{d}: {wanted}");
    }
    assert_eq!(energy(&[], 1.0), 1.0);
    assert_eq!(energy(&[place, [0.0; 2]], f64::INFINITY), 0.0);
    assert_eq!(metrics::artefact_energy(&vec![0.0; values.len()], cells, &[], 0.0).unwrap(), None);
    for (touch, d) in [([0.0; 2], -1.0), ([0.0; 2], f64::NAN), ([f64::INFINITY, 0.0], 1.0)] {
        refused!(metrics::artefact_energy(&values, cells, &[touch], d), OutOfRange { .. });
    }
    refused!(metrics::artefact_energy(&values[1..], cells, &[], 1.0), WrongLength { .. });
}

#[test]
fn elements_and_pixels_agree() {
    let (surface, raster, pixels) = &*SKIN;
    let elements = Cells::of_surface(surface);
    let place = [0.03, -0.02];
    let on_elements = image(&elements, |x, y| bell(x, y, place, 0.012));
    let mut on_pixels = vec![0.0; raster.masked_pixels().len()];
    raster.pixel_from_element().apply(&on_elements, &mut on_pixels).unwrap();
    let amount = 2.0 * PI * 0.012_f64.powi(2);
    let shown = greit(&on_pixels, pixels, place, amount);
    let target = GreitTarget { position_m: [place[0], place[1], 0.0], amount_s_m2: amount };
    let own = metrics::greit_figures(&on_elements, &elements, Increase, &target).unwrap().unwrap();
    // elements of 2.5 mm against pixels of 1.6 mm on a rim of 20 mm radius
    assert!((shown.amplitude_response - 1.0).abs() < 0.01, "{shown:?}");
    assert!((own.amplitude_response - 1.0).abs() < 0.01, "{own:?}");
    assert!((shown.resolution - own.resolution).abs() < 0.005, "{shown:?} {own:?}");
    let [x, y, _] = own.centre_m;
    assert!(distance(shown.centre_m, [x, y]) < 5e-4, "{shown:?} {own:?}");
    let integral = elements.integral(&on_elements).unwrap();
    assert!((integral / amount - 1.0).abs() < 0.01, "{integral} {amount}");
    let (areas, positions) = (raster.covered_areas_m2(), pixels.positions_m());
    let shown = metrics::half_maximum_centre_m(&on_pixels, areas, positions, Increase).unwrap();
    let own = metrics::half_amplitude_centre_m(&on_elements, surface).unwrap();
    for centre in [shown.unwrap(), own.map(|[x, y, _]| [x, y]).unwrap()] {
        // a staircase of elements and pixels on a rim of 14 mm radius
        assert!(distance(centre, place) < 6e-4, "{centre:?}");
    }
}

/// Sum of distances of the best pairing, by trying all blobs for each touch.
fn best_by_trial(touches: &[[f64; 3]], blobs: &[Blob<3>], taken: &mut Vec<bool>) -> f64 {
    let Some((touch, rest)) = touches.split_first() else { return 0.0 };
    let mut best = f64::INFINITY;
    for (k, blob) in blobs.iter().enumerate() {
        if !std::mem::replace(&mut taken[k], true) {
            let here = eit_core::vector::distance(blob.centre_m, *touch);
            best = best.min(here + best_by_trial(rest, blobs, taken));
            taken[k] = false;
        }
    }
    best
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
        let found = metrics::correlation_coefficient(&image, &truth, surface.areas_m2());
        prop_assert!((found.unwrap() - 1.0).abs() < 1e-9);
        let centre = metrics::half_amplitude_centre_m(&truth, &surface).unwrap();
        let negative: Vec<f64> = truth.iter().map(|t| -gain * t).collect();
        prop_assert_eq!(centre, metrics::half_amplitude_centre_m(&negative, &surface).unwrap());
    }

    /// The similarity is 1 for equal images, always within -1 and 1, and independent of the unit.
    #[test]
    fn similarity_is_bounded(values in prop::collection::vec(-1.0..1.0_f64, 2 * 13 * 12),
                             hole in prop::collection::vec(prop::bool::weighted(0.8), 13 * 12),
                             unit in 1e-12..1e12_f64) {
        let (x, t) = values.split_at(13 * 12);
        let [image, truth] =
            [x, t].map(|values| Array2::from_shape_vec((13, 12), values.to_vec()).unwrap());
        let mask = Array2::from_shape_vec((13, 12), hole).unwrap();
        let score = |x: &Array2<f64>, t: &Array2<f64>| {
            metrics::structural_similarity(x.view(), t.view(), mask.view(), None).unwrap()
        };
        prop_assume!(mask.iter().filter(|m| **m).count() > 1);
        let found = score(&image, &truth).unwrap();
        prop_assert!((-1.0..=1.0).contains(&found));
        prop_assert!((score(&truth, &truth).unwrap() - 1.0).abs() < 1e-12);
        // rounding of the unit, which otherwise cancels
        let scaled = score(&(&image * unit), &(&truth * unit)).unwrap();
        prop_assert!((scaled - found).abs() < 1e-10);
    }

    #[test]
    fn figures_stay_in_range(values in prop::collection::vec(
                                 prop_oneof![4 => -1.0..1.0_f64, 1 => Just(0.0),
                                             1 => Just(f64::NAN), 1 => -1e300..1e300_f64],
                                 6 * 8 * 8),
                             place in [-0.1..0.1_f64, -0.1..0.1_f64],
                             level in 0.01..1.0_f64) {
        let surface = disc(RADIUS_M, 8);
        let cells = Cells::of_surface(&surface);
        let place = [place[0], place[1], 0.0];
        let target = GreitTarget { position_m: place, amount_s_m2: 1e-3 };
        if let Some(f) = metrics::greit_figures(&values, &cells, Increase, &target).unwrap() {
            prop_assert!(f.resolution > 0.0 && f.resolution <= 1.0 + 1e-12);
            prop_assert!((0.0..=1.0 + 1e-12).contains(&f.shape_deformation));
            prop_assert!(f.ringing >= 0.0);
            prop_assert!(f.position_error_m.abs() <= 0.2);
        }
        let energy = metrics::artefact_energy(&values, &cells, &[place], 0.03).unwrap();
        prop_assert!(energy.is_none_or(|e| (0.0..=1.0).contains(&e)));
        let blobs = metrics::blobs(&values, &cells, Increase, level).unwrap();
        let area: f64 = blobs.iter().map(|b| b.area_m2).sum();
        let largest = values.iter().filter(|x| x.is_finite()).fold(0.0_f64, |m, x| m.max(*x));
        // every cell that reaches the level is in exactly one blob
        let reached = values.iter().zip(surface.areas_m2()).filter(|(x, _)| **x / largest >= level);
        let wanted: f64 = reached.map(|(_, a)| a).sum();
        prop_assert!((area - wanted).abs() <= 1e-12 * wanted);
        let settings = TouchSettings { level, ..TouchSettings::default() };
        let found = metrics::touch_position_errors_m(&values, &cells, &[place; 3], &settings);
        let found = found.unwrap();
        prop_assert_eq!(found.missed, 3 - blobs.len().min(3));
        prop_assert_eq!(found.extra, blobs.len().saturating_sub(3));
    }

    /// The pairing is the best of all permutations. Blobs are single elements that do not touch each other.
    #[test]
    fn pairing_is_the_best_of_all(chosen in prop::collection::vec(0..16_usize, 1..6),
                                  truth in prop::collection::vec(
                                      [-0.1..0.1_f64, -0.1..0.1_f64], 1..6)) {
        // every second square of every second row, so that no two squares share a side
        let at = |k: usize| 0.02 * k as f64 - 0.08;
        let cells = Cells::of_surface(&grid(8, |i, j| [at(i), at(j), 0.0]));
        let mut values = vec![0.0; 128];
        chosen.iter().for_each(|c| values[2 * (16 * (c / 4) + 2 * (c % 4))] = 1.0);
        let blobs = metrics::blobs(&values, &cells, Increase, 0.5).unwrap();
        prop_assume!(blobs.len() >= truth.len());
        let truth: Vec<[f64; 3]> = truth.iter().map(|t| [t[0], t[1], 0.0]).collect();
        let settings = TouchSettings::default();
        let found = metrics::touch_position_errors_m(&values, &cells, &truth, &settings).unwrap();
        let sum: f64 = found.errors_m.iter().map(|e| e.unwrap()).sum();
        let wanted = best_by_trial(&truth, &blobs, &mut vec![false; blobs.len()]);
        prop_assert!((sum - wanted).abs() < 1e-12, "{} {}", sum, wanted);
    }
}
