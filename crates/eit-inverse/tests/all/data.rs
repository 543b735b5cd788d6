//! Difference data and rows of the Jacobian, compared with the written-out formulas and with what the
//! reconstruction itself does with a frame.

#![allow(missing_docs, clippy::unwrap_used, reason = "a test file: a panic is a failed test")]

use crate::common::{disc, jacobian, relative_difference};
use eit_inverse::{
    DifferenceData, DifferenceKind, InverseError, Noser, OneStepGaussNewton, OneStepSettings,
};
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
    let mut jacobian = jacobian(&disc(0.1, 4), 0.1, 8);
    let count = jacobian.nrows();
    let mut random = Random::new(23);
    let mut draw = || (0..count).map(|_| random.uniform() - 1.3).collect::<Vec<f64>>();
    let (mut model_voltages_v, mut frame, mut reference_frame) = (draw(), draw(), draw());
    let used = (0..count).map(|i| ![4, 11].contains(&i)).collect();
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
fn differences_are_the_formula() {
    let Setup { frame, reference_frame, used, .. } = scene();
    for (kind, missing) in [(DifferenceKind::Plain, 0.0), (DifferenceKind::Normalised, f64::NAN)] {
        let mut found = vec![7.0; frame.len()];
        kind.difference_into(&frame, &reference_frame, |i| used[i], missing, &mut found).unwrap();
        let formula = |i: usize| match kind {
            _ if !used[i] => missing,
            DifferenceKind::Plain => frame[i] - reference_frame[i],
            DifferenceKind::Normalised => (frame[i] - reference_frame[i]) / reference_frame[i],
        };
        let wanted: Vec<f64> = (0..frame.len()).map(formula).collect();
        assert_eq!(bits(&found), bits(&wanted), "{kind:?}");
    }
}

#[test]
fn rows_are_divided_by_the_models_voltages() {
    let Setup { jacobian, model_voltages_v, used, .. } = scene();
    let normalised = DifferenceData::Normalised { model_voltages_v: model_voltages_v.clone() };
    assert_eq!(normalised.kind(), DifferenceKind::Normalised);
    assert_eq!(DifferenceData::Plain.kind(), DifferenceKind::Plain);
    for data in [DifferenceData::Plain, normalised] {
        let mut rows = jacobian.clone();
        data.apply_to_rows(&mut rows, Some(&used)).unwrap();
        let formula = |(i, e): (usize, usize)| match data {
            _ if !used[i] => 0.0,
            DifferenceData::Plain => jacobian[(i, e)],
            DifferenceData::Normalised { .. } => jacobian[(i, e)] / model_voltages_v[i],
        };
        let wanted = Array2::from_shape_fn(jacobian.dim(), formula);
        assert_eq!(bits(&rows), bits(&wanted), "{:?}", data.kind());
    }
}

/// Both ways give the same image: the reconstruction's own normalisation, and plain data made from
/// normalised ones.
#[test]
fn the_reconstruction_makes_the_same_of_a_frame() {
    let Setup { jacobian, model_voltages_v, frame, reference_frame, used } = scene();
    let data = DifferenceData::Normalised { model_voltages_v };
    let settings =
        OneStepSettings { data: data.clone(), used: Some(used.clone()), ..Default::default() };
    let prior = Noser::default();
    let own = OneStepGaussNewton::new(&jacobian, &prior, settings.clone()).unwrap();
    let mut difference = vec![0.0; frame.len()];
    data.kind()
        .difference_into(&frame, &reference_frame, |i| used[i], 0.0, &mut difference)
        .unwrap();
    let taken = own.reconstructor().difference(&frame, &reference_frame).unwrap();
    let of_used = difference.iter().zip(&used).filter(|(_, used)| **used).map(|(dv, _)| dv);
    assert_eq!(bits(&taken), bits(of_used));
    let mut rows = jacobian;
    data.apply_to_rows(&mut rows, Some(&used)).unwrap();
    let settings = OneStepSettings { data: DifferenceData::Plain, ..settings };
    let plain = OneStepGaussNewton::new(&rows, &prior, settings).unwrap();
    let wanted = own.reconstruct(&frame, &reference_frame).unwrap();
    let found = plain.reconstruct(&difference, &vec![0.0; difference.len()]).unwrap();
    // weight / voltage * entry or entry / voltage: one rounding apart, divided by lambda^2 = 1e-3
    assert!(relative_difference(&found, &wanted) < 1e-12);
}

#[test]
fn wrong_input_is_named() {
    let Setup { mut jacobian, model_voltages_v, frame, reference_frame, used } = scene();
    let kind = DifferenceKind::Plain;
    let wrong = |what, found, wanted| Err(InverseError::WrongLength { what, found, wanted });
    let mut difference = vec![0.0; 40];
    let of = |frame: &[f64], reference: &[f64], difference: &mut [f64]| {
        kind.difference_into(frame, reference, |_| true, 0.0, difference)
    };
    let result = of(&frame, &reference_frame[1..], &mut difference);
    assert_eq!(result, wrong("reference frame", 39, 40));
    let result = of(&frame, &reference_frame, &mut difference[1..]);
    assert_eq!(result, wrong("difference", 39, 40));
    let data = DifferenceData::Normalised { model_voltages_v };
    let result = data.apply_to_rows(&mut jacobian, Some(&used[1..]));
    assert_eq!(result, wrong("used", 39, 40));
    let before = bits(&jacobian);
    let result = data.apply_to_rows(&mut jacobian, None);
    assert!(matches!(result, Err(InverseError::ZeroReference { measurement: 4, .. })));
    assert_eq!(bits(&jacobian), before, "a refusal changes nothing");
    let data = DifferenceData::Normalised { model_voltages_v: vec![1.0; 39] };
    assert_eq!(data.apply_to_rows(&mut jacobian, None), wrong("model_voltages_v", 39, 40));
    let data = DifferenceData::Normalised { model_voltages_v: vec![f64::INFINITY; 40] };
    let result = data.apply_to_rows(&mut jacobian, None);
    assert!(matches!(result, Err(InverseError::ZeroReference { measurement: 0, .. })));
}
