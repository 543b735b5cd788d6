use super::*;
use fixtures::Random;

/// Free unknowns enlarge the covariance by as much as the whole one, factorised, says.
#[test]
fn free_unknowns_enlarge_the_determinant() {
    let mut random = Random::new(6);
    let n = 9;
    let variances: Vec<f64> = (0..n).map(|_| 0.5 + random.normal().abs()).collect();
    let unknowns = Mat::from_fn(n, 2, |_, _| random.normal());
    let local = Mat::from_fn(n, 2, |_, _| random.normal());
    let further: Vec<f64> = (0..n).map(|_| random.normal()).collect();
    let log_determinant = |columns: &[&dyn Fn(usize) -> f64]| -> f64 {
        let covariance = Mat::from_fn(n, n, |i, j| {
            let of_unknowns: f64 = (0..2).map(|k| unknowns[(i, k)] * unknowns[(j, k)]).sum();
            let of_columns: f64 = columns.iter().map(|column| column(i) * column(j)).sum();
            of_unknowns + of_columns + if i == j { variances[i] } else { 0.0 }
        });
        let factor = covariance.llt(Side::Lower).unwrap();
        (0..n).map(|i| 2.0 * factor.L()[(i, i)].ln()).sum()
    };
    let mut whitening =
        Whitening::new(&variances, unknowns.as_ref()).unwrap().with_local(local.as_ref());
    assert_eq!(whitening.log_determinant(), 0.0);
    let mut whitened = vec![0.0; n];
    whitening.apply(&further, &mut whitened);
    whitening.free(&[1.0, -2.0], &whitened);
    let combined = |i: usize| local[(i, 0)] - 2.0 * local[(i, 1)];
    let wanted = log_determinant(&[&combined, &|i| further[i]]) - log_determinant(&[]);
    let found = whitening.log_determinant();
    // rounding of two factorisations
    assert!((found - wanted).abs() < 1e-10, "{found} {wanted}");
}

/// Losing rows equals never having had them: the squared lengths agree.
#[test]
fn a_lost_row_is_a_row_that_never_was() {
    let mut random = Random::new(5);
    let (n, k) = (12, 4);
    let variances: Vec<f64> = (0..n).map(|_| 0.5 + random.normal().abs()).collect();
    let unknowns = Mat::from_fn(n, k, |_, _| 3.0 * random.normal());
    let mut whitening = Whitening::new(&variances, unknowns.as_ref()).unwrap();
    let lost = [0, 5, 11];
    assert!(whitening.lose(&lost));
    assert!(!whitening.lose(&lost));
    assert_eq!(whitening.present(), 9);
    let expected = whitening.expected();
    let kept: Vec<usize> = (0..n).filter(|i| !lost.contains(i)).collect();
    let of_kept = |v: &[f64]| -> Vec<f64> { kept.iter().map(|&i| v[i]).collect() };
    let unknowns = Mat::from_fn(9, k, |i, j| unknowns[(kept[i], j)]);
    let without = Whitening::new(&of_kept(&variances), unknowns.as_ref()).unwrap();
    assert!((expected / without.expected() - 1.0).abs() < 1e-11);
    for _ in 0..5 {
        let x: Vec<f64> = (0..n).map(|_| random.normal()).collect();
        let (mut y, mut z) = (vec![0.0; n], vec![0.0; 9]);
        whitening.apply(&x, &mut y);
        whitening.project(&mut y);
        without.apply(&of_kept(&x), &mut z);
        // rounding of a covariance of condition 1e3
        assert!((dot(&y, &y) / dot(&z, &z) - 1.0).abs() < 1e-11);
    }
}

fn drawn(random: &mut Random, rows: usize, columns: usize) -> Mat<f64> {
    Mat::from_fn(rows, columns, |_, _| 2.0 * random.normal())
}

/// Two free combinations of three local unknowns equal two more unknowns, also while a row is lost.
#[test]
fn a_free_combination_is_one_more_unknown() {
    let mut random = Random::new(6);
    let n = 10;
    let variances: Vec<f64> = (0..n).map(|_| 0.5 + random.normal().abs()).collect();
    let (unknowns, local) = (drawn(&mut random, n, 3), drawn(&mut random, n, 3));
    let shares = [1.0, 0.5, 0.0, 0.0, -2.0, 0.3];
    let combination =
        |i: usize, k: usize| -> f64 { (0..3).map(|u| shares[3 * k + u] * local[(i, u)]).sum() };
    let mut whitening =
        Whitening::new(&variances, unknowns.as_ref()).unwrap().with_local(local.as_ref());
    assert!(whitening.lose(&[4]));
    assert!(whitening.set_free(&shares, &[]));
    assert!(!whitening.set_free(&shares, &[]));
    let kept: Vec<usize> = (0..n).filter(|i| *i != 4).collect();
    let of_kept = |v: &[f64]| -> Vec<f64> { kept.iter().map(|&i| v[i]).collect() };
    let all = Mat::from_fn(n - 1, 5, |i, k| match k.checked_sub(3) {
        None => unknowns[(kept[i], k)],
        Some(k) => combination(kept[i], k),
    });
    let with = Whitening::new(&of_kept(&variances), all.as_ref()).unwrap();
    assert_eq!(whitening.present(), n - 1);
    assert!((whitening.expected() / with.expected() - 1.0).abs() < 1e-11);
    let mut mapped = || {
        let x: Vec<f64> = (0..n).map(|_| random.normal()).collect();
        let (mut y, mut z) = (vec![0.0; n], vec![0.0; n - 1]);
        whitening.apply(&x, &mut y);
        let raw = y.clone();
        whitening.project(&mut y);
        with.apply(&of_kept(&x), &mut z);
        assert!((dot(&y, &y) / dot(&z, &z) - 1.0).abs() < 1e-11);
        [raw, y]
    };
    let [raw, a] = mapped();
    let [_, mut b] = mapped();
    let product = dot(&a, &b);
    whitening.project_back(&mut b);
    assert!((dot(&raw, &b) - product).abs() < 1e-11);
    // back at no free unknowns, nothing of them is left
    assert!(whitening.set_free(&[], &[]));
    assert_eq!(whitening.kept, [0.0]);
}

/// What free unknowns explain of data is their covariance over that of everything.
#[test]
fn free_unknowns_explain_their_part() {
    let mut random = Random::new(7);
    let n = 8;
    let variances = vec![0.7; n];
    let (unknowns, local) = (drawn(&mut random, n, 2), drawn(&mut random, n, 2));
    let mut whitening =
        Whitening::new(&variances, unknowns.as_ref()).unwrap().with_local(local.as_ref());
    assert!(whitening.set_free(&[1.0, 0.0, 0.0, 1.0], &[]));
    let covariance = |i: usize, j: usize| -> f64 {
        let of = |m: &Mat<f64>| (0..2).map(|k| m[(i, k)] * m[(j, k)]).sum::<f64>();
        of(&unknowns) + of(&local) + if i == j { 0.7 } else { 0.0 }
    };
    let covariance = Mat::from_fn(n, n, covariance);
    // data of which the solution of the whole covariance is known
    let solution: Vec<f64> = (0..n).map(|_| random.normal()).collect();
    let product = |m: &dyn Fn(usize, usize) -> f64, i: usize| -> f64 {
        (0..n).map(|j| m(i, j) * solution[j]).sum()
    };
    let x: Vec<f64> = (0..n).map(|i| product(&|i, j| covariance[(i, j)], i)).collect();
    let (mut y, mut work, mut explained) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    whitening.apply(&x, &mut y);
    whitening.project(&mut y);
    whitening.explained(&y, &mut work, &mut explained);
    for (i, found) in explained.iter().enumerate() {
        let of_local =
            |i: usize, j: usize| -> f64 { (0..2).map(|k| local[(i, k)] * local[(j, k)]).sum() };
        let wanted = product(&of_local, i);
        assert!((found - wanted).abs() < 1e-9 * (1.0 + wanted.abs()), "{found} {wanted}");
    }
}
