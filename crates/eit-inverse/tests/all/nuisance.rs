//! Nuisance parameters whitened away or solved with the image give the same image.

use crate::common::{disc, one_step, solve, with_lambda, with_noise};
use eit_inverse::{NuisanceParameters, Tikhonov};
use fixtures::Random;
use ndarray::{Array2, Axis, aview1, concatenate};

/// Small dense problem: measurements, image, nuisance parameters.
struct Problem {
    jacobian: Array2<f64>,
    nuisance: Array2<f64>,
    std: Vec<f64>,
    noise: Vec<f64>,
    data: Vec<f64>,
}

fn problem() -> Problem {
    let mut random = Random::new(11);
    Problem {
        jacobian: random.normals(30, 12),
        nuisance: random.normals(30, 5),
        std: (0..5).map(|_| 3.0 * random.uniform() + 0.1).collect(),
        noise: (0..30).map(|_| 0.2 * random.uniform() + 0.02).collect(),
        data: random.noisy(&[0.0; 30], 1.0),
    }
}

/// `argmin |W (d - A x)|^2 + |P x|^2` by normal equations and Gaussian elimination.
fn least_squares(a: &Array2<f64>, d: &[f64], weights: &[f64], precisions: &[f64]) -> Vec<f64> {
    let weighted = &a.t() * &aview1(weights).pow2();
    let normal = weighted.dot(a) + Array2::from_diag(&aview1(precisions).pow2());
    let right = weighted.dot(&aview1(d));
    solve(normal, right.insert_axis(Axis(1))).column(0).to_vec()
}

#[test]
fn taken_out_or_solved_jointly_is_the_same() {
    let p = problem();
    let [weights, precisions] =
        [&p.noise, &p.std].map(|stds| stds.iter().map(|std| 1.0 / std).collect::<Vec<f64>>());
    let image_precision = [0.7; 12];
    let joint = concatenate![Axis(1), p.jacobian, p.nuisance];
    let precisions = [&image_precision[..], &precisions].concat();
    let wanted = least_squares(&joint, &p.data, &weights, &precisions);

    let nuisance = NuisanceParameters::new(&p.nuisance, &p.std, &p.noise, None).unwrap();
    let jacobian = nuisance.whiten_jacobian(&p.jacobian).unwrap();
    let mut data = p.data.clone();
    nuisance.whiten(&mut data).unwrap();
    let image = least_squares(&jacobian, &data, &[1.0; 30], &image_precision);
    let left = &aview1(&p.data) - &p.jacobian.dot(&aview1(&image));
    let unknowns = nuisance.map_estimate(left.as_slice().unwrap()).unwrap();
    for (found, wanted) in image.iter().chain(&unknowns).zip(&wanted) {
        // normal equations of condition 1e4
        assert!((found - wanted).abs() < 1e-10 * wanted.abs().max(1.0), "{found} {wanted}");
    }
    assert!(nuisance.kept_variance().iter().all(|k| (0.0..0.1).contains(k)));
}

/// `T (N + K C K') T' = I`.
#[test]
fn whitened_data_are_white() {
    let p = problem();
    let nuisance = NuisanceParameters::new(&p.nuisance, &p.std, &p.noise, None).unwrap();
    let scaled = &p.nuisance * &aview1(&p.std);
    let covariance = Array2::from_diag(&aview1(&p.noise).pow2()) + scaled.dot(&scaled.t());
    let once = nuisance.whiten_jacobian(&covariance).unwrap();
    let twice = nuisance.whiten_jacobian(&once.t().to_owned()).unwrap();
    let error = (twice - Array2::<f64>::eye(30)).abs();
    // ratio of covariances to noise: 1e6 roundings
    assert!(error.iter().all(|error| *error < 1e-9), "{error}");
}

/// An unused measurement has no effect, whatever its value.
#[test]
fn unused_measurements_are_not_looked_at() {
    let mut p = problem();
    let used: Vec<bool> = (0..30).map(|i| i != 7).collect();
    let fresh = NuisanceParameters::new(&p.nuisance, &p.std, &p.noise, Some(&used)).unwrap();
    let mut clean = p.data.clone();
    fresh.whiten(&mut clean).unwrap();
    (p.noise[7], p.data[7]) = (f64::NAN, f64::INFINITY);
    p.nuisance.row_mut(7).fill(f64::NAN);
    let broken = NuisanceParameters::new(&p.nuisance, &p.std, &p.noise, Some(&used)).unwrap();
    broken.whiten(&mut p.data).unwrap();
    assert_eq!(clean, p.data);
    assert_eq!(p.data[7], 0.0);
    let new = |std: &[f64], used: Option<&[bool]>| {
        NuisanceParameters::new(&p.nuisance, std, &p.noise, used)
    };
    refused!(new(&p.std, None), OutOfRange { .. });
    refused!(new(&p.std[1..], Some(&used)), WrongLength { found: 4, wanted: 5, .. });
    refused!(new(&p.std, Some(&[false; 30])), NothingUsed { measurements: 30 });
}

/// With the prior of the original data, unknowns that hardly vary leave the image unchanged when whitened away,
/// and unknowns that vary leave less of it. Without `set_prior_of`, the prior would differ.
#[test]
fn the_prior_is_taken_over() {
    let surface = disc(0.1, 2);
    let jacobian = Random::new(5).normals(30, surface.triangles().len());
    let Problem { nuisance, noise, data: frame, .. } = problem();
    let reference = [0.0; 30];
    let prior = Tikhonov::new(&surface);
    let before = one_step(&jacobian, &prior, with_noise(0.4, &noise));
    let image = before.reconstruct(&frame, &reference).unwrap();
    let left = |std: f64, takes_over: bool| {
        let nuisance = NuisanceParameters::new(&nuisance, &[std; 5], &noise, None).unwrap();
        let jacobian = nuisance.whiten_jacobian(&jacobian).unwrap();
        let mut white = frame.clone();
        nuisance.whiten(&mut white).unwrap();
        let mut after = one_step(&jacobian, &prior, with_lambda(0.4));
        if takes_over {
            after.set_prior_of(&before).unwrap();
        }
        after.reconstruct(&white, &reference).unwrap()
    };
    let off = |std: f64, takes_over: bool| {
        ((left(std, takes_over) - &image).pow2().sum() / image.pow2().sum()).sqrt()
    };
    // a deviation of 1e-9 of the noise leaves its square; the rest is rounding
    assert!(off(1e-9, true) < 1e-10);
    let [taken_over, same_lambda] = [true, false].map(|takes_over| off(10.0, takes_over));
    // 5 of 30 directions are removed, a sixth of the image's energy
    assert!((0.1..0.8).contains(&taken_over), "{taken_over}");
    assert!((taken_over - same_lambda).abs() > 1e-3, "{taken_over} {same_lambda}");
}
