//! `A = L L^T` of a complex symmetric matrix: nothing is conjugated, no pivot is exchanged.
//!
//! faer's Cholesky is Hermitian for complex numbers, and its LU would store and compute both
//! triangles. So the loop over supernodes is here, on the symbolic factor of the real model and
//! with faer's dense kernels, and everything after the factorisation (trailing block, fields) is the
//! real model's code. Supernode by supernode, to the right:
//!
//! ```text
//! [ L11     ]    L11 L11^T = A11,   L21 = A21 L11^-T,   later supernodes -= L21 L21^T
//! [ L21     ]
//! ```
//!
//! One product per supernode; where its entries go is known from the pattern ([`Updates`]).
//!
//! **Why no pivoting.** Phases of all admittances lie within less than half a turn
//! ([`Phases`](super::phases::Phases)), and so do those of every pivot: Schur complements keep the
//! sector of the numerical range. For passive skins (conductances and capacitors: a quarter turn)
//! no entry grows by more than a factor of three (N. J. Higham, "Factorizing complex symmetric
//! matrices with positive definite real and imaginary parts", Math. Comp. 67, 1998, conjectures two;
//! A. George, Kh. D. Ikramov, A. B. Kucherov, "On the growth factor in Gaussian elimination for
//! generalized Higham matrices", Numer. Linear Algebra Appl. 9, 2002, prove three). Growth is
//! measured with every report.

use crate::assembly::Assembly;
use crate::solver::{Factor, Solver};
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::prelude::*;
use faer::sparse::linalg::cholesky::SymbolicCholeskyRaw;
use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;
use faer::{Accum, MatMut, MatRef, Par, c64};

/// Columns below which a diagonal block is factorised entry by entry.
const LEAF: usize = 8;

/// Where the numbers of a factorisation go, known from the pattern.
#[derive(Debug)]
pub(super) struct Updates {
    /// Place in the factor of each entry of the matrix.
    places: Vec<u32>,
    /// The supernodes in order of elimination.
    panels: Vec<Panel>,
    /// Targets of all panels.
    targets: Vec<Target>,
    /// Rows of targets.
    rows: Vec<u32>,
}

/// A supernode: `height` rows (its own columns first) by `columns`, column-major.
#[derive(Debug)]
struct Panel {
    /// First unknown.
    start: usize,
    columns: usize,
    height: usize,
    /// First value in the factor.
    value: usize,
    /// End of its targets; they begin where those of the panel before end.
    targets_end: usize,
}

/// A later supernode, and which part of an update it takes.
#[derive(Debug)]
struct Target {
    /// First value of the target in the factor.
    value: usize,
    height: usize,
    /// Columns of the update: `from..to`.
    from: usize,
    to: usize,
    /// First of the target's rows for the rows `from..` of the update.
    rows: usize,
}

impl Updates {
    /// From the symbolic factor.
    pub fn new(solver: &Solver, assembly: &Assembly) -> Self {
        let mut updates =
            Self { places: Vec::new(), panels: Vec::new(), targets: Vec::new(), rows: Vec::new() };
        // the solver forces supernodes
        if let SymbolicCholeskyRaw::Supernodal(symbolic) = solver.symbolic.raw() {
            let supernode_of = supernode_of_unknown(symbolic);
            updates.find_places(symbolic, &supernode_of, assembly);
            updates.find_targets(symbolic, &supernode_of);
        }
        updates
    }

    fn find_places(
        &mut self,
        symbolic: &SymbolicSupernodalCholesky<u32>,
        supernode_of: &[u32],
        assembly: &Assembly,
    ) {
        for (column, &s) in supernode_of.iter().enumerate() {
            let s = s as usize;
            let begin = symbolic.supernode_begin()[s] as usize;
            let first =
                symbolic.col_ptr_for_val()[s] as usize + (column - begin) * height(symbolic, s);
            let range = assembly.column_starts[column]..assembly.column_starts[column + 1];
            for &row in &assembly.rows[range.start as usize..range.end as usize] {
                self.places.push((first + local_row(symbolic, s, row)) as u32);
            }
        }
    }

    fn find_targets(&mut self, symbolic: &SymbolicSupernodalCholesky<u32>, supernode_of: &[u32]) {
        for s in 0..symbolic.n_supernodes() {
            let node = symbolic.supernode(s);
            let pattern = node.pattern();
            let mut from = 0;
            while from < pattern.len() {
                let target = supernode_of[pattern[from] as usize];
                let same = |row: &&u32| supernode_of[**row as usize] == target;
                let to = from + pattern[from..].iter().take_while(same).count();
                let t = target as usize;
                self.targets.push(Target {
                    value: symbolic.col_ptr_for_val()[t] as usize,
                    height: height(symbolic, t),
                    from,
                    to,
                    rows: self.rows.len(),
                });
                let rows = pattern[from..].iter().map(|&row| local_row(symbolic, t, row) as u32);
                self.rows.extend(rows);
                from = to;
            }
            self.panels.push(Panel {
                start: node.start(),
                columns: symbolic.supernode_end()[s] as usize - node.start(),
                height: height(symbolic, s),
                value: symbolic.col_ptr_for_val()[s] as usize,
                targets_end: self.targets.len(),
            });
        }
    }

    /// Values of the largest update.
    pub fn largest(&self) -> usize {
        self.panels.iter().map(|p| (p.height - p.columns).pow(2)).max().unwrap_or(0)
    }

    /// Factorises the matrix whose values stand in `factor.values`; `update` has
    /// [`Updates::largest`] values. Every pivot must lie in the half plane around `direction`; the
    /// unknown of one that does not is the error.
    pub fn factorise(
        &self,
        factor: &mut Factor<c64>,
        update: &mut [c64],
        direction: c64,
    ) -> Result<(), usize> {
        let values = &mut factor.factor;
        values.fill(c64::new(0.0, 0.0));
        for (&place, value) in self.places.iter().zip(&factor.values) {
            values[place as usize] = *value;
        }
        let mut first = 0;
        for panel in &self.panels {
            let own = &mut values[panel.value..panel.value + panel.height * panel.columns];
            let below = panel.height - panel.columns;
            let whole = MatMut::from_column_major_slice_mut(own, panel.height, panel.columns);
            let (mut top, mut bottom) = whole.split_at_row_mut(panel.columns);
            cholesky(top.rb_mut(), direction).map_err(|k| panel.start + k)?;
            if below > 0 {
                let (l11, l21) = (top.rb(), bottom.rb_mut().transpose_mut());
                solve_lower_triangular_in_place(l11, l21, Par::Seq);
                let update = &mut update[..below * below];
                let square = MatMut::from_column_major_slice_mut(update, below, below);
                add_square(square, Accum::Replace, bottom.rb(), 1.0);
            }
            for target in &self.targets[first..panel.targets_end] {
                let rows = &self.rows[target.rows..target.rows + below - target.from];
                target.subtract(values, rows, update, below);
            }
            first = panel.targets_end;
        }
        Ok(())
    }

    /// Largest `(|L| |L^T|)_ii / |a_ii|`: one for positive definite real matrices. The backward
    /// error of a solve without pivoting is at most this, times roundings (Higham, "Accuracy and
    /// Stability of Numerical Algorithms", 2nd ed., theorem 9.3).
    pub fn growth(&self, factor: &Factor<c64>, pattern: &Assembly, solver: &Solver) -> f64 {
        let SymbolicCholeskyRaw::Supernodal(symbolic) = solver.symbolic.raw() else { return 1.0 };
        let mut sums = vec![0.0; pattern.column_starts.len() - 1];
        for (s, panel) in self.panels.iter().enumerate() {
            let rows = symbolic.supernode(s);
            for j in 0..panel.columns {
                let column = &factor.factor[panel.value + j * panel.height..][..panel.height];
                for i in j..panel.columns {
                    sums[panel.start + i] += column[i].norm_sqr();
                }
                for (&row, l) in rows.pattern().iter().zip(&column[panel.columns..]) {
                    sums[row as usize] += l.norm_sqr();
                }
            }
        }
        // rows ascend within a column of the lower triangle: its first entry is the diagonal
        let diagonal = pattern.column_starts.iter().map(|&k| k as usize);
        let ratios = sums.iter().zip(diagonal).map(|(sum, k)| sum / factor.values[k].norm());
        ratios.fold(0.0, f64::max)
    }
}

impl Target {
    /// Takes its part of an update of `count` rows.
    fn subtract(&self, values: &mut [c64], rows: &[u32], update: &[c64], count: usize) {
        let panel = &mut values[self.value..];
        for j in self.from..self.to {
            let rows = &rows[j - self.from..];
            // rows of the target begin with its own columns
            let column = &mut panel[rows[0] as usize * self.height..][..self.height];
            for (&row, value) in rows.iter().zip(&update[j * count + j..(j + 1) * count]) {
                column[row as usize] -= *value;
            }
        }
    }
}

fn supernode_of_unknown(symbolic: &SymbolicSupernodalCholesky<u32>) -> Vec<u32> {
    let mut supernode_of = vec![0; symbolic.nrows()];
    for (s, (&from, &to)) in
        (0..).zip(symbolic.supernode_begin().iter().zip(symbolic.supernode_end()))
    {
        supernode_of[from as usize..to as usize].fill(s);
    }
    supernode_of
}

/// Rows of a supernode: its columns and the pattern below.
fn height(symbolic: &SymbolicSupernodalCholesky<u32>, s: usize) -> usize {
    let own = symbolic.supernode_end()[s] - symbolic.supernode_begin()[s];
    own as usize + symbolic.supernode(s).pattern().len()
}

/// Row of an unknown within a supernode that has it.
fn local_row(symbolic: &SymbolicSupernodalCholesky<u32>, s: usize, row: u32) -> usize {
    let (begin, end) = (symbolic.supernode_begin()[s], symbolic.supernode_end()[s]);
    if row < end {
        return (row - begin) as usize;
    }
    (end - begin) as usize + symbolic.supernode(s).pattern().partition_point(|&r| r < row)
}

/// `L L^T` of a dense block in its lower triangle, by halves; the column of a pivot outside the
/// half plane around `direction` is the error.
fn cholesky(a: MatMut<'_, c64>, direction: c64) -> Result<(), usize> {
    if a.ncols() <= LEAF {
        return cholesky_by_entries(a, direction);
    }
    let half = a.ncols() / 2;
    let (mut a11, _, mut a21, mut a22) = a.split_at_mut(half, half);
    cholesky(a11.rb_mut(), direction)?;
    solve_lower_triangular_in_place(a11.rb(), a21.rb_mut().transpose_mut(), Par::Seq);
    add_square(a22.rb_mut(), Accum::Add, a21.rb(), -1.0);
    cholesky(a22, direction).map_err(|k| half + k)
}

fn cholesky_by_entries(mut a: MatMut<'_, c64>, direction: c64) -> Result<(), usize> {
    let count = a.ncols();
    for j in 0..count {
        let pivot = a[(j, j)];
        let sound = (pivot * direction.conj()).re > 0.0 && pivot.is_finite();
        if !sound {
            return Err(j);
        }
        let root = square_root(pivot);
        a[(j, j)] = root;
        let inverse = root.inv();
        for i in j + 1..count {
            a[(i, j)] *= inverse;
        }
        for k in j + 1..count {
            let factor = a[(k, j)];
            for i in k..count {
                let product = a[(i, j)] * factor;
                a[(i, k)] -= product;
            }
        }
    }
    Ok(())
}

/// Lower triangle of `square`: `(+) scale l l^T`.
fn add_square(square: MatMut<'_, c64>, begin: Accum, l: MatRef<'_, c64>, scale: f64) {
    triangular::matmul(
        square,
        BlockStructure::TriangularLower,
        begin,
        l,
        BlockStructure::Rectangular,
        l.transpose(),
        BlockStructure::Rectangular,
        c64::new(scale, 0.0),
        Par::Seq,
    );
}

/// The root in the right half plane, without sines and cosines; real numbers keep every bit.
fn square_root(number: c64) -> c64 {
    let size = number.norm();
    if number.re >= 0.0 {
        let re = (0.5 * (size + number.re)).sqrt();
        return c64::new(re, 0.5 * number.im / re);
    }
    let im = (0.5 * (size - number.re)).sqrt().copysign(number.im);
    c64::new(0.5 * number.im / im, im)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roots_in_every_quadrant() {
        for number in [(4.0, 0.0), (3.0, 4.0), (3.0, -4.0), (-3.0, 4.0), (-3.0, -4.0), (0.0, 2.0)] {
            let number = c64::new(number.0, number.1);
            let root = square_root(number);
            // a few roundings
            assert!((root * root - number).norm() < 8.0 * f64::EPSILON * number.norm(), "{number}");
            assert!(root.re > 0.0);
        }
        // (9/4)^2: exact
        assert_eq!(square_root(c64::new(5.0625, 0.0)), c64::new(2.25, 0.0));
    }

    /// A dense block larger than a leaf, against its own product.
    #[test]
    fn a_dense_block_is_the_product_of_its_factor() {
        let n = 3 * LEAF + 1;
        let entry = |i: usize, j: usize| {
            let (i, j) = (i.min(j) as f64, i.max(j) as f64);
            let off = c64::new((1.3 * i + 0.7 * j).sin(), (0.4 * i - 1.1 * j).cos());
            // dominant: real and imaginary parts are positive definite
            if i == j { c64::new(n as f64, 0.8 * n as f64) } else { 0.4 * off }
        };
        let mut a = Mat::<c64>::from_fn(n, n, entry);
        cholesky(a.as_mut(), c64::new(1.0, 0.0)).unwrap_or_else(|k| unreachable!("column {k}"));
        for i in 0..n {
            for j in 0..=i {
                let sum: c64 = (0..=j).map(|k| a[(i, k)] * a[(j, k)]).sum();
                // 25 products of size at most n
                assert!((sum - entry(i, j)).norm() < 1e-13 * n as f64, "({i}, {j})");
            }
        }
    }

    #[test]
    fn a_pivot_on_the_wrong_side_is_named() {
        let mut a = Mat::<c64>::from_fn(20, 20, |i, j| {
            let side = if i == 17 { -1.0 } else { 1.0 };
            c64::new(if i == j { side } else { 0.0 }, 0.0)
        });
        assert_eq!(cholesky(a.as_mut(), c64::new(1.0, 0.0)), Err(17));
    }
}
