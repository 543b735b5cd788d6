//! Small dense systems for the strengths of touches and the shares of the fabric's memory.

use super::vectors::{dot, widest};

/// Relative addition to the diagonal, since columns may be equal.
const RIDGE: f64 = 1e-9;

/// Most active-set steps (bounds held or freed).
const ROUNDS: usize = 40;

/// Workspace for systems up to a given size; solving does not allocate.
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

    /// Sets the Gram matrix and the right-hand side from columns of equal length.
    pub(super) fn set<'a>(&mut self, columns: impl Fn(usize) -> &'a [f64], size: usize, y: &[f64]) {
        debug_assert!(size <= self.most);
        widest(
            #[inline(always)]
            || {
                for i in 0..size {
                    for j in 0..=i {
                        let product = dot(columns(i), columns(j));
                        self.gram[i * size + j] = product;
                        self.gram[j * size + i] = product;
                    }
                    self.right[i] = dot(columns(i), y);
                }
            },
        );
    }

    /// Solves the least squares problem given to [`set`](Self::set), without the column `left_out`, and
    /// returns the decrease of the squared residual.
    ///
    /// The first `free` unknowns are unbounded; the others have bounds `[low, high]` that contain zero.
    ///
    /// Active set method: from a feasible point, step toward the least squares solution of the free
    /// unknowns, up to the first bound, which is then held. If the whole step stays within all bounds, free
    /// the held unknown with the largest inward gradient. The residual never grows. Source:
    /// bounded-variable least squares (Stark, Parker, *Computational Statistics* 10 (1995), 129-141).
    pub(super) fn solve_bounded(
        &mut self,
        size: usize,
        free: usize,
        bounds: &[[f64; 2]],
        left_out: Option<usize>,
    ) -> f64 {
        self.solution[..size].fill(0.0);
        self.is_free[..size].fill(true);
        for (k, [low, high]) in bounds.iter().enumerate() {
            self.is_free[free + k] = *low < 0.0 && *high > 0.0;
        }
        if let Some(column) = left_out {
            self.is_free[column] = false;
        }
        for _ in 0..ROUNDS {
            self.solve_free(size);
            if self.step_to_bound(free, bounds) {
                continue;
            }
            if !self.free_one(size, free, bounds) {
                break;
            }
        }
        let x = &self.solution[..size];
        (0..size)
            .map(|i| x[i] * (2.0 * self.right[i] - dot(&self.gram[i * size..(i + 1) * size], x)))
            .sum()
    }

    /// Steps to the solution of the free unknowns, or to the first bound on the way. Returns true if it
    /// held a bound.
    fn step_to_bound(&mut self, free: usize, bounds: &[[f64; 2]]) -> bool {
        let (mut part, mut first) = (1.0, None);
        for (r, &i) in self.index.iter().enumerate() {
            let Some([low, high]) = i.checked_sub(free).map(|k| bounds[k]) else { continue };
            let (from, to) = (self.solution[i], self.work[r]);
            let bound = if to < low {
                low
            } else if to > high {
                high
            } else {
                continue;
            };
            let reach = (bound - from) / (to - from);
            if reach < part {
                (part, first) = (reach, Some((i, bound)));
            }
        }
        for (r, &i) in self.index.iter().enumerate() {
            self.solution[i] += part * (self.work[r] - self.solution[i]);
        }
        let Some((i, bound)) = first else { return false };
        (self.solution[i], self.is_free[i]) = (bound, false);
        true
    }

    /// Frees the held unknown that would lower the residual most; returns false if none would.
    fn free_one(&mut self, size: usize, free: usize, bounds: &[[f64; 2]]) -> bool {
        let (mut best, mut most): (_, f64) = (None, 0.0);
        for (k, [low, high]) in bounds.iter().enumerate() {
            let i = free + k;
            if self.is_free[i] {
                continue;
            }
            let row = &self.gram[i * size..(i + 1) * size];
            let pull = self.right[i] - dot(row, &self.solution[..size]);
            let inward =
                (pull > 0.0 && self.solution[i] < *high) || (pull < 0.0 && self.solution[i] > *low);
            let scale = row[i].max(f64::MIN_POSITIVE).sqrt();
            // ignore a gradient that is mere rounding
            let least = 1e-9 * self.right[i].abs() / scale;
            if inward && pull.abs() / scale > most.max(least) {
                (best, most) = (Some(i), pull.abs() / scale);
            }
        }
        best.is_some_and(|i| {
            self.is_free[i] = true;
            true
        })
    }

    /// Solves for the free unknowns, with the others given, into `work`.
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
    }

    /// Takes a damped Gauss-Newton step: solves `(D^-1/2 G D^-1/2 + damping I) z = D^-1/2 b`, `x = D^-1/2 z`.
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

    /// Computes the block `[first..first + width]` of the inverse of the Gram matrix, row-major:
    /// covariances of unknowns. Scaled, and damped at the level of rounding.
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

/// Solves `A x = b` in place for a symmetric positive definite, row-major `A`; unknowns whose pivot is not
/// above zero become zero.
fn cholesky_solve(a: &mut [f64], n: usize, b: &mut [f64]) {
    for i in 0..n {
        for j in 0..=i {
            let (row, other) = (&a[i * n..i * n + j], &a[j * n..j * n + j]);
            let sum = a[i * n + j] - dot(row, other);
            a[i * n + j] = match (i == j, a[j * n + j]) {
                (true, _) if sum > 0.0 => sum.sqrt(),
                (true, _) => f64::INFINITY,
                (false, pivot) => sum / pivot,
            };
        }
    }
    for i in 0..n {
        b[i] = (b[i] - dot(&a[i * n..i * n + i], &b[..i])) / a[i * n + i];
    }
    for i in (0..n).rev() {
        let sum: f64 = (i + 1..n).map(|k| a[k * n + i] * b[k]).sum();
        b[i] = (b[i] - sum) / a[i * n + i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fixtures::Random;

    /// Compares with projected coordinate descent run to convergence, another route to the same optimum.
    #[test]
    fn bounded_least_squares_are_those_of_coordinate_descent() {
        let mut random = Random::new(11);
        for trial in 0..200 {
            let (n, free, held) = (12, 1 + trial % 3, 1 + trial % 5);
            let size = free + held;
            let shared: Vec<f64> = (0..n).map(|_| random.normal()).collect();
            let columns: Vec<Vec<f64>> = (0..size)
                .map(|_| shared.iter().map(|s| s + 0.3 * random.normal()).collect())
                .collect();
            let y: Vec<f64> = (0..n).map(|_| random.normal()).collect();
            let bounds: Vec<[f64; 2]> =
                (0..held).map(|k| if k % 2 == 0 { [0.0, 0.4] } else { [-0.3, 0.1] }).collect();
            let mut system = SmallSystem::new(size);
            system.set(|i| &columns[i], size, &y);
            let fall = system.solve_bounded(size, free, &bounds, None);
            let mut x = vec![0.0; size];
            for _ in 0..20_000 {
                for i in 0..size {
                    let row = &system.gram[i * size..(i + 1) * size];
                    x[i] += (system.right[i] - dot(row, &x)) / row[i];
                    if let Some(k) = i.checked_sub(free) {
                        x[i] = x[i].clamp(bounds[k][0], bounds[k][1]);
                    }
                }
            }
            let of_descent: f64 = (0..size)
                .map(|i| {
                    let row = &system.gram[i * size..(i + 1) * size];
                    x[i] * (2.0 * system.right[i] - dot(row, &x))
                })
                .sum();
            // the ridge of 1e-9 and the convergence of the descent
            assert!((fall - of_descent).abs() < 1e-6 * dot(&y, &y), "{fall} {of_descent}");
        }
    }
}
