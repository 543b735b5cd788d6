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
use faer::{Col, ColRef, Mat, MatRef};

/// Smallest slope of the residual, relative to the norm of the unknown's column, that counts as a reduction.
const LEAST_SLOPE: f64 = 1e-10;
/// Most releases per unknown: far more than needed, in case of a cycle.
const RELEASES: usize = 3;

/// Returns the smallest residual norm; `None` if it is at most `enough`, or if it cannot be told, with as many free
/// unknowns as rows.
pub(crate) fn least_residual(
    a: MatRef<'_, f64>,
    b: &[f64],
    bounds: [f64; 2],
    enough: f64,
) -> Option<f64> {
    let (n, b, [lower, upper]) = (a.ncols(), ColRef::from_slice(b), bounds);
    let mut x = Col::full(n, if lower.abs() <= upper.abs() { lower } else { upper });
    let mut free = Vec::new();
    // an unknown whose release gained nothing, because its column depends on the free ones
    let mut vain = vec![false; n];
    for _ in 0..RELEASES * n + 1 {
        let residual = b - a * &x;
        let size = residual.norm_l2();
        if size <= enough || !size.is_finite() {
            return None;
        }
        let slope = |p: usize| {
            let inwards = if x[p] == lower { 1.0 } else { -1.0 };
            let along = inwards * (a.col(p).transpose() * &residual);
            if free.contains(&p) { 0.0 } else { along / a.col(p).norm_l2().max(1e-300) }
        };
        let slopes = (0..n).filter(|&p| !vain[p]).map(|p| (p, slope(p)));
        let (best, slope) = slopes.max_by(|x, y| x.1.total_cmp(&y.1))?;
        if slope <= LEAST_SLOPE * size {
            return Some(size);
        }
        let before = x[best];
        free.push(best);
        settle(a, b, bounds, &mut x, &mut free)?;
        vain[best] = !free.contains(&best) && x[best] == before;
        if !vain[best] {
            vain.fill(false);
        }
    }
    None
}

/// Moves the free unknowns to their least squares; those that would leave the bounds stop there, one after the other.
/// Returns `None` if there are more of them than rows.
fn settle(
    a: MatRef<'_, f64>,
    b: ColRef<'_, f64>,
    [lower, upper]: [f64; 2],
    x: &mut Col<f64>,
    free: &mut Vec<usize>,
) -> Option<()> {
    while !free.is_empty() {
        if free.len() > b.nrows() {
            return None;
        }
        let columns = Mat::from_fn(b.nrows(), free.len(), |i, k| a[(i, free[k])]);
        let residual = b - a * &*x;
        let change = columns.col_piv_qr().solve_lstsq(residual.as_mat());
        let change = |k: usize| change[(k, 0)];
        // the share of the change that is within the bounds
        let share = |(k, &p): (usize, &usize)| {
            let (from, to) = (x[p], x[p] + change(k));
            let room = to.clamp(lower, upper) - from;
            if (lower..=upper).contains(&to) { f64::INFINITY } else { room / change(k) }
        };
        let shares: Vec<f64> = free.iter().enumerate().map(share).collect();
        let step = shares.iter().fold(1.0_f64, |least, share| least.min(*share));
        if !change(0).is_finite() {
            return None;
        }
        for (k, &p) in free.iter().enumerate() {
            let to = if shares[k] <= step { x[p] + change(k) } else { x[p] + step * change(k) };
            x[p] = to.clamp(lower, upper);
        }
        let mut shares = shares.into_iter();
        free.retain(|_| shares.next().is_none_or(|share| share > step));
        if step >= 1.0 {
            break;
        }
    }
    Some(())
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
            let found = residual(&x).iter().map(|r| r * r).sum::<f64>().sqrt();
            // the gradients fall as the square of the steps
            assert!(
                least <= found * (1.0 + 1e-9) && found <= least * (1.0 + 1e-4) + 1e-6,
                "{least} {found}"
            );
        }
    }
}
