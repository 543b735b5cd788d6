//! Medians and quantiles.

/// Median; for an even number of values the upper of the two in the middle. `None` if there are no
/// values. NaN counts as larger than every number, so that callers exclude it if it can occur.
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    median_in_place(&mut values.into_iter().collect::<Vec<f64>>())
}

/// The same of values that are reordered, without allocation.
pub fn median_in_place(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    // the upper of the two needs no interpolation: the median is one of the values
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Quantile for a fraction from 0 (the least value) to 1 (the largest): the value whose rank is nearest.
/// `None` if there are no values; NaN counts as in [`median`], which is the quantile for 0.5.
pub fn quantile(values: &[f64], fraction: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let last = sorted.len().saturating_sub(1);
    sorted.get((fraction * last as f64).round() as usize).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_the_middle_or_the_upper_of_two() {
        let cases: [(&[f64], Option<f64>); 5] = [
            (&[], None),
            (&[5.0], Some(5.0)),
            (&[3.0, 1.0, 2.0], Some(2.0)),
            (&[4.0, 1.0, 2.0, 3.0], Some(3.0)),
            (&[f64::NAN, -1.0, f64::INFINITY], Some(f64::INFINITY)),
        ];
        for (values, wanted) in cases {
            assert_eq!(median(values.iter().copied()), wanted, "{values:?}");
            assert_eq!(quantile(values, 0.5), wanted, "{values:?}");
        }
    }

    #[test]
    fn quantiles_go_from_the_least_to_the_largest() {
        let values: Vec<f64> = (0..=100).rev().map(f64::from).collect();
        assert_eq!([0.0, 0.954, 1.0].map(|q| quantile(&values, q)), [0.0, 95.0, 100.0].map(Some));
    }
}
