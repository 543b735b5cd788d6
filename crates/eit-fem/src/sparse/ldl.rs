//! Sparse `L D L^T` factorisation in any precision, row by row.
//!
//! Uses the up-looking algorithm (Davis, "Algorithm 849: a concise sparse Cholesky factorization
//! package", 2005): the pattern of each row of `L` follows from the elimination tree. There is no
//! pivoting, because the matrix is positive definite.

use super::elimination_tree::NONE;
use super::real::Real;

/// Lower triangle by rows, columns in ascending order. The diagonal is the last entry of each row.
pub(crate) struct Rows<T> {
    pub starts: Vec<usize>,
    pub columns: Vec<u32>,
    pub values: Vec<T>,
}

impl<T: Real> Rows<T> {
    /// Builds the rows from entries `((row, column), value)`. Repeated entries are added in the
    /// given order.
    pub(crate) fn new(unknowns: usize, mut entries: Vec<((u32, u32), T)>) -> Self {
        entries.sort_by_key(|e| e.0);
        let mut rows =
            Self { starts: vec![0; unknowns + 1], columns: Vec::new(), values: Vec::new() };
        let mut last = None;
        for (place, value) in entries {
            match rows.values.last_mut() {
                Some(sum) if last == Some(place) => *sum += value,
                _ => {
                    rows.starts[place.0 as usize + 1] += 1;
                    rows.columns.push(place.1);
                    rows.values.push(value);
                }
            }
            last = Some(place);
        }
        (0..unknowns).for_each(|k| rows.starts[k + 1] += rows.starts[k]);
        rows
    }
}

/// Factor: unit lower triangle by columns, and the pivots.
pub(crate) struct Ldl<T> {
    starts: Vec<usize>,
    rows: Vec<u32>,
    values: Vec<T>,
    pivots: Vec<T>,
}

impl<T: Real> Ldl<T> {
    /// Factorises the matrix. The error is the row of a pivot that is not positive or has lost too
    /// many digits.
    pub(crate) fn new(matrix: &Rows<T>) -> Result<Self, usize> {
        let unknowns = matrix.starts.len() - 1;
        let (parents, starts) = tree(matrix);
        let entries = starts[unknowns];
        let mut factor = Self {
            rows: vec![0; entries],
            values: vec![T::of(0.0); entries],
            pivots: vec![T::of(0.0); unknowns],
            starts,
        };
        let mut filled = vec![0usize; unknowns];
        let mut flags = vec![NONE; unknowns];
        let mut row = vec![T::of(0.0); unknowns];
        let (mut path, mut pattern) = (Vec::new(), Vec::new());
        for k in 0..unknowns {
            let mut pivot = T::of(0.0);
            let mut diagonal = 0.0;
            flags[k] = k as u32;
            pattern.clear();
            for at in matrix.starts[k]..matrix.starts[k + 1] {
                let mut i = matrix.columns[at] as usize;
                if i == k {
                    pivot = matrix.values[at];
                    diagonal = pivot.high();
                    continue;
                }
                row[i] = matrix.values[at];
                path.clear();
                while flags[i] != k as u32 {
                    flags[i] = k as u32;
                    path.push(i);
                    i = parents[i] as usize;
                }
                // descendants must come first; the list is read from its end
                pattern.extend(path.iter().rev().copied());
            }
            for &i in pattern.iter().rev() {
                let value = std::mem::replace(&mut row[i], T::of(0.0));
                let from = factor.starts[i];
                let to = from + filled[i];
                for (at, l) in factor.rows[from..to].iter().zip(&factor.values[from..to]) {
                    let target = &mut row[*at as usize];
                    *target -= *l * value;
                }
                let l = value / factor.pivots[i];
                pivot -= l * value;
                factor.rows[to] = k as u32;
                factor.values[to] = l;
                filled[i] += 1;
            }
            let size = pivot.high();
            let sound = size > 0.0 && size >= T::LOST * diagonal && size.is_finite();
            if !sound {
                return Err(k);
            }
            factor.pivots[k] = pivot;
        }
        Ok(factor)
    }

    /// Number of stored entries, including pivots.
    pub(crate) fn entries(&self) -> usize {
        self.values.len() + self.pivots.len()
    }

    /// Solves in place for `count` right-hand sides; `x` is [unknown, right-hand side].
    pub(crate) fn solve(&self, x: &mut [T], count: usize) {
        let unknowns = self.pivots.len();
        for j in 0..unknowns {
            let (head, tail) = x.split_at_mut((j + 1) * count);
            let own = &head[j * count..];
            // right-hand sides are often zero except in the last unknowns; skip zero rows
            if own.iter().all(|v| v.high() == 0.0) {
                continue;
            }
            for at in self.starts[j]..self.starts[j + 1] {
                let below = (self.rows[at] as usize - j - 1) * count;
                for (t, v) in tail[below..below + count].iter_mut().zip(own) {
                    *t -= self.values[at] * *v;
                }
            }
        }
        for j in (0..unknowns).rev() {
            let (head, tail) = x.split_at_mut((j + 1) * count);
            let own = &mut head[j * count..];
            own.iter_mut().for_each(|v| *v /= self.pivots[j]);
            for at in self.starts[j]..self.starts[j + 1] {
                let below = (self.rows[at] as usize - j - 1) * count;
                for (v, t) in own.iter_mut().zip(&tail[below..below + count]) {
                    *v -= self.values[at] * *t;
                }
            }
        }
    }
}

/// Computes the elimination tree and the start of each column of the factor.
fn tree<T>(matrix: &Rows<T>) -> (Vec<u32>, Vec<usize>) {
    let unknowns = matrix.starts.len() - 1;
    let (mut parents, mut flags) = (vec![NONE; unknowns], vec![NONE; unknowns]);
    let mut starts = vec![0; unknowns + 1];
    for k in 0..unknowns {
        flags[k] = k as u32;
        for &column in &matrix.columns[matrix.starts[k]..matrix.starts[k + 1]] {
            let mut i = column as usize;
            while flags[i] != k as u32 {
                if parents[i] == NONE {
                    parents[i] = k as u32;
                }
                starts[i + 1] += 1;
                flags[i] = k as u32;
                i = parents[i] as usize;
            }
        }
    }
    (0..unknowns).for_each(|k| starts[k + 1] += starts[k]);
    (parents, starts)
}
