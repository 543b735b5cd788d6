//! Symmetric matrices and Cholesky factors, packed by rows of the lower triangle, without allocation once grown.
//!
//! All sums are dot products in a fixed order ([`dot`], [`dots`]), so results do not depend on the processor. Costs for `n`
//! rows: factor `n^3 / 3` flops, a solve `n^2` for each vector.

use crate::touch::detector::{dot, widest};

/// Relative pivot below which a matrix counts as singular along that row: rounding of `n^2` sums.
const LEAST_PIVOT: f64 = 1e-13;

/// First index of a row in a packed lower triangle.
#[inline(always)]
pub(super) fn start(row: usize) -> usize {
    row * (row + 1) / 2
}

/// Four dot products with one vector at once, each in eight partial sums. Explicit loops: closures would not be compiled for
/// the widest vectors.
#[inline(always)]
fn dots(a: &[f64], b: [&[f64]; 4]) -> [f64; 4] {
    let n = a.len();
    let b = [&b[0][..n], &b[1][..n], &b[2][..n], &b[3][..n]];
    let mut sums = [[0.0; 8]; 4];
    let mut from = 0;
    while from + 8 <= n {
        let part = &a[from..from + 8];
        for i in 0..4 {
            let other = &b[i][from..from + 8];
            for k in 0..8 {
                sums[i][k] += part[k] * other[k];
            }
        }
        from += 8;
    }
    if from + 4 <= n {
        let part = &a[from..from + 4];
        for i in 0..4 {
            let other = &b[i][from..from + 4];
            for k in 0..4 {
                sums[i][k] += part[k] * other[k];
            }
        }
        from += 4;
    }
    let mut out = [0.0; 4];
    for i in 0..4 {
        let s = &sums[i];
        out[i] = ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7]));
    }
    for k in from..n {
        for i in 0..4 {
            out[i] += a[k] * b[i][k];
        }
    }
    out
}

/// A symmetric matrix: its lower triangle, row by row.
#[derive(Debug, Clone, Default)]
pub(super) struct Symmetric {
    pub(super) n: usize,
    pub(super) packed: Vec<f64>,
}

impl Symmetric {
    pub(super) fn zeros(n: usize) -> Self {
        Self { n, packed: vec![0.0; start(n)] }
    }

    /// Sets the size; all entries become zero.
    pub(super) fn reset(&mut self, n: usize) {
        self.n = n;
        self.packed.clear();
        self.packed.resize(start(n), 0.0);
    }

    #[inline(always)]
    pub(super) fn get(&self, i: usize, j: usize) -> f64 {
        if i >= j { self.packed[start(i) + j] } else { self.packed[start(j) + i] }
    }

    pub(super) fn add_diagonal(&mut self, value: f64) {
        (0..self.n).for_each(|i| self.packed[start(i) + i] += value);
    }

    /// Adds `weight` times another matrix of the same size.
    pub(super) fn add(&mut self, weight: f64, other: &Self) {
        self.packed.iter_mut().zip(&other.packed).for_each(|(a, b)| *a += weight * b);
    }

    pub(super) fn scale(&mut self, factor: f64) {
        self.packed.iter_mut().for_each(|a| *a *= factor);
    }

    /// Adds `weight v v'`.
    pub(super) fn add_square(&mut self, weight: f64, v: &[f64]) {
        let mut from = 0;
        for (i, vi) in v.iter().enumerate() {
            let w = weight * vi;
            if w != 0.0 {
                let row = &mut self.packed[from..=from + i];
                row.iter_mut().zip(v).for_each(|(a, vj)| *a += w * vj);
            }
            from += i + 1;
        }
    }

    /// Adds `weight (a b' + b a')`.
    pub(super) fn add_squares(&mut self, weight: f64, a: &[f64], b: &[f64]) {
        for (i, row) in (0..self.n).map(|i| (i, start(i))) {
            let (wa, wb) = (weight * a[i], weight * b[i]);
            let row = &mut self.packed[row..=row + i];
            for (out, (aj, bj)) in row.iter_mut().zip(a.iter().zip(b)) {
                *out += wa * bj + wb * aj;
            }
        }
    }

    /// Adds `weight A A'` for a matrix `A` of `n` rows, row by row; `n^2 k` flops for `k` columns.
    pub(super) fn add_product(&mut self, weight: f64, rows: &[f64]) {
        let (n, k) = (self.n, rows.len() / self.n.max(1));
        if k == 0 {
            return;
        }
        let row = |i: usize| &rows[i * k..(i + 1) * k];
        let packed = &mut self.packed;
        widest(
            #[inline(always)]
            || {
                for i in 0..n {
                    let out = &mut packed[start(i)..=start(i) + i];
                    let fours = (i + 1) / 4 * 4;
                    for j in (0..fours).step_by(4) {
                        let sums = dots(row(i), [row(j), row(j + 1), row(j + 2), row(j + 3)]);
                        (0..4).for_each(|q| out[j + q] += weight * sums[q]);
                    }
                    for (j, out) in out.iter_mut().enumerate().skip(fours) {
                        *out += weight * dot(row(i), row(j));
                    }
                }
            },
        );
    }
}

/// Cholesky factor `L` of a symmetric matrix `L L'`.
#[derive(Debug, Clone, Default)]
pub(super) struct Factor {
    n: usize,
    packed: Vec<f64>,
    reciprocal: Vec<f64>,
}

impl Factor {
    /// Factorises a matrix. A pivot that rounding has made too small is raised, so that the factor always exists.
    pub(super) fn of(&mut self, matrix: &Symmetric) {
        self.n = matrix.n;
        self.packed.clone_from(&matrix.packed);
        self.reciprocal.clear();
        self.reciprocal.resize(self.n, 0.0);
        let Self { n, packed, reciprocal } = self;
        widest(
            #[inline(always)]
            || {
                for first in (0..*n).step_by(4) {
                    let count = (*n - first).min(4);
                    factorise_rows(packed, reciprocal, first, count);
                }
            },
        );
    }

    /// Computes `L^-1 x`.
    pub(super) fn solve(&self, x: &mut [f64]) {
        widest(
            #[inline(always)]
            || self.solve_one(x),
        );
    }

    #[inline(always)]
    fn solve_one(&self, x: &mut [f64]) {
        for i in 0..self.n {
            let row = &self.packed[start(i)..start(i) + i];
            x[i] = (x[i] - dot(row, &x[..i])) * self.reciprocal[i];
        }
    }

    /// Computes `L^-1 x` for vectors one after the other.
    pub(super) fn solve_all(&self, vectors: &mut [f64]) {
        let n = self.n.max(1);
        widest(
            #[inline(always)]
            || {
                let mut four = vectors.chunks_exact_mut(4 * n);
                for block in &mut four {
                    let (a, rest) = block.split_at_mut(n);
                    let (b, rest) = rest.split_at_mut(n);
                    let (c, d) = rest.split_at_mut(n);
                    for i in 0..self.n {
                        let row = &self.packed[start(i)..start(i) + i];
                        let sums = dots(row, [&a[..i], &b[..i], &c[..i], &d[..i]]);
                        let r = self.reciprocal[i];
                        a[i] = (a[i] - sums[0]) * r;
                        b[i] = (b[i] - sums[1]) * r;
                        c[i] = (c[i] - sums[2]) * r;
                        d[i] = (d[i] - sums[3]) * r;
                    }
                }
                four.into_remainder().chunks_exact_mut(n).for_each(|x| self.solve_one(x));
            },
        );
    }

    /// Computes `L'^-1 x`.
    pub(super) fn solve_transposed(&self, x: &mut [f64]) {
        widest(
            #[inline(always)]
            || {
                for i in (0..self.n).rev() {
                    let (before, rest) = x.split_at_mut(i);
                    rest[0] *= self.reciprocal[i];
                    let row = &self.packed[start(i)..start(i) + i];
                    before.iter_mut().zip(row).for_each(|(x, l)| *x -= l * rest[0]);
                }
            },
        );
    }

    /// Computes `L x`.
    pub(super) fn multiply(&self, x: &mut [f64]) {
        for i in (0..self.n).rev() {
            x[i] = dot(&self.packed[start(i)..=start(i) + i], &x[..=i]);
        }
    }

    /// Logarithm of the determinant of `L L'`.
    pub(super) fn log_determinant(&self) -> f64 {
        -2.0 * self.reciprocal.iter().map(|r| r.ln()).sum::<f64>()
    }
}

/// Computes up to four rows of a factor from those above them.
#[inline(always)]
fn factorise_rows(packed: &mut [f64], reciprocal: &mut [f64], first: usize, count: usize) {
    let (above, rows) = packed.split_at_mut(start(first));
    if count == 4 {
        let (a, rest) = rows.split_at_mut(first + 1);
        let (b, rest) = rest.split_at_mut(first + 2);
        let (c, d) = rest.split_at_mut(first + 3);
        for j in 0..first {
            let row = &above[start(j)..start(j) + j];
            let sums = dots(row, [&a[..j], &b[..j], &c[..j], &d[..j]]);
            let r = reciprocal[j];
            a[j] = (a[j] - sums[0]) * r;
            b[j] = (b[j] - sums[1]) * r;
            c[j] = (c[j] - sums[2]) * r;
            d[j] = (d[j] - sums[3]) * r;
        }
    }
    let done = if count == 4 { first } else { 0 };
    for i in first..first + count {
        let (before, own) = packed.split_at_mut(start(i));
        for j in done..i {
            let row = &before[start(j)..start(j) + j];
            own[j] = (own[j] - dot(row, &own[..j])) * reciprocal[j];
        }
        let whole = own[i];
        let pivot = (whole - dot(&own[..i], &own[..i])).max(LEAST_PIVOT * whole.abs());
        own[i] = pivot.max(f64::MIN_POSITIVE).sqrt();
        reciprocal[i] = own[i].recip();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::Mat;
    use fixtures::Random;

    fn random(n: usize) -> (Symmetric, Mat<f64>) {
        let mut random = Random::new(n as u64 + 1);
        let rows: Vec<f64> = (0..n * (n + 3)).map(|_| random.normal()).collect();
        let mut matrix = Symmetric::zeros(n);
        matrix.add_product(1.0, &rows);
        matrix.add_diagonal(0.5);
        let whole = Mat::from_fn(n, n, |i, j| matrix.get(i, j));
        (matrix, whole)
    }

    /// `L L' = A`, `L^-1 A L'^-1 = I`, and the determinant, against faer; sizes around the blocks of four.
    #[test]
    fn factors_are_those_of_faer() {
        for n in [1, 3, 4, 5, 8, 23] {
            let (matrix, whole) = random(n);
            let mut factor = Factor::default();
            factor.of(&matrix);
            let dense = whole.llt(faer::Side::Lower).unwrap();
            for i in 0..n {
                for j in 0..=i {
                    let (own, other) = (factor.packed[start(i) + j], dense.L()[(i, j)]);
                    assert!((own - other).abs() < 1e-10 * (1.0 + other.abs()), "{n} {i} {j}");
                }
            }
            let determinant: f64 = (0..n).map(|i| 2.0 * dense.L()[(i, i)].ln()).sum();
            assert!((factor.log_determinant() - determinant).abs() < 1e-9);
            let mut vectors: Vec<f64> =
                (0..n).flat_map(|j| (0..n).map(move |i| (i, j))).map(|ij| whole[ij]).collect();
            factor.solve_all(&mut vectors);
            for (j, x) in vectors.chunks_exact_mut(n).enumerate() {
                factor.solve_transposed(x);
                for (i, x) in x.iter().enumerate() {
                    assert!((x - f64::from(u8::from(i == j))).abs() < 1e-9, "{n} {i} {j} {x}");
                }
            }
        }
    }

    /// A matrix of rank one has a finite factor.
    #[test]
    fn a_singular_matrix_has_a_factor() {
        let mut matrix = Symmetric::zeros(6);
        matrix.add_square(1.0, &[1.0; 6]);
        let mut factor = Factor::default();
        factor.of(&matrix);
        let mut x = [1.0; 6];
        factor.solve(&mut x);
        assert!(x.iter().all(|x| x.is_finite()) && factor.log_determinant().is_finite());
    }
}
