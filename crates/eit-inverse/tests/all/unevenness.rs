//! The uneven sheet estimated from a reference frame, on linear data of a disc from a separate mesh: its
//! amplitude and map, and an even sheet when the truth is even.

use crate::common::detector::{Disc, MEASUREMENTS, SKIN, TRUTH};
use eit_inverse::{InverseError, ReferenceModel, UnevenSheet, Unevenness, metrics};
use fixtures::Random;
use ndarray::{Array1, aview1};

/// Correlation length of truth and fit.
const LENGTH_M: f64 = 0.02;

/// A Gaussian field of covariance `amplitude^2 exp(-r^2 / (2 L^2))` as a sum of waves (Shinozuka and
/// Deodatis 1991), independent of the fit's bells. Returns its value at any point.
fn field(random: &mut Random, amplitude: f64) -> impl Fn(&[f64; 3]) -> f64 + use<> {
    let mut wave = || {
        let [x, y] = [0; 2].map(|_| random.normal() / LENGTH_M);
        [x, y, random.uniform() * std::f64::consts::TAU]
    };
    let waves: Vec<[f64; 3]> = (0..400).map(|_| wave()).collect();
    move |p| {
        let value = |[x, y, phase]: &[f64; 3]| (x * p[0] + y * p[1] + phase).cos();
        amplitude * (2.0 / 400_f64).sqrt() * waves.iter().map(value).sum::<f64>()
    }
}

/// Reference voltages of a sheet `exp(field)`, to first order, each with an error of 0.1 %.
fn reference(random: &mut Random, disc: &Disc, field: &impl Fn(&[f64; 3]) -> f64) -> Vec<f64> {
    let change: Array1<f64> = disc.surface.centroids().iter().map(field).collect();
    let voltages = disc.jacobian.dot(&change) + aview1(&SKIN.model_v);
    voltages.iter().map(|v| v * (1.0 + 1e-3 * random.normal())).collect()
}

fn fit(reference_v: &[f64], used: &[bool]) -> Result<Unevenness, InverseError> {
    let error_v: Vec<f64> = SKIN.model_v.iter().map(|v| 2e-3 * v.abs()).collect();
    let model = ReferenceModel {
        jacobian: &SKIN.jacobian,
        conductivity_s: &vec![1.0; SKIN.surface.triangles().len()],
        model_v: &SKIN.model_v,
        reference_v,
        error_v: &error_v,
        // the gain to 5 %
        unknowns: &(50.0 * &SKIN.unknowns),
        used,
    };
    UnevenSheet::new(&SKIN.surface, LENGTH_M)?.fit(&model, None)
}

const ALL: [bool; MEASUREMENTS] = [true; MEASUREMENTS];

/// The amplitude is found on its grid (a factor of 2 apart), the factor of the errors is the true one (the
/// fit is told twice the true error), and the map matches the truth where currents reach: a correlation of
/// 0.7 over the whole disc, whose middle 104 voltages hardly sense at 2 cm.
#[test]
fn an_uneven_sheet_is_found() {
    for (seed, amplitude) in [(1, 0.05), (2, 0.05), (3, 0.1), (4, 0.2)] {
        let mut random = Random::new(seed);
        let field = field(&mut random, amplitude);
        let found = fit(&reference(&mut random, &TRUTH, &field), &ALL).unwrap();
        assert!((found.amplitude / amplitude).log2().abs() < 0.51, "{}", found.amplitude);
        assert_eq!(found.error_scale, 0.5);
        let truth: Vec<f64> = SKIN.surface.centroids().iter().map(&field).collect();
        let areas = SKIN.surface.areas_m2();
        let alike = metrics::correlation_coefficient(&found.log_change, &truth, areas).unwrap();
        assert!(alike > 0.7, "{alike}");
    }
}

/// An even sheet stays even: the evidence stays far below 10, the level at which the touch finder accepts
/// an uneven sheet. Chance alone gives `ln` of the number of choices tried, 3 or 4.
#[test]
fn an_even_sheet_stays_even() {
    for seed in 0..20 {
        let mut random = Random::new(100 + seed);
        let found = fit(&reference(&mut random, &TRUTH, &|_: &[f64; 3]| 0.0), &ALL).unwrap();
        assert!(found.log_evidence < 5.0, "{seed}: {} {}", found.amplitude, found.log_evidence);
    }
}

/// The gain is an unknown, and unused measurements have no effect, whatever their values.
#[test]
fn gain_and_unused_measurements_are_no_unevenness() {
    let reference_v: Vec<f64> = SKIN.model_v.iter().map(|v| 1.03 * v).collect();
    let found = fit(&reference_v, &ALL).unwrap();
    let most = found.log_change.iter().fold(0.0_f64, |most, change| most.max(change.abs()));
    assert!(found.log_evidence < 5.0 && most < 1e-3, "{} {most}", found.log_evidence);

    let mut random = Random::new(7);
    let field = field(&mut random, 0.05);
    let mut reference_v = reference(&mut random, &TRUTH, &field);
    let used: Vec<bool> = (0..MEASUREMENTS).map(|i| i % 7 != 0).collect();
    let clean = fit(&reference_v, &used).unwrap();
    reference_v.iter_mut().step_by(7).for_each(|v| *v = f64::NAN);
    let found = fit(&reference_v, &used).unwrap();
    assert_eq!(clean.log_change, found.log_change);
    assert_eq!(found.amplitude, 0.05);
}

#[test]
fn bad_input_is_refused() {
    let mut reference_v = SKIN.model_v.clone();
    reference_v[17] = f64::NAN;
    refused!(fit(&reference_v, &ALL), NonFiniteData { measurement: 17, .. });
    refused!(fit(&SKIN.model_v[1..], &ALL), WrongLength { found: 207, wanted: 208, .. });
    refused!(fit(&SKIN.model_v, &[false; MEASUREMENTS]), NothingUsed { measurements: 208 });
    assert!(UnevenSheet::new(&SKIN.surface, 0.0).is_err());
}
