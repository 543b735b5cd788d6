//! The smallest residual of images within bounds, to tell constraints that no image can meet.
//!
//! ```text
//! min |A x - b|   with   lower <= x <= upper
//! ```
//!
//! by active sets (Stark, Parker, *Comput. Stat.* 10 (1995) 129): unknowns are at a bound or free; the one whose
//! release reduces the residual most becomes free, the least squares problem of the free ones is solved by QR, and
//! free ones that would leave the bounds return to them. At the end no release reduces the residual. A release costs
//! one product with `A` and one with `A'`, and a QR of at most as many columns as `A` has rows.

use faer::linalg::solvers::SolveLstsq;
use faer::{Mat, MatRef};

/// Smallest slope of the residual, relative to the norm of the unknown's column, that counts as a reduction.
const LEAST_SLOPE: f64 = 1e-10;
/// Most releases per unknown: far more than needed, in case of a cycle.
const RELEASES: usize = 3;

/// Place of an unknown.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Place {
    Lower,
    Upper,
    Free,
}

/// Returns the smallest residual norm; `None` if it is at most `enough`, or if it cannot be told, with as many free
/// unknowns as rows.
pub(crate) fn least_residual(
    a: MatRef<'_, f64>,
    b: &[f64],
    bounds: [f64; 2],
    enough: f64,
) -> Option<f64> {
    let n = a.ncols();
    let [lower, upper] = bounds;
    let start = if lower.abs() <= upper.abs() { Place::Lower } else { Place::Upper };
    let mut search = Search {
        a,
        b,
        bounds,
        places: vec![start; n],
        values: vec![if start == Place::Lower { lower } else { upper }; n],
    };
    let norms: Vec<f64> = (0..n).map(|p| a.col(p).norm_l2()).collect();
    // an unknown whose release gained nothing, because its column depends on the free ones
    let mut vain = vec![false; n];
    for _ in 0..RELEASES * n + 1 {
        let residual = search.residual();
        let size = norm(&residual);
        if size <= enough || !size.is_finite() {
            return None;
        }
        let slope = |p: usize| {
            let along: f64 = (0..b.len()).map(|i| a[(i, p)] * residual[i]).sum();
            match search.places[p] {
                Place::Lower => along,
                Place::Upper => -along,
                Place::Free => 0.0,
            }
        };
        let slopes = (0..n).filter(|&p| !vain[p]).map(|p| (p, slope(p) / norms[p].max(1e-300)));
        let (best, slope) = slopes.max_by(|x, y| x.1.total_cmp(&y.1))?;
        if slope <= LEAST_SLOPE * size {
            return Some(size);
        }
        let before = search.places[best];
        search.places[best] = Place::Free;
        search.settle()?;
        vain[best] = search.places[best] == before;
        if !vain[best] {
            vain.fill(false);
        }
    }
    None
}

fn norm(values: &[f64]) -> f64 {
    values.iter().map(|v| v * v).sum::<f64>().sqrt()
}

/// State of a search.
struct Search<'a> {
    a: MatRef<'a, f64>,
    b: &'a [f64],
    bounds: [f64; 2],
    places: Vec<Place>,
    values: Vec<f64>,
}

impl Search<'_> {
    /// Returns `b - A x` with the unknowns that `counts`.
    fn rest(&self, counts: impl Fn(Place) -> bool) -> Vec<f64> {
        let mut rest = self.b.to_vec();
        for (p, (place, value)) in self.places.iter().zip(&self.values).enumerate() {
            if *value != 0.0 && counts(*place) {
                rest.iter_mut().enumerate().for_each(|(i, r)| *r -= self.a[(i, p)] * value);
            }
        }
        rest
    }

    fn residual(&self) -> Vec<f64> {
        self.rest(|_| true)
    }

    /// Moves the free unknowns to their least squares, or as far as the bounds allow, until all are within bounds.
    /// Returns `None` if there are more of them than rows.
    fn settle(&mut self) -> Option<()> {
        let [lower, upper] = self.bounds;
        loop {
            let free: Vec<usize> =
                (0..self.places.len()).filter(|&p| self.places[p] == Place::Free).collect();
            if free.is_empty() {
                return Some(());
            }
            if free.len() > self.b.len() {
                return None;
            }
            let fixed = self.rest(|place| place != Place::Free);
            let columns = Mat::from_fn(self.b.len(), free.len(), |i, k| self.a[(i, free[k])]);
            let right = Mat::from_fn(self.b.len(), 1, |i, _| fixed[i]);
            let wanted = columns.col_piv_qr().solve_lstsq(&right);
            // the largest step towards the least squares within bounds
            let mut step = 1.0_f64;
            for (k, &p) in free.iter().enumerate() {
                let (from, to) = (self.values[p], wanted[(k, 0)]);
                let bound = if to < lower { lower } else { upper };
                if to < lower || to > upper {
                    step = step.min((bound - from) / (to - from));
                }
            }
            if !step.is_finite() {
                return None;
            }
            for (k, &p) in free.iter().enumerate() {
                let (from, to) = (self.values[p], wanted[(k, 0)]);
                let (reached, out) = (from + step * (to - from), to < lower || to > upper);
                self.values[p] = reached.clamp(lower, upper);
                let bound = if to < lower { lower } else { upper };
                // exactly those that limited the step
                if out && (bound - from) / (to - from) <= step {
                    self.values[p] = bound;
                    self.places[p] = if to < lower { Place::Lower } else { Place::Upper };
                }
            }
            if step >= 1.0 {
                return Some(());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn residuals_known_in_closed_form() {
        // one row: any value is reached from 0 up, nothing below
        let one = Mat::from_fn(1, 2, |_, p| [1.0, 2.0][p]);
        let up = [0.0, f64::INFINITY];
        assert_eq!(least_residual(one.as_ref(), &[3.0], up, 1e-9), None);
        assert_eq!(least_residual(one.as_ref(), &[-3.0], up, 1e-9), Some(3.0));
        assert_eq!(least_residual(one.as_ref(), &[9.0], [0.0, 2.0], 1e-9), Some(3.0));
        assert_eq!(least_residual(one.as_ref(), &[3.0], [f64::NEG_INFINITY, -1.0], 0.0), Some(6.0));
        // two directions, of which one is excluded by the bounds
        let two = Mat::from_fn(2, 2, |i, p| if i == p { 1.0 } else { 0.0 });
        assert_eq!(least_residual(two.as_ref(), &[2.0, -5.0], up, 1e-9), Some(5.0));
    }

    #[test]
    fn no_image_within_bounds_has_a_smaller_residual() {
        let mut random = fixtures::Random::new(5);
        for round in 0..200 {
            let (rows, n) = (2 + round % 7, 3 + round % 12);
            let a = Mat::from_fn(rows, n, |_, _| random.normal() + 0.5);
            let b: Vec<f64> = (0..rows).map(|_| random.normal() - 1.0).collect();
            let bounds = [[0.0, f64::INFINITY], [-0.2, 0.3], [f64::NEG_INFINITY, -0.1]][round % 3];
            let Some(least) = least_residual(a.as_ref(), &b, bounds, 1e-9) else { continue };
            // accelerated projected gradients, an independent method
            let rate = 1.0 / a.as_ref().squared_norm_l2();
            let mut x = vec![0.0_f64.clamp(bounds[0], bounds[1]); n];
            let mut ahead = x.clone();
            let residual = |x: &[f64]| -> Vec<f64> {
                (0..rows).map(|i| (0..n).map(|p| a[(i, p)] * x[p]).sum::<f64>() - b[i]).collect()
            };
            for step in 0..20_000 {
                let r = residual(&ahead);
                for (p, (x, ahead)) in x.iter_mut().zip(&mut ahead).enumerate() {
                    let slope: f64 = (0..rows).map(|i| a[(i, p)] * r[i]).sum();
                    let new = (*ahead - rate * slope).clamp(bounds[0], bounds[1]);
                    *ahead = new + step as f64 / (step as f64 + 3.0) * (new - *x);
                    *x = new;
                }
            }
            let found = norm(&residual(&x));
            // the gradients fall as the square of the steps
            assert!(
                least <= found * (1.0 + 1e-9) && found <= least * (1.0 + 1e-4) + 1e-6,
                "{least} {found}"
            );
        }
    }
}
