//! Covariance of everything that is not a touch: noise, electrode movement, contacts, sheet.

use super::vectors::{dot, norm, shrink, widest};
use crate::InverseError;
use crate::check::check_positive;
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Mat, MatRef, Par, Side};

/// A lost row that the other rows almost determine has no direction of its own.
const DEPENDENT: f64 = 1e-10;

/// A local unknown whose whitened column is shorter than this is ignored.
const FAINT: f64 = 1e-3;

/// `W = L^-1` of the covariance `C = L L'` of the rows, and the rows that are lost.
///
/// Further unknowns can be free for a time ([`set_free`](Whitening::set_free)): each is whitened away after the
/// others, `y - (1 - 1 / sqrt(1 + |u|^2)) u u' y / |u|^2` for a column `u`, for `4 n` flops per vector.
///
/// A lost row has infinite variance: of whitened data `y` and columns `d`, only the part orthogonal to
/// `W e_i` of each lost row `i` remains. The result equals that of dropping the rows and factorising again,
/// for `2 n k` flops per vector.
#[derive(Debug, Clone, Default)]
pub(super) struct Whitening {
    rows: usize,
    /// Noise of each row, squared volts.
    variances: Vec<f64>,
    /// Expected squared length of whitened noise if the unknowns are zero, of all rows and without the lost
    /// ones.
    expected_of_all: f64,
    expected: f64,
    is_expected: bool,
    /// Lower triangle of `W`, row by row.
    packed: Vec<f64>,
    lost: Vec<usize>,
    /// Whitened columns of the local unknowns, `[unknown][row]`, as if no row were lost, ...
    local: Vec<f64>,
    /// ... and without the lost rows.
    local_left: Vec<f64>,
    /// Combinations of local unknowns that are free, `[combination][unknown]`, ...
    free: Vec<f64>,
    /// ... and their whitened columns without the lost rows.
    free_columns: Vec<f64>,
    /// Further whitened columns that are free, as if no row were lost: `[column][row]`.
    further: Vec<f64>,
    /// Unit vectors by which data are mapped, in this order: each scales the component along it.
    /// The directions of lost rows come first and are removed.
    directions: Vec<f64>,
    kept: Vec<f64>,
    /// Number of changes of the directions.
    state: u64,
    work: Vec<f64>,
    back: Vec<f64>,
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
        Ok(Self {
            rows,
            variances: variances.to_vec(),
            expected_of_all: expected,
            expected,
            is_expected: true,
            packed,
            work: vec![0.0; rows],
            back: vec![0.0; rows],
            ..Self::default()
        })
    }

    pub(super) fn rows(&self) -> usize {
        self.rows
    }

    /// Identifies the set of lost rows and free unknowns; the number changes with each change of
    /// them.
    pub(super) fn state(&self) -> u64 {
        self.state
    }

    /// Expected squared length of whitened noise without lost rows if the unknowns are zero.
    pub(super) fn expected(&self) -> f64 {
        self.expected
    }

    /// Number of rows present.
    pub(super) fn present(&self) -> usize {
        self.rows - self.kept.iter().filter(|kept| **kept == 0.0).count()
    }

    /// Logarithm of the determinant by which the free unknowns enlarge the covariance of the rows present.
    pub(super) fn log_determinant(&self) -> f64 {
        self.kept.iter().filter(|kept| **kept > 0.0).map(|kept| -2.0 * kept.ln()).sum()
    }

    /// Whitened columns of the local unknowns, as if no row were lost.
    pub(super) fn local_of_all(&self) -> impl Iterator<Item = &[f64]> {
        self.local.chunks_exact(self.rows)
    }

    /// Computes `W x` in `n^2` flops.
    pub(super) fn apply(&self, x: &[f64], out: &mut [f64]) {
        widest(
            #[inline(always)]
            || {
                let mut start = 0;
                for (i, value) in out.iter_mut().enumerate() {
                    *value = dot(&self.packed[start..=start + i], &x[..=i]);
                    start += i + 1;
                }
            },
        );
    }

    /// Adds local unknowns, one column each, volts per standard deviation: combinations of them can be free
    /// for a time.
    pub(super) fn with_local(mut self, unknowns: MatRef<'_, f64>) -> Self {
        let mut column = vec![0.0; self.rows];
        for unknown in unknowns.col_iter() {
            let from = self.local.len();
            self.local.resize(from + self.rows, 0.0);
            column.iter_mut().zip(unknown.iter()).for_each(|(c, u)| *c = *u);
            let mut whitened = std::mem::take(&mut self.work);
            self.apply(&column, &mut whitened);
            self.local[from..].copy_from_slice(&whitened);
            self.work = whitened;
        }
        self.local_left.clone_from(&self.local);
        self
    }

    /// Maps a whitened vector: removes the lost rows, and scales what free unknowns explain.
    pub(super) fn project(&self, y: &mut [f64]) {
        self.project_by(y, self.kept.len());
    }

    /// Maps several vectors, one after the other.
    pub(super) fn project_all(&self, vectors: &mut [f64]) {
        widest(
            #[inline(always)]
            || {
                for (direction, kept) in self.directions.chunks_exact(self.rows).zip(&self.kept) {
                    let vectors = vectors.chunks_exact_mut(self.rows);
                    vectors.for_each(|y| shrink(y, direction, *kept));
                }
            },
        );
    }

    /// The same by the first `count` directions.
    fn project_by(&self, y: &mut [f64], count: usize) {
        let directions = self.directions.chunks_exact(self.rows).zip(&self.kept).take(count);
        widest(
            #[inline(always)]
            || directions.for_each(|(direction, kept)| shrink(y, direction, *kept)),
        );
    }

    /// The transpose of [`project`](Self::project).
    pub(super) fn project_back(&self, y: &mut [f64]) {
        self.project_back_by(y, self.kept.len());
    }

    fn project_back_by(&self, y: &mut [f64], count: usize) {
        let directions = self.directions.chunks_exact(self.rows).zip(&self.kept).take(count);
        widest(
            #[inline(always)]
            || directions.rev().for_each(|(direction, kept)| shrink(y, direction, *kept)),
        );
    }

    /// Turns a projected residual into what the free unknowns explain of the rows, volts; nothing of lost
    /// rows.
    pub(super) fn explained(&self, projected: &[f64], work: &mut [f64], rows_v: &mut [f64]) {
        rows_v.copy_from_slice(projected);
        let directions = self.directions.chunks_exact(self.rows).zip(&self.kept);
        for (direction, kept) in directions.rev().filter(|(_, kept)| **kept > 0.0) {
            let part = (kept.recip() - 1.0) * dot(direction, rows_v);
            rows_v.iter_mut().zip(direction).for_each(|(y, u)| *y += part * u);
        }
        work.copy_from_slice(projected);
        self.project_back(work);
        rows_v.iter_mut().zip(&*work).for_each(|(y, left)| *y -= left);
        // solve W x = y
        let mut start = 0;
        for i in 0..self.rows {
            let (before, rest) = rows_v.split_at_mut(i);
            rest[0] =
                (rest[0] - dot(&self.packed[start..start + i], before)) / self.packed[start + i];
            start += i + 1;
        }
    }

    /// Returns the directions of the lost rows.
    pub(super) fn directions(&self) -> impl Iterator<Item = &[f64]> {
        let lost = self.kept.iter().take_while(|kept| **kept == 0.0).count();
        self.directions.chunks_exact(self.rows).take(lost)
    }

    /// Whitened columns of the local unknowns without the lost rows.
    pub(super) fn local(&self) -> impl Iterator<Item = &[f64]> {
        self.local_left.chunks_exact(self.rows)
    }

    /// Combinations of local unknowns that are free, `[combination][unknown]`.
    pub(super) fn combinations(&self) -> &[f64] {
        &self.free
    }

    /// Their whitened columns without the lost rows.
    pub(super) fn free_columns(&self) -> &[f64] {
        &self.free_columns
    }

    /// Expected square of whitened noise along a unit vector; `back` becomes the vector mapped back to rows.
    fn expected_along(&self, direction: &[f64], back: &mut [f64]) -> f64 {
        back.fill(0.0);
        widest(
            #[inline(always)]
            || {
                let mut start = 0;
                for (i, along) in direction.iter().enumerate() {
                    let row = &self.packed[start..=start + i];
                    back.iter_mut().zip(row).for_each(|(b, w)| *b += w * along);
                    start += i + 1;
                }
            },
        );
        self.variances.iter().zip(back).map(|(variance, b)| variance * *b * *b).sum()
    }

    /// Sets the lost rows and returns whether they have changed. No local unknown is free then.
    pub(super) fn lose(&mut self, lost: &[usize]) -> bool {
        if self.lost == lost {
            return false;
        }
        self.state += 1;
        self.lost.clear();
        self.lost.extend_from_slice(lost);
        self.free.clear();
        self.free_columns.clear();
        self.further.clear();
        self.directions.clear();
        self.kept.clear();
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
                self.kept.push(0.0);
            } else {
                self.directions.truncate(from);
            }
        }
        self.local_left.clone_from(&self.local);
        let mut local = std::mem::take(&mut self.local_left);
        local.chunks_exact_mut(self.rows).for_each(|column| self.project(column));
        self.local_left = local;
        self.is_expected = false;
        self.expect();
        true
    }

    /// Sets the combinations of local unknowns that are free, `[combination][unknown]`, and further whitened columns,
    /// `[column][row]`, each normal with variance 1, and returns whether they have changed.
    pub(super) fn set_free(&mut self, free: &[f64], further: &[f64]) -> bool {
        let is_changed = self.free(free, further);
        self.expect();
        is_changed
    }

    /// The same without the expected squared length of noise, for which [`expect`](Self::expect) is needed.
    pub(super) fn free(&mut self, free: &[f64], further: &[f64]) -> bool {
        if self.free == free && self.further == further {
            return false;
        }
        self.state += 1;
        self.further.clear();
        self.further.extend_from_slice(further);
        self.free.clear();
        self.free.extend_from_slice(free);
        let lost = self.kept.iter().take_while(|kept| **kept == 0.0).count();
        self.kept.truncate(lost);
        self.directions.truncate(lost * self.rows);
        let unknowns = self.local.len() / self.rows;
        self.free_columns.clear();
        let mut column = std::mem::take(&mut self.work);
        for shares in free.chunks_exact(unknowns.max(1)) {
            column.fill(0.0);
            for (share, unknown) in shares.iter().zip(self.local_left.chunks_exact(self.rows)) {
                if *share != 0.0 {
                    column.iter_mut().zip(unknown).for_each(|(c, u)| *c += share * u);
                }
            }
            self.free_columns.extend_from_slice(&column);
            self.free_along(&mut column);
        }
        for more in further.chunks_exact(self.rows) {
            column.copy_from_slice(more);
            self.free_along(&mut column);
        }
        self.work = column;
        self.is_expected = false;
        true
    }

    /// Frees one more whitened column.
    fn free_along(&mut self, column: &mut [f64]) {
        // whitened by those before
        self.project(column);
        let length = norm(column);
        if length > FAINT {
            self.directions.extend(column.iter().map(|c| c / length));
            self.kept.push((1.0 + length * length).sqrt().recip());
        }
    }

    /// Updates the expected squared length of noise.
    pub(super) fn expect(&mut self) {
        if std::mem::replace(&mut self.is_expected, true) {
            return;
        }
        let mut along = std::mem::take(&mut self.work);
        let mut back = std::mem::take(&mut self.back);
        self.expected = self.expected_of_all;
        for k in 0..self.kept.len() {
            along.copy_from_slice(&self.directions[k * self.rows..(k + 1) * self.rows]);
            self.project_back_by(&mut along, k);
            self.expected -= (1.0 - self.kept[k].powi(2)) * self.expected_along(&along, &mut back);
        }
        (self.work, self.back) = (along, back);
    }
}

#[cfg(test)]
mod tests;
