//! Evidence for a touch together with what it does to electrodes, contacts and the fabric around it.
//!
//! A touch beyond the outer electrodes changes the voltages less by its own conductivity than by the electrodes that it
//! moves. Where the movement may happen without the touch, the touch is superfluous. So both are weighed as one
//! hypothesis, a touch of any strength with its normal actions `A` of variance 1, against neither:
//!
//! ```text
//! L = t' (I + A' A)^-1 t - ln det (I + A' A) + z^2,    t = A' y
//! ```
//!
//! with `z` the touch's own part of the whitened data `y` after its actions (0 if negative).

use super::dents::Dents;
use super::dictionary::Dictionary;
use super::electrodes::Electrodes;
use super::places::Places;
use super::vectors::{dot, widest};
use super::whitening::Whitening;
use crate::geometry::distance_m;

/// Columns of a position: pressure on contacts, pull, drags along three axes, dent, and the touch's own response.
const COLUMNS: usize = 7;

/// Columns of each of the dents' positions.
#[derive(Debug, Clone)]
pub(super) struct Joint {
    rows: usize,
    /// Candidate positions.
    at: Vec<usize>,
    /// Whitened, as if no row were lost: `[position][column][row]`.
    columns: Vec<f64>,
    work: Vec<f64>,
    /// Positions of a scan and their evidence.
    found: Vec<(usize, f64)>,
}

/// Where a touch may be.
#[derive(Debug, Clone, Copy)]
pub(super) struct Found {
    /// Candidate position with most evidence.
    pub(super) place: usize,
    pub(super) evidence: f64,
    /// Mean and covariance of the position, metres, with equal prior probability everywhere.
    pub(super) mean_m: [f64; 3],
    pub(super) covariance_m2: [[f64; 3]; 3],
}

impl Found {
    /// Root of the largest variance of the position, metres.
    pub(super) fn std_m(&self) -> f64 {
        (0..3).map(|i| self.covariance_m2[i][i]).fold(0.0, f64::max).sqrt()
    }
}

impl Joint {
    /// Computes the whitened actions of touches at all positions of `dents`; empty if dents are not
    /// known.
    pub(super) fn new(
        dents: &Dents,
        electrodes: &Electrodes,
        places: &Places,
        dictionary: &Dictionary,
        whitening: &Whitening,
    ) -> Self {
        let (rows, at) = (whitening.rows(), dents.at.clone());
        let mut columns = Vec::with_capacity(at.len() * COLUMNS * rows);
        for &place in &at {
            electrodes.columns_of(place, places, dents, whitening, &mut columns);
            columns.extend_from_slice(dictionary.own(place)[0]);
        }
        Self {
            rows,
            found: Vec::with_capacity(at.len()),
            at,
            columns,
            work: vec![0.0; COLUMNS * rows],
        }
    }

    /// Scans positions within `reach_m` of a point for which `is_allowed`; `y` is mapped data, of which each unit of
    /// chi^2 counts as one over `excess`.
    pub(super) fn scan(
        &mut self,
        whitening: &Whitening,
        places: &Places,
        (y, excess): (&[f64], f64),
        basis: &[f64],
        (around_m, reach_m): ([f64; 3], f64),
        is_allowed: impl Fn([f64; 3]) -> bool,
    ) -> Option<Found> {
        self.found.clear();
        for (&place, columns) in self.at.iter().zip(self.columns.chunks_exact(COLUMNS * self.rows))
        {
            let at_m = places.at[place].position_m;
            if distance_m(at_m, around_m) <= reach_m && is_allowed(at_m) {
                self.work.copy_from_slice(columns);
                whitening.project_all(&mut self.work);
                let found = widest(
                    #[inline(always)]
                    || {
                        for column in self.work.chunks_exact_mut(self.rows) {
                            remove_each(column, basis);
                        }
                        evidence(&self.work, y)
                    },
                );
                self.found.push((place, found));
            }
        }
        let (place, most) = self.found.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let (mut sum, mut mean_m, mut squares) = (0.0, [0.0; 3], [[0.0; 3]; 3]);
        for (place, evidence) in &self.found {
            let weight = (0.5 * (evidence - most) / excess).exp();
            let at_m = places.at[*place].position_m;
            sum += weight;
            for i in 0..3 {
                mean_m[i] += weight * at_m[i];
                (0..3).for_each(|j| squares[i][j] += weight * at_m[i] * at_m[j]);
            }
        }
        mean_m.iter_mut().for_each(|m| *m /= sum);
        let covariance_m2 = std::array::from_fn(|i| {
            std::array::from_fn(|j| squares[i][j] / sum - mean_m[i] * mean_m[j])
        });
        Some(Found { place, evidence: most, mean_m, covariance_m2 })
    }
}

/// Removes the components along orthonormal vectors, one after the other.
pub(super) fn remove_all(column: &mut [f64], basis: &[f64]) {
    widest(
        #[inline(always)]
        || remove_each(column, basis),
    );
}

#[inline(always)]
fn remove_each(column: &mut [f64], basis: &[f64]) {
    for unit in basis.chunks_exact(column.len()) {
        let part = dot(unit, column);
        column.iter_mut().zip(unit).for_each(|(c, u)| *c -= part * u);
    }
}

/// Computes `L` for mapped columns and data.
#[inline(always)]
fn evidence(columns: &[f64], y: &[f64]) -> f64 {
    let column = |k: usize| &columns[k * y.len()..(k + 1) * y.len()];
    let mut factor = [[0.0; COLUMNS]; COLUMNS];
    let mut z = [0.0; COLUMNS];
    let mut found = 0.0;
    for i in 0..COLUMNS {
        for j in 0..i {
            let part: f64 = (0..j).map(|k| factor[i][k] * factor[j][k]).sum();
            factor[i][j] = (dot(column(i), column(j)) - part) / factor[j][j];
        }
        let is_own = i + 1 == COLUMNS;
        let square = dot(column(i), column(i));
        let left = square - (0..i).map(|k| factor[i][k].powi(2)).sum::<f64>();
        let prior = if is_own { 0.0 } else { 1.0 };
        factor[i][i] = (prior + left.max(1e-6 * square)).sqrt().max(f64::MIN_POSITIVE);
        let part: f64 = (0..i).map(|k| factor[i][k] * z[k]).sum();
        z[i] = (dot(column(i), y) - part) / factor[i][i];
        found += match is_own {
            true => z[i].max(0.0).powi(2),
            false => z[i].powi(2) - 2.0 * factor[i][i].ln(),
        };
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::{Mat, Side};
    use fixtures::Random;

    /// The evidence is that of the covariance `I + A A'`, factorised as a whole; a touch of negative strength has none of
    /// its own.
    #[test]
    fn evidence_is_that_of_the_whole_covariance() {
        let mut random = Random::new(8);
        let n = 20;
        let mut signs = [0; 2];
        for _ in 0..20 {
            let columns: Vec<f64> = (0..COLUMNS * n).map(|_| 0.7 * random.normal()).collect();
            let y: Vec<f64> = (0..n).map(|_| 3.0 * random.normal()).collect();
            let action = |i: usize, k: usize| columns[k * n + i];
            let covariance = Mat::from_fn(n, n, |i, j| {
                let of_actions: f64 = (0..COLUMNS - 1).map(|k| action(i, k) * action(j, k)).sum();
                of_actions + if i == j { 1.0 } else { 0.0 }
            });
            let factor = covariance.llt(Side::Lower).unwrap();
            let log_determinant: f64 = (0..n).map(|i| 2.0 * factor.L()[(i, i)].ln()).sum();
            let mut whitened = Mat::from_fn(n, 2, |i, k| [y[i], action(i, COLUMNS - 1)][k]);
            faer::linalg::triangular_solve::solve_lower_triangular_in_place(
                factor.L(),
                whitened.as_mut(),
                faer::Par::Seq,
            );
            let product = |a: usize, b: usize| -> f64 {
                (0..n).map(|i| whitened[(i, a)] * whitened[(i, b)]).sum()
            };
            let own = product(0, 1).max(0.0).powi(2) / product(1, 1);
            signs[usize::from(own > 0.0)] += 1;
            let wanted = dot(&y, &y) - product(0, 0) - log_determinant + own;
            let found = evidence(&columns, &y);
            // rounding of two factorisations
            assert!((found - wanted).abs() < 1e-9 * dot(&y, &y), "{found} {wanted}");
        }
        assert!(signs.iter().all(|count| *count > 3), "{signs:?}");
    }
}
