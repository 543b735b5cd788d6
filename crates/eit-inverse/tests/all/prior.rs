//! Priors: their matrices, their limits under refinement, their independence of the mesh.

use crate::common::*;
use eit_core::vector::{distance, norm};
use eit_inverse::{
    Gaussian, GaussianSettings, Laplace, LaplaceSettings, Noser, OneStepSettings, Prior, Tikhonov,
};
use eit_mesh::{Raster, Surface};
use fixtures::Random;
use ndarray::{Array1, Array2, array, aview1};

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

#[test]
fn tikhonov_variance_is_inverse_to_area() {
    let surface = disc(0.1, 3);
    let areas = aview1(surface.areas_m2());
    let matrix = covariance(&Tikhonov::new(&surface), areas.len());
    let expected = Array2::from_diag(&(areas.mean().unwrap() / &areas));
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
    let inverse = one_step(&jacobian, &prior, OneStepSettings::default());
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
        let inverse = one_step(j, &prior, OneStepSettings::default());
        inverse.reconstruct(&[1.0, 2.0, -1.0, 0.0, 0.5], &[0.0; 5]).unwrap()
    };
    let found = image(&(&jacobian * &units)) * &units;
    assert!(relative_difference(&found, &image(&jacobian)) < 1e-10);
}

#[test]
fn laplace_precision_is_symmetric_and_inverts_its_covariance() {
    let surface = disc(0.1, 4);
    let n = surface.areas_m2().len();
    let prior = crate::common::laplace(&surface);
    let precision = precision(&prior, n);
    assert_eq!(precision, precision.t());
    let product = precision.dot(&covariance(&prior, n));
    // condition of R: (extent / element)^2 = 64 for the stiffness times 100 for the mass
    assert!(relative_difference(&product, &Array2::eye(n)) < 1e-11);
    // of a constant it is the mass
    let product = laplace(&surface, 0.05).precision_times(&vec![2.0; n]).unwrap();
    let mass = surface.areas_m2().iter().map(|a| 2.0 * a / 0.0025);
    // rounding of cancelling weights of about 1.7
    product.iter().zip(mass).for_each(|(p, m)| assert!((p - m).abs() < 1e-13));
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
    // mean over a, b in [0, 1] of cos(4 a + 2 c b)
    let cosines = 1.0 - 4.0_f64.cos() - (2.0 * c).cos() + (4.0 + 2.0 * c).cos();
    let exact = 5.0 * 0.75_f64.sqrt() * 0.5 * (1.0 - cosines / (4.0 * 2.0 * c));
    let u = |x: f64, y: f64| (2.0 * x + y).sin();
    let on_flat = |n: usize| energy(&equilateral(n), |x| u(x[0], x[1]));
    let errors = [16, 32, 64].map(|n| (on_flat(n) / exact - 1.0).abs());
    // half an element of the rim is missing from the sum over inner edges: first order
    for pair in errors.windows(2) {
        let rate = (pair[0] / pair[1]).log2();
        assert!((rate - 1.0).abs() < 0.1, "errors {errors:?}, rate {rate}");
    }
    assert!(errors[2] < 0.01, "{errors:?}");

    // the parallelogram bent onto a cylinder of radius 1: developable, so nearly the same energy
    let flat = equilateral(48);
    let roll = |p: &[f64; 3]| [p[0].sin(), p[1], p[0].cos() - 1.0];
    let nodes = flat.nodes().iter().map(roll).collect();
    let rolled = Surface::new(nodes, flat.triangles().to_vec()).unwrap();
    let ratio = energy(&rolled, |x| u(x[0].atan2(x[2] + 1.0), x[1])) / on_flat(48);
    // twice the effect of chords of h = 1 / 48 instead of arcs, h^2 / 24 = 2e-5 (measured: 2.3e-5)
    assert!((ratio - 1.0).abs() < 4e-5, "{ratio}");

    // on right-angled triangles it is off by the documented part
    let surface = grid(64, |i, j| [i as f64 / 64.0, j as f64 / 64.0, 0.0]);
    let ratios = [
        energy(&surface, |x| x[0]),
        energy(&surface, |x| x[0] + x[1]) / 2.0,
        energy(&surface, |x| x[0] - x[1]) / 2.0,
    ];
    let [low, high] = [f64::min, f64::max].map(|of| ratios.into_iter().fold(1.0, of));
    // 18 % below and 34 % above; half an element of the rim (1 %) is missing from the sum
    assert!((0.80..0.83).contains(&low) && (1.31..1.35).contains(&high), "{ratios:?}");
}

#[test]
fn gaussian_covariance_is_as_stated() {
    let surface = disc(0.1, 12);
    let n = surface.areas_m2().len();
    for length_m in [0.01, 0.02, 0.05] {
        let matrix = covariance(&gaussian(&surface, length_m), n);
        assert!(relative_difference(&matrix, matrix.t()) < 1e-14, "symmetric");
        let dense = faer::Mat::from_fn(n, n, |i, j| matrix[(i, j)]);
        let eigenvalues = dense.self_adjoint_eigenvalues(faer::Side::Lower).unwrap();
        let (low, high) = (eigenvalues[0], eigenvalues[n - 1]);
        assert!(low > -1e-13 * high, "smallest eigenvalue {low:e} of {high:e}");
        let centroids = surface.centroids();
        assert!(matrix.diag().iter().all(|variance| (variance - 1.0).abs() < 1e-12));
        let mut worst = [0.0_f64; 2];
        for ((a, b), found) in matrix.indexed_iter() {
            let pair = [a, b].map(|e| centroids[e]);
            let expected = (-0.5 * (distance(pair[0], pair[1]) / length_m).powi(2)).exp();
            let is_inner = |p: [f64; 3]| norm(p) < 0.1 - 1.5 * length_m;
            let worst = &mut worst[usize::from(!pair.into_iter().all(is_inner))];
            *worst = worst.max((found - expected).abs());
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
        refused!(Gaussian::new(&surface, &settings), OutOfRange { quantity: "length_m", .. });
    }
    let settings = LaplaceSettings { correlation_length_m: Some(-1.0) };
    refused!(Laplace::new(&surface, &settings), OutOfRange { .. });
}

#[test]
fn gaussian_does_not_care_where_the_skin_lies() {
    let here = disc(0.1, 6);
    let far = here.nodes().iter().map(|p| [p[0] - 512.0, p[1] + 64.0, p[2] + 8.0]).collect();
    let far = Surface::new(far, here.triangles().to_vec()).unwrap();
    let [a, b] = [here, far].map(|s| covariance(&gaussian(&s, 0.03), s.areas_m2().len()));
    // at 512 m doubles are 1e-13 m apart; a centroid that changes its cell through that shows as lumping
    assert!(relative_difference(&a, &b) < 0.02);
}

#[test]
fn images_do_not_depend_on_the_mesh() {
    let truth = disc(0.1, 23);
    let touch = Array1::from(target(&truth, [0.03, -0.04], 0.02, 1.0));
    let frame = jacobian(&truth, 16).dot(&touch).to_vec();
    let image = |surface: &Surface, prior: &dyn Prior| {
        let inverse = one_step(&jacobian(surface, 16), prior, with_lambda(0.05));
        let raster = Raster::new(surface, 24).unwrap();
        let map = inverse.on_raster(raster.pixel_from_element()).unwrap();
        let values = map.reconstruct(&frame, &[0.0; 208]).unwrap();
        (raster.masked_pixels().to_vec(), values.to_vec())
    };
    let (coarse, fine) = (disc(0.1, 12), disc(0.1, 18));
    let priors = |s: &Surface| -> [Box<dyn Prior>; 4] {
        let (laplace, gaussian) = (Box::new(laplace(s, 0.2)), Box::new(gaussian(s, 0.02)));
        [Box::new(Tikhonov::new(s)), Box::new(Noser::default()), laplace, gaussian]
    };
    for (prior_a, prior_b) in priors(&coarse).iter().zip(&priors(&fine)) {
        let (pixels_a, a) = image(&coarse, &**prior_a);
        let (pixels_b, b) = image(&fine, &**prior_b);
        let lookup: std::collections::HashMap<_, _> = pixels_b.into_iter().zip(b).collect();
        let [mut difference, mut size] = [0.0; 2];
        for (pixel, x) in pixels_a.iter().zip(&a) {
            let Some(y) = lookup.get(pixel) else { continue };
            difference += (x - y).powi(2);
            size += y * y;
        }
        let error = (difference / size).sqrt();
        // elements of 0.008 m and 0.0056 m smear a pixel of 0.008 m; measured 1.6 % (Laplace) to 2.2 % (NOSER)
        assert!(error < 0.025, "{}: {error}", prior_a.name());
    }
}
