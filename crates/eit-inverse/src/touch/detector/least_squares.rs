//! Small dense systems: strengths of touches and shares of the fabric's memory.

use super::whitening::dot;

/// Relative addition to the diagonal: columns may be equal.
const RIDGE: f64 = 1e-9;

/// Memory for systems up to a size; allocates nothing once made.
#[derive(Debug, Clone)]
pub(super) struct SmallSystem {
    most: usize,
    /// Gram matrix, row-major `size x size`.
    pub(super) gram: Vec<f64>,
    pub(super) right: Vec<f64>,
    pub(super) solution: Vec<f64>,
    is_free: Vec<bool>,
    index: Vec<usize>,
    factor: Vec<f64>,
    work: Vec<f64>,
}

impl SmallSystem {
    pub(super) fn new(most: usize) -> Self {
        Self {
            most,
            gram: vec![0.0; most * most],
            right: vec![0.0; most],
            solution: vec![0.0; most],
            is_free: vec![true; most],
            index: Vec::with_capacity(most),
            factor: vec![0.0; most * most],
            work: vec![0.0; most],
        }
    }

    /// Gram matrix and right-hand side of columns of length `n`.
    pub(super) fn set<'a>(&mut self, columns: impl Fn(usize) -> &'a [f64], size: usize, y: &[f64]) {
        debug_assert!(size <= self.most);
        for i in 0..size {
            for j in 0..=i {
                let product = dot(columns(i), columns(j));
                self.gram[i * size + j] = product;
                self.gram[j * size + i] = product;
            }
            self.right[i] = dot(columns(i), y);
        }
    }

    /// Least squares of what [`set`](Self::set) took, without the columns `left_out`: the first
    /// `free` unknowns have no bounds, the others `[low, high]`, of which those that are exceeded are
    /// held one round after another. Returns the fall of the squared residual.
    pub(super) fn solve_bounded(
        &mut self,
        size: usize,
        free: usize,
        bounds: &[[f64; 2]],
        left_out: Option<usize>,
    ) -> f64 {
        self.solution[..size].fill(0.0);
        self.is_free[..size].fill(true);
        if let Some(column) = left_out {
            self.is_free[column] = false;
        }
        loop {
            self.solve_free(size);
            let mut exceeded = false;
            for (k, [low, high]) in bounds.iter().enumerate() {
                let at = free + k;
                if !self.is_free[at] {
                    continue;
                }
                let clipped = self.solution[at].clamp(*low, *high);
                if clipped != self.solution[at] {
                    (self.solution[at], self.is_free[at], exceeded) = (clipped, false, true);
                }
            }
            if !exceeded {
                break;
            }
        }
        let x = &self.solution[..size];
        (0..size)
            .map(|i| x[i] * (2.0 * self.right[i] - dot(&self.gram[i * size..(i + 1) * size], x)))
            .sum()
    }

    /// Unknowns that are free, the others given.
    fn solve_free(&mut self, size: usize) {
        self.index.clear();
        self.index.extend((0..size).filter(|&i| self.is_free[i]));
        let count = self.index.len();
        for (r, &i) in self.index.iter().enumerate() {
            let row = &self.gram[i * size..(i + 1) * size];
            let held: f64 =
                (0..size).filter(|&j| !self.is_free[j]).map(|j| row[j] * self.solution[j]).sum();
            self.work[r] = self.right[i] - held;
            for (c, &j) in self.index.iter().enumerate() {
                self.factor[r * count + c] = row[j];
            }
            self.factor[r * count + r] *= 1.0 + RIDGE;
        }
        cholesky_solve(&mut self.factor, count, &mut self.work);
        for (r, &i) in self.index.iter().enumerate() {
            self.solution[i] = self.work[r];
        }
    }

    /// Solves `(D^-1/2 G D^-1/2 + damping I) z = D^-1/2 b`, `x = D^-1/2 z`: a damped Gauss-Newton step.
    pub(super) fn solve_damped(&mut self, size: usize, damping: f64) -> &[f64] {
        self.scaled_factor(size, damping);
        for i in 0..size {
            self.work[i] = self.right[i] * self.scale(size, i);
        }
        cholesky_solve(&mut self.factor, size, &mut self.work);
        for i in 0..size {
            self.solution[i] = self.work[i] * self.scale(size, i);
        }
        &self.solution[..size]
    }

    /// Block `[first..first + width]` of the inverse of the Gram matrix, row-major: variances of
    /// unknowns. Scaled, and damped by what rounding would be.
    pub(super) fn inverse_block(
        &mut self,
        size: usize,
        first: usize,
        width: usize,
        block: &mut [f64],
    ) {
        for k in 0..width {
            self.scaled_factor(size, RIDGE);
            self.work[..size].fill(0.0);
            self.work[first + k] = self.scale(size, first + k);
            cholesky_solve(&mut self.factor, size, &mut self.work);
            for i in 0..width {
                block[i * width + k] = self.work[first + i] * self.scale(size, first + i);
            }
        }
    }

    /// `D^-1/2 G D^-1/2 + damping I`.
    fn scaled_factor(&mut self, size: usize, damping: f64) {
        for i in 0..size {
            let of_i = self.scale(size, i);
            for j in 0..size {
                self.factor[i * size + j] = self.gram[i * size + j] * of_i * self.scale(size, j);
            }
            self.factor[i * size + i] += damping;
        }
    }

    fn scale(&self, size: usize, i: usize) -> f64 {
        let square = self.gram[i * size + i];
        if square > 0.0 { square.sqrt().recip() } else { 0.0 }
    }
}

/// Solves `A x = b` in place, `A` symmetric and positive definite, row-major; unknowns whose pivot
/// is not above zero are zero.
fn cholesky_solve(a: &mut [f64], n: usize, b: &mut [f64]) {
    for i in 0..n {
        for j in 0..=i {
            let mut sum = a[i * n + j];
            for k in 0..j {
                sum -= a[i * n + k] * a[j * n + k];
            }
            a[i * n + j] = match (i == j, a[j * n + j]) {
                (true, _) if sum > 0.0 => sum.sqrt(),
                (true, _) => f64::INFINITY,
                (false, pivot) => sum / pivot,
            };
        }
    }
    for i in 0..n {
        let sum: f64 = (0..i).map(|k| a[i * n + k] * b[k]).sum();
        b[i] = (b[i] - sum) / a[i * n + i];
    }
    for i in (0..n).rev() {
        let sum: f64 = (i + 1..n).map(|k| a[k * n + i] * b[k]).sum();
        b[i] = (b[i] - sum) / a[i * n + i];
    }
}
