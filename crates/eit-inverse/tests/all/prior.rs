//! Priors: their matrices, their limits under refinement, their independence of the mesh.

#![allow(missing_docs, clippy::unwrap_used, reason = "a test file: a panic is a failed test")]

use crate::common::{disc, equilateral, grid, jacobian, relative_difference, target};
use eit_inverse::{
    Gaussian, GaussianSettings, InverseError, Laplace, LaplaceSettings, Noser, OneStepGaussNewton,
    OneStepSettings, Prior, Tikhonov,
};
use eit_mesh::{Raster, Surface};
use fixtures::Random;
use ndarray::{Array1, Array2, array};

fn laplace(surface: &Surface, length_m: f64) -> Laplace {
    Laplace::new(surface, &LaplaceSettings { correlation_length_m: Some(length_m) }).unwrap()
}

fn gaussian(surface: &Surface, length_m: f64) -> Gaussian {
    Gaussian::new(surface, &GaussianSettings { length_m: Some(length_m) }).unwrap()
}

/// Returns `P` from its product with the identity.
fn covariance(prior: &dyn Prior, elements: usize) -> Array2<f64> {
    prior.covariance_times(Array2::eye(elements).view()).unwrap()
}

/// Returns the smallest and largest eigenvalue of a symmetric matrix.
fn eigenvalue_range(matrix: &Array2<f64>) -> [f64; 2] {
    let n = matrix.nrows();
    let values = faer::Mat::from_fn(n, n, |i, j| matrix[(i, j)])
        .self_adjoint_eigenvalues(faer::Side::Lower)
        .unwrap();
    [values[0], values[n - 1]]
}

#[test]
fn tikhonov_variance_is_inverse_to_area() {
    let surface = disc(0.1, 3);
    let matrix = covariance(&Tikhonov::new(&surface), surface.areas_m2().len());
    let mean = surface.areas_m2().iter().sum::<f64>() / surface.areas_m2().len() as f64;
    let expected =
        Array2::from_diag(&Array1::from_iter(surface.areas_m2().iter().map(|a| mean / a)));
    assert!(relative_difference(&matrix, &expected) < 1e-15);
}

#[test]
fn noser_is_free_of_scale_and_survives_an_element_that_nothing_senses() {
    let mut jacobian = Random::new(1).normals(6, 9);
    jacobian.column_mut(4).fill(0.0);
    let prior = Noser::default();
    let one = prior.covariance_times(jacobian.view()).unwrap();
    // entries whose squares underflow or overflow; the shape of J P must not change
    for unit in [1e-200, 1e-3, 1e150] {
        let other = prior.covariance_times((&jacobian * unit).view()).unwrap();
        let (one, other) = (&one / one[(0, 0)], &other / other[(0, 0)]);
        assert!(relative_difference(&other, &one) < 1e-12, "at {unit:e}");
    }
    let inverse = OneStepGaussNewton::new(&jacobian, &prior, OneStepSettings::default()).unwrap();
    let image = inverse.reconstruct(&[1.0, -1.0, 2.0, 0.5, 0.0, 3.0], &[0.0; 6]).unwrap();
    assert_eq!(image[4], 0.0);
    assert!(image.iter().all(|x| x.is_finite()));
}

#[test]
fn noser_of_full_exponent_follows_an_element_s_unit() {
    // exponent 1: with another unit of conductivity in an element, its image is in that unit
    let jacobian = Random::new(2).normals(5, 8);
    let units = array![1.0, 10.0, 0.1, 3.0, 1.0, 7.0, 0.5, 2.0];
    let prior = Noser { exponent: 1.0 };
    let image = |j: &Array2<f64>| {
        let inverse = OneStepGaussNewton::new(j, &prior, OneStepSettings::default()).unwrap();
        inverse.reconstruct(&[1.0, 2.0, -1.0, 0.0, 0.5], &[0.0; 5]).unwrap()
    };
    assert!(
        relative_difference(&(image(&(&jacobian * &units)) * &units), &image(&jacobian)) < 1e-10
    );
}

#[test]
fn laplace_precision_is_symmetric_and_inverts_its_covariance() {
    let surface = disc(0.1, 4);
    let n = surface.areas_m2().len();
    let prior = Laplace::new(&surface, &LaplaceSettings::default()).unwrap();
    let mut precision = Array2::zeros((n, n));
    for e in 0..n {
        let unit: Vec<f64> = (0..n).map(|k| f64::from(u8::from(k == e))).collect();
        precision.column_mut(e).assign(&prior.precision_times(&unit).unwrap());
    }
    assert_eq!(precision, precision.t());
    let product = precision.dot(&covariance(&prior, n));
    // condition of R: (extent / element)^2 = 64 for the stiffness times 100 for the mass
    assert!(relative_difference(&product, &Array2::eye(n)) < 1e-11);
}

#[test]
fn laplace_of_a_constant_is_its_mass() {
    let surface = disc(0.1, 5);
    let product = laplace(&surface, 0.05).precision_times(&vec![2.0; 150]).unwrap();
    let mass: Vec<f64> = surface.areas_m2().iter().map(|a| 2.0 * a / 0.0025).collect();
    // rounding of cancelling weights of about 1.7
    product.iter().zip(&mass).for_each(|(p, m)| assert!((p - m).abs() < 1e-13));
}

/// `u' R u` with a negligible mass term (1e-8 of `u^2`): the discrete Dirichlet energy.
fn energy(surface: &Surface, u: impl Fn([f64; 3]) -> f64) -> f64 {
    let values: Vec<f64> = surface.centroids().into_iter().map(u).collect();
    let product = laplace(surface, 1e4).precision_times(&values).unwrap();
    product.iter().zip(&values).map(|(p, v)| p * v).sum()
}

#[test]
fn laplace_energy_converges_to_the_dirichlet_energy() {
    // u = sin(2 x + y) on the unit parallelogram x = a + b / 2, y = b sqrt(3) / 2:
    // integral of |grad u|^2 = 5 cos^2(2 x + y); 2 x + y = 2 a + c b, c = 1 + sqrt(3) / 2
    let c = 1.0 + 0.75_f64.sqrt();
    let mean_cos = {
        // mean over a, b in [0, 1] of cos(4 a + 2 c b)
        let part = |s: f64| s.cos();
        (part(0.0) + -part(4.0) - part(2.0 * c) + part(4.0 + 2.0 * c)) / (-4.0 * 2.0 * c)
    };
    let exact = 5.0 * 0.75_f64.sqrt() * 0.5 * (1.0 + mean_cos);
    let error = |n: usize| {
        let found = energy(&equilateral(n), |x| (2.0 * x[0] + x[1]).sin());
        (found / exact - 1.0).abs()
    };
    let errors = [error(16), error(32), error(64)];
    // half an element of the rim is missing from the sum over inner edges: first order
    for pair in errors.windows(2) {
        let rate = (pair[0] / pair[1]).log2();
        assert!((rate - 1.0).abs() < 0.1, "errors {errors:?}, rate {rate}");
    }
    assert!(errors[2] < 0.01, "{errors:?}");
}

#[test]
fn laplace_is_the_same_on_a_rolled_skin() {
    // the parallelogram bent onto a cylinder of radius 1: developable, so nearly the same energy
    let n = 48;
    let flat = equilateral(n);
    let nodes: Vec<[f64; 3]> =
        flat.nodes().iter().map(|p| [p[0].sin(), p[1], p[0].cos() - 1.0]).collect();
    let rolled = Surface::new(nodes, flat.triangles().to_vec()).unwrap();
    let u = |x: f64, y: f64| (2.0 * x + y).sin();
    let on_flat = energy(&flat, |x| u(x[0], x[1]));
    let on_rolled = energy(&rolled, |x| u(x[0].atan2(x[2] + 1.0), x[1]));
    // chords of h = 1 / 48 instead of arcs: h^2 / 24 = 2e-5 relative (measured: 2.3e-5); twice that is
    // allowed
    assert!((on_rolled / on_flat - 1.0).abs() < 4e-5, "{on_rolled} {on_flat}");
}

#[test]
fn laplace_on_right_angled_triangles_is_off_by_the_documented_part() {
    let surface = grid(64, |i, j| [i as f64 / 64.0, j as f64 / 64.0, 0.0]);
    let ratios = [
        energy(&surface, |x| x[0]),
        energy(&surface, |x| x[0] + x[1]) / 2.0,
        energy(&surface, |x| x[0] - x[1]) / 2.0,
    ];
    let [low, high] = ratios.iter().fold([f64::MAX, 0.0_f64], |[l, h], &r| [l.min(r), h.max(r)]);
    // 18 % below and 34 % above; half an element of the rim (1 %) is missing from the sum
    let documented = (0.80..0.83).contains(&low) && (1.31..1.35).contains(&high);
    assert!(documented, "{ratios:?}");
}

#[test]
fn gaussian_covariance_is_as_stated() {
    let surface = disc(0.1, 12);
    let n = surface.areas_m2().len();
    for length_m in [0.01, 0.02, 0.05] {
        let matrix = covariance(&gaussian(&surface, length_m), n);
        assert!(relative_difference(&matrix, matrix.t()) < 1e-14, "symmetric");
        let [low, high] = eigenvalue_range(&matrix);
        assert!(low > -1e-13 * high, "smallest eigenvalue {low:e} of {high:e}");
        let centroids = surface.centroids();
        let mut worst = [0.0_f64; 2];
        for a in 0..n {
            assert!((matrix[(a, a)] - 1.0).abs() < 1e-12, "unit variance");
            for b in 0..n {
                let distance =
                    (0..3).map(|k| (centroids[a][k] - centroids[b][k]).powi(2)).sum::<f64>();
                let expected = (-distance / (2.0 * length_m * length_m)).exp();
                let inner = [a, b]
                    .iter()
                    .all(|&e| centroids[e][0].hypot(centroids[e][1]) < 0.1 - 1.5 * length_m);
                let error = (matrix[(a, b)] - expected).abs();
                worst[usize::from(!inner)] = worst[usize::from(!inner)].max(error);
            }
        }
        // In the interior, the lumping of elements into cells matters (elements of 0.008 m are larger than
        // a cell at l = 0.01); at the rim, half of the kernel is missing (measured: 0.016, 0.007, 0.002
        // inside; 0.07, 0.11, 0.13 at the rim).
        let inside = if length_m < 0.015 { 0.02 } else { 0.01 };
        assert!(worst[0] < inside && worst[1] < 0.15, "{length_m}: {worst:?}");
    }
}

#[test]
fn gaussian_of_a_tiny_length_is_white() {
    let surface = disc(0.1, 6);
    let n = surface.areas_m2().len();
    let matrix = covariance(&gaussian(&surface, 1e-4), n);
    assert!(relative_difference(&matrix, &Array2::eye(n)) < 1e-12);
    for length_m in [0.0, -1.0, f64::NAN, 1e-12] {
        let settings = GaussianSettings { length_m: Some(length_m) };
        let error = Gaussian::new(&surface, &settings).unwrap_err();
        assert!(matches!(error, InverseError::OutOfRange { quantity: "length_m", .. }));
    }
    let settings = LaplaceSettings { correlation_length_m: Some(-1.0) };
    assert!(matches!(Laplace::new(&surface, &settings), Err(InverseError::OutOfRange { .. })));
}

#[test]
fn gaussian_does_not_care_where_the_skin_lies() {
    let here = disc(0.1, 6);
    let far: Vec<[f64; 3]> =
        here.nodes().iter().map(|p| [p[0] - 512.0, p[1] + 64.0, p[2] + 8.0]).collect();
    let far = Surface::new(far, here.triangles().to_vec()).unwrap();
    let n = here.areas_m2().len();
    let (a, b) = (covariance(&gaussian(&here, 0.03), n), covariance(&gaussian(&far, 0.03), n));
    // at 512 m the spacing of doubles is 1e-13 m; a centroid that changes its cell through that shows as
    // lumping
    assert!(relative_difference(&a, &b) < 0.02);
}

#[test]
fn images_do_not_depend_on_the_mesh() {
    let (radius_m, electrodes, pixels) = (0.1, 16, 24);
    let truth = disc(radius_m, 23);
    let touch = Array1::from(target(&truth, [0.03, -0.04], 0.02, 1.0));
    let frame = jacobian(&truth, radius_m, electrodes).dot(&touch).to_vec();
    let reference = vec![0.0; frame.len()];
    let image = |surface: &Surface, prior: &dyn Prior| {
        let settings = OneStepSettings { hyperparameter: 0.05, ..Default::default() };
        let jacobian = jacobian(surface, radius_m, electrodes);
        let inverse = OneStepGaussNewton::new(&jacobian, prior, settings).unwrap();
        let raster = Raster::new(surface, pixels).unwrap();
        let map = inverse.on_raster(raster.pixel_from_element()).unwrap();
        let values = map.reconstruct(&frame, &reference).unwrap().to_vec();
        (raster.masked_pixels().to_vec(), values)
    };
    let (coarse, fine) = (disc(radius_m, 12), disc(radius_m, 18));
    type MakePrior = fn(&Surface) -> Box<dyn Prior>;
    let makers: [MakePrior; 4] = [
        |s| Box::new(Tikhonov::new(s)),
        |_| Box::new(Noser::default()),
        |s| Box::new(laplace(s, 0.2)),
        |s| Box::new(gaussian(s, 0.02)),
    ];
    for make in makers {
        let (prior_a, prior_b) = (make(&coarse), make(&fine));
        let (pixels_a, a) = image(&coarse, prior_a.as_ref());
        let (pixels_b, b) = image(&fine, prior_b.as_ref());
        let lookup: std::collections::HashMap<_, _> = pixels_b.into_iter().zip(b).collect();
        let [mut difference, mut size] = [0.0; 2];
        for (pixel, x) in pixels_a.iter().zip(&a) {
            let Some(y) = lookup.get(pixel) else { continue };
            difference += (x - y).powi(2);
            size += y * y;
        }
        let error = (difference / size).sqrt();
        // the elements' own size: 0.008 m and 0.0056 m shift and smear a pixel of 0.008 m; measured 1.6 %
        // (Laplace) to 2.2 % (NOSER)
        assert!(error < 0.025, "{}: {error}", prior_a.name());
    }
}
