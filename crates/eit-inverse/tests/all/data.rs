//! Difference data and rows of the Jacobian against their formulas and what the reconstruction makes of them.

use crate::common::{disc, jacobian, one_step, relative_difference, uniforms};
use eit_inverse::{DifferenceData, DifferenceKind, InverseError, Noser, OneStepSettings};
use fixtures::Random;
use ndarray::Array2;

/// 40 measurements; two are unused and hold invalid values.
struct Setup {
    jacobian: Array2<f64>,
    model_voltages_v: Vec<f64>,
    frame: Vec<f64>,
    reference_frame: Vec<f64>,
    used: Vec<bool>,
}

fn scene() -> Setup {
    let mut jacobian = jacobian(&disc(0.1, 4), 8);
    let mut random = Random::new(23);
    let [mut model_voltages_v, mut frame, mut reference_frame] =
        [0; 3].map(|_| uniforms(&mut random, 40, -1.3));
    let used = (0..40).map(|i| ![4, 11].contains(&i)).collect();
    (model_voltages_v[4], model_voltages_v[11]) = (0.0, f64::NAN);
    (frame[4], reference_frame[11]) = (f64::INFINITY, 0.0);
    jacobian[(11, 2)] = f64::NAN;
    Setup { jacobian, model_voltages_v, frame, reference_frame, used }
}

fn bits<'a>(values: impl IntoIterator<Item = &'a f64>) -> Vec<u64> {
    values.into_iter().map(|x| x.to_bits()).collect()
}

/// Bit for bit, because programs compare images made before and after they used these functions.
#[test]
fn differences_and_rows_are_the_formula() {
    let Setup { jacobian, model_voltages_v, frame, reference_frame, used } = scene();
    let normalised = DifferenceData::Normalised { model_voltages_v: model_voltages_v.clone() };
    for (data, kind, missing) in [
        (DifferenceData::Plain, DifferenceKind::Plain, 0.0),
        (normalised, DifferenceKind::Normalised, f64::NAN),
    ] {
        assert_eq!(data.kind(), kind);
        let is_plain = kind == DifferenceKind::Plain;
        let mut found = vec![7.0; frame.len()];
        kind.difference_into(&frame, &reference_frame, |i| used[i], missing, &mut found).unwrap();
        let formula = |i: usize| match frame[i] - reference_frame[i] {
            _ if !used[i] => missing,
            dv if is_plain => dv,
            dv => dv / reference_frame[i],
        };
        let wanted: Vec<f64> = (0..frame.len()).map(formula).collect();
        assert_eq!(bits(&found), bits(&wanted), "{kind:?}");
        let mut rows = jacobian.clone();
        data.apply_to_rows(&mut rows, Some(&used)).unwrap();
        let formula = |(i, e): (usize, usize)| match jacobian[(i, e)] {
            _ if !used[i] => 0.0,
            entry if is_plain => entry,
            entry => entry / model_voltages_v[i],
        };
        let wanted = Array2::from_shape_fn(jacobian.dim(), formula);
        assert_eq!(bits(&rows), bits(&wanted), "{kind:?}");
    }
}

/// The reconstruction's own normalisation, and plain data made from normalised ones.
#[test]
fn the_reconstruction_makes_the_same_of_a_frame() {
    let Setup { jacobian: mut rows, model_voltages_v, frame, reference_frame, used } = scene();
    let data = DifferenceData::Normalised { model_voltages_v };
    let settings =
        OneStepSettings { data: data.clone(), used: Some(used.clone()), ..Default::default() };
    let own = one_step(&rows, &Noser::default(), settings.clone());
    let (mut difference, zero) = (vec![0.0; frame.len()], vec![0.0; frame.len()]);
    let kind = data.kind();
    kind.difference_into(&frame, &reference_frame, |i| used[i], 0.0, &mut difference).unwrap();
    let taken = own.reconstructor().difference(&frame, &reference_frame).unwrap();
    let of_used = difference.iter().zip(&used).filter(|(_, used)| **used).map(|(dv, _)| dv);
    assert_eq!(bits(&taken), bits(of_used));
    data.apply_to_rows(&mut rows, Some(&used)).unwrap();
    let settings = OneStepSettings { data: DifferenceData::Plain, ..settings };
    let plain = one_step(&rows, &Noser::default(), settings);
    let wanted = own.reconstruct(&frame, &reference_frame).unwrap();
    let found = plain.reconstruct(&difference, &zero).unwrap();
    // weight / voltage * entry or entry / voltage: one rounding apart, divided by lambda^2 = 1e-3
    assert!(relative_difference(&found, &wanted) < 1e-12);
}

#[test]
fn wrong_input_is_named() {
    let Setup { mut jacobian, model_voltages_v, frame, reference_frame, used } = scene();
    let wrong = |what, found, wanted| Err(InverseError::WrongLength { what, found, wanted });
    let mut difference = vec![0.0; 40];
    let mut of = |reference: &[f64], from: usize| {
        let kind = DifferenceKind::Plain;
        kind.difference_into(&frame, reference, |_| true, 0.0, &mut difference[from..])
    };
    assert_eq!(of(&reference_frame[1..], 0), wrong("reference frame", 39, 40));
    assert_eq!(of(&reference_frame, 1), wrong("difference", 39, 40));
    let before = bits(&jacobian);
    let mut of = |model_voltages_v: &[f64], used: Option<&[bool]>| {
        let model_voltages_v = model_voltages_v.to_vec();
        DifferenceData::Normalised { model_voltages_v }.apply_to_rows(&mut jacobian, used)
    };
    assert_eq!(of(&model_voltages_v, Some(&used[1..])), wrong("used", 39, 40));
    refused!(of(&model_voltages_v, None), ZeroReference { measurement: 4, .. });
    assert_eq!(of(&[1.0; 39], None), wrong("model_voltages_v", 39, 40));
    refused!(of(&[f64::INFINITY; 40], None), ZeroReference { measurement: 0, .. });
    assert_eq!(bits(&jacobian), before, "a refusal changes nothing");
}
