use super::*;
use fixtures::Random;
use ndarray::Array2;

/// Rows of sizes 1 to 1e-8, as for a skin whose distant electrodes have little sensitivity.
fn graded() -> (Array2<f64>, Compression) {
    let mut random = Random::new(3);
    let jacobian = Array2::from_shape_fn((12, 30), |(i, _)| {
        10_f64.powf(-8.0 * i as f64 / 11.0) * random.normal()
    });
    let compression = Compression::new(&jacobian, vec![1.0; 12]).unwrap();
    (jacobian, compression)
}

#[test]
fn the_data_term_is_that_of_the_good_rows_for_any_mask() {
    let (jacobian, compression) = graded();
    let rank = compression.rank();
    let mut random = Random::new(4);
    let mut seen = Seen::new(&compression);
    let zero = || Target { values: vec![0.0; rank], rest: vec![0.0; 12], rest_squared: f64::NAN };
    for masked in [vec![], vec![0], vec![3, 4, 11], (0..11).collect(), vec![11]] {
        let good = |i: usize| !masked.contains(&i);
        seen.set(&compression, good);
        assert!(seen.fits(&compression, good));
        let x: Vec<f64> = (0..30).map(|_| random.normal()).collect();
        let dv: Vec<f64> = (0..12).map(|_| random.normal()).collect();
        let mut target = zero();
        seen.take(&compression, &dv, 2.0, &mut target);
        let c: Vec<f64> =
            (0..rank).map(|k| (0..30).map(|p| compression.basis[(p, k)] * x[p]).sum()).collect();
        let mut found = target.rest_squared;
        for (row, t) in seen.transposed.chunks_exact(rank).zip(&target.values).take(seen.rows) {
            let seen: f64 = row.iter().zip(&c).map(|(f, c)| f * c).sum();
            found += (seen - t).powi(2);
        }
        let mut wanted = 0.0;
        for i in (0..12).filter(|&i| good(i)) {
            let model: f64 = (0..30).map(|p| jacobian[(i, p)] * x[p]).sum();
            wanted += (model - dv[i] / 2.0).powi(2);
        }
        // a few rounding errors of sums over 30 and 12 terms
        assert!((found - wanted).abs() <= 1e-13 * wanted, "{masked:?}: {found} {wanted}");
        // the round trip is exact because Q is orthogonal
        let mut spread = vec![0.0; 12];
        seen.spread(&compression, &target.values, &target, 1.0, &mut spread);
        for i in (0..12).filter(|&i| good(i)) {
            assert!((spread[i] - dv[i] / 2.0).abs() < 1e-13, "{masked:?}");
        }
    }
}

#[test]
fn a_change_of_the_dual_never_absorbs_more_than_the_error() {
    let (_, compression) = graded();
    let rank = compression.rank();
    let mut random = Random::new(5);
    let mut seen = Seen::new(&compression);
    for masked in [vec![], vec![0], vec![3, 4, 11], (0..11).collect(), (0..12).collect()] {
        seen.set(&compression, |i| !masked.contains(&i));
        let mut c: Vec<f64> = (0..rank).map(|_| random.normal()).collect();
        let mut dual = vec![0.0; rank];
        for _ in 0..100 {
            seen.absorb(&c, 1e-12, &mut dual);
            let mut absorbed = vec![0.0; rank];
            seen.apply_transposed(&dual, &mut absorbed);
            let norm = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
            let (size, before) = (norm(&absorbed), norm(&c));
            // the largest eigenvalue is at least this ratio; rounding of sums over 12 terms
            assert!(size <= (1.0 + 1e-14 * 12.0) * before, "{masked:?}: {size} of {before}");
            if size == 0.0 {
                break;
            }
            c = absorbed.iter().map(|a| a / size).collect();
        }
    }
}
