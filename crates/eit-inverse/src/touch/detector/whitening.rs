//! Covariance of everything that is not a touch: noise, electrode movement, contacts, sheet.

use crate::InverseError;
use crate::check::check_positive;
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Mat, MatRef, Par, Side};

/// A lost row that the other rows determine almost alone has no direction of its own.
const DEPENDENT: f64 = 1e-10;

/// `W = L^-1` of the covariance `C = L L'` of the rows, and the rows that are lost.
///
/// A lost row has infinite variance: of whitened data `y` and columns `d`, only the part orthogonal to
/// `W e_i` of each lost row `i` remains. The result equals that of dropping the rows and factorising again,
/// for `2 n k` flops per vector.
#[derive(Debug, Clone)]
pub(super) struct Whitening {
    rows: usize,
    /// Noise of each row, squared volts.
    variances: Vec<f64>,
    /// Expected squared length of whitened noise if the unknowns are zero, of all rows and without the lost
    /// ones.
    expected_of_all: f64,
    expected: f64,
    /// Lower triangle of `W`, row by row.
    packed: Vec<f64>,
    lost: Vec<usize>,
    /// Orthonormal directions of the lost rows, one after the other.
    directions: Vec<f64>,
}

impl Whitening {
    /// Factorises the covariance of `variances` (the noise of each row) and columns of unknowns with
    /// standard deviation 1.
    pub(super) fn new(variances: &[f64], unknowns: MatRef<'_, f64>) -> Result<Self, InverseError> {
        let rows = variances.len();
        variances.iter().try_for_each(|v| check_positive("noise variance of a measurement", *v))?;
        let mut covariance =
            Mat::from_fn(rows, rows, |i, j| if i == j { variances[i] } else { 0.0 });
        covariance += unknowns * unknowns.transpose();
        let failed = InverseError::Factorisation { what: "covariance of the detector", size: rows };
        let factor = covariance.llt(Side::Lower).map_err(|_| failed)?;
        let mut inverse = Mat::<f64>::identity(rows, rows);
        solve_lower_triangular_in_place(factor.L(), inverse.as_mut(), Par::Seq);
        let packed = (0..rows).flat_map(|i| (0..=i).map(move |j| (i, j)));
        let packed = packed.map(|(i, j)| inverse[(i, j)]).collect();
        let expected = (0..rows)
            .map(|i| (0..=i).map(|j| inverse[(i, j)].powi(2) * variances[j]).sum::<f64>())
            .sum();
        let variances = variances.to_vec();
        let expected_of_all = expected;
        Ok(Self {
            rows,
            variances,
            expected_of_all,
            expected,
            packed,
            lost: Vec::new(),
            directions: Vec::new(),
        })
    }

    pub(super) fn rows(&self) -> usize {
        self.rows
    }

    /// Expected squared length of whitened noise without lost rows if the unknowns are zero.
    pub(super) fn expected(&self) -> f64 {
        self.expected
    }

    /// Number of rows present.
    pub(super) fn present(&self) -> usize {
        self.rows - self.directions.len() / self.rows
    }

    /// Computes `W x` in `n^2` flops.
    pub(super) fn apply(&self, x: &[f64], out: &mut [f64]) {
        let mut start = 0;
        for (i, value) in out.iter_mut().enumerate() {
            *value = dot(&self.packed[start..=start + i], &x[..=i]);
            start += i + 1;
        }
    }

    /// Projects out the directions of lost rows.
    pub(super) fn project(&self, y: &mut [f64]) {
        for direction in self.directions.chunks_exact(self.rows) {
            let part = dot(direction, y);
            y.iter_mut().zip(direction).for_each(|(y, u)| *y -= part * u);
        }
    }

    /// Returns the directions of the lost rows.
    pub(super) fn directions(&self) -> impl Iterator<Item = &[f64]> {
        self.directions.chunks_exact(self.rows)
    }

    /// Expected square of whitened noise along a unit vector.
    fn expected_along(&self, direction: &[f64]) -> f64 {
        let of_row = |(j, variance): (usize, &f64)| {
            let column = (j..self.rows).map(|i| self.packed[i * (i + 1) / 2 + j] * direction[i]);
            variance * column.sum::<f64>().powi(2)
        };
        self.variances.iter().enumerate().map(of_row).sum()
    }

    /// Sets the lost rows and returns whether they have changed.
    pub(super) fn lose(&mut self, lost: &[usize]) -> bool {
        if self.lost == lost {
            return false;
        }
        self.lost.clear();
        self.lost.extend_from_slice(lost);
        self.directions.clear();
        for &row in lost {
            let from = self.directions.len();
            // column of W: zero above the row
            self.directions.resize(from + self.rows, 0.0);
            let (before, new) = self.directions.split_at_mut(from);
            for (i, value) in new.iter_mut().enumerate().skip(row) {
                *value = self.packed[i * (i + 1) / 2 + row];
            }
            let whole = norm(new);
            // two passes are enough (Kahan; Parlett, The Symmetric Eigenvalue Problem, 6.9)
            for _ in 0..2 {
                for direction in before.chunks_exact(self.rows) {
                    let part = dot(direction, new);
                    new.iter_mut().zip(direction).for_each(|(y, u)| *y -= part * u);
                }
            }
            let left = norm(new);
            if left > DEPENDENT * whole {
                new.iter_mut().for_each(|y| *y /= left);
            } else {
                self.directions.truncate(from);
            }
        }
        let lost: f64 =
            self.directions.chunks_exact(self.rows).map(|u| self.expected_along(u)).sum();
        self.expected = self.expected_of_all - lost;
        true
    }
}

/// Dot product in eight partial sums, which lets the compiler vectorise it.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (a8, b8) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = a8.remainder().iter().zip(b8.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a8.zip(b8) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    sums.iter().sum::<f64>() + rest
}

pub(super) fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use fixtures::Random;

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
}
