//! Exact dual step of total variation in time and of the bounds, for one unknown over all frames.
//!
//! The dual `z = D_t' q_t + p` is updated as a whole:
//!
//! ```text
//! v  = z + Sigma x-
//! u  = argmin  sum_t (sigma_t u_t^2 / 2 - v_t u_t) + lambda_time area sum_t |u_{t+1} - u_t|
//!      with  lower <= u <= upper
//! z^ = v - Sigma u
//! ```
//!
//! A gradient step on `q_t` carries a force by one frame an iteration, which is slow where the image does
//! not change over many frames, as with a large `lambda_time`. The exact step balances all frames at once,
//! and as its operator is the identity (norm 1 instead of 4) it leaves larger steps to the other duals.
//!
//! Without bounds, `u` is the slope of a taut string, the shortest line from end to end of a tube around
//! the sums of `v` (Davies, Kovac, *Ann. Statist.* 29 (2001) 1). Clipping `u` to the bounds is exact: the
//! signs of its changes remain valid, and the difference is the dual of the bounds.

use super::float::Float;
use super::lanes::Project;
use super::operators::Operators;
use super::problem::Problem;

/// Largest force of changes in time, relative to that of differences in space, from which on the duals in
/// time take exact steps. These need 2 to 4 times fewer iterations (reference problem
/// of 32 x 32 to 1e-3, with the bounds of then: 259 and 674 with 10 times the weight in time, 329 and 1 161 with
/// 30, 398 and 1 497 with 100), which cost up to twice as much; with equal weights they save a twentieth.
const EXACT_FROM: f64 = 8.0;
/// Largest number of ranks for which they always do: with data of a few channels most pixels follow each
/// other in time (one row of the reference problem of 32 x 32 to 1e-2: 436 iterations instead of 4 388).
const EXACT_RANK: usize = 4;

/// Returns whether the exact step pays.
pub(crate) fn is_exact<T: Project>(ops: &Operators<T>, problem: &Problem<'_>) -> bool {
    let space = problem.lambda_space * ops.mean_radius;
    let in_time = problem.lambda_time * ops.mean_area / space.max(f64::MIN_POSITIVE);
    problem.linked() && (ops.rank <= EXACT_RANK || in_time >= EXACT_FROM)
}

/// Input, result and memory of a step, `[frame]`.
#[derive(Debug, Clone)]
pub(crate) struct Chain<T> {
    /// `sigma`.
    pub(super) weights: Vec<T>,
    /// `v`.
    pub(super) data: Vec<T>,
    /// `u`, before clipping.
    pub(super) slopes: Vec<T>,
    /// `q_t`; 0 at the last frame.
    pub(super) dual: Vec<T>,
    /// Sums over the frames so far of the weights, and of the data less their mean.
    width: Vec<T>,
    sums: Vec<T>,
}

/// Slope that keeps the string in the tube so far, and the frame at which it touches the tube.
#[derive(Clone, Copy)]
struct Touch<T> {
    slope: T,
    frame: usize,
}

impl<T: Float> Chain<T> {
    pub(crate) fn new(frames: usize) -> Self {
        let zeros = || vec![T::default(); frames];
        Self {
            weights: zeros(),
            data: zeros(),
            slopes: zeros(),
            dual: zeros(),
            width: zeros(),
            sums: zeros(),
        }
    }

    /// Computes slopes and dual for a tube of the given radius.
    #[inline(always)]
    pub(super) fn pull(&mut self, radius: T) {
        let frames = self.data.len();
        let zero = T::default();
        let (mut width, mut total) = (zero, zero);
        for ((sum, sigma), v) in self.width.iter_mut().zip(&self.weights).zip(&self.data) {
            width += *sigma;
            total += *v;
            *sum = width;
        }
        let mean = total / width;
        let (mut sum, mut excess) = (zero, zero);
        let rows = self.sums.iter_mut().zip(&self.weights).zip(&self.data);
        for ((out, sigma), v) in rows {
            // of the frame before: the last sum is 0 up to rounding
            excess = excess.max(sum.abs() - radius);
            sum += (zero - *sigma).mul_add(mean, *v);
            *out = sum;
        }
        if excess <= zero {
            self.slopes.fill(mean);
            self.dual.iter_mut().zip(&self.sums).for_each(|(q, sum)| *q = zero - *sum);
        } else {
            self.bend(radius, mean);
        }
        self.dual[frames - 1] = zero;
    }

    /// Pulls the string around the corners of the tube, from one bend to the next.
    #[inline(always)]
    fn bend(&mut self, radius: T, mean: T) {
        let (mut first, mut from, mut height) = (0, T::default(), T::default());
        while first < self.data.len() {
            let (touch, side) = self.next_bend(first, from, height, radius);
            let Touch { slope, frame: last } = touch;
            for t in first..last {
                let string = slope.mul_add(self.width[t] - from, height);
                self.slopes[t] = mean + slope;
                self.dual[t] = string - self.sums[t];
            }
            let end = side * radius;
            self.slopes[last] = mean + slope;
            self.dual[last] = end;
            (first, from, height) = (last + 1, self.width[last], self.sums[last] + end);
        }
    }

    /// Returns the next bend of the string after one before frame `first`, and on which side of the tube
    /// it is: 1 above, -1 below, 0 at the end.
    #[inline(always)]
    fn next_bend(&self, first: usize, from: T, height: T, radius: T) -> (Touch<T>, T) {
        let (zero, one) = (T::default(), T::from_f64(1.0));
        let end = self.data.len() - 1;
        let slopes = |t: usize| {
            let per_width = one / (self.width[t] - from);
            let wide = if t == end { zero } else { radius };
            let own = if t == end { zero } else { self.sums[t] } - height;
            [(own - wide) * per_width, (own + wide) * per_width]
        };
        let [low, high] = slopes(first);
        let mut least = Touch { slope: low, frame: first };
        let mut most = Touch { slope: high, frame: first };
        for frame in first + 1..=end {
            let [low, high] = slopes(frame);
            if low > most.slope {
                return (most, one);
            }
            if high < least.slope {
                return (least, zero - one);
            }
            if high <= most.slope {
                most = Touch { slope: high, frame };
            }
            if low >= least.slope {
                least = Touch { slope: low, frame };
            }
        }
        (Touch { slope: most.slope, frame: end }, zero)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fixtures::Random;

    /// `v = Sigma u + D_t' q` with `q` in its interval, and at its end where `u` changes: the conditions
    /// for the minimum.
    #[test]
    fn the_string_satisfies_the_conditions_of_the_minimum() {
        let mut random = Random::new(2);
        for frames in [1, 2, 3, 8, 20, 100] {
            for radius in [0.0, 0.05, 0.7, 5.0, 1e3] {
                let mut chain = Chain::<f64>::new(frames);
                for t in 0..frames {
                    chain.weights[t] = if t / 8 % 2 == 0 { 0.3 } else { 2.0 };
                    chain.data[t] = random.normal();
                }
                chain.pull(radius);
                let mut before = 0.0;
                for t in 0..frames {
                    let limit = if t + 1 < frames { radius } else { 0.0 };
                    let q = chain.dual[t];
                    let sum = chain.weights[t].mul_add(chain.slopes[t], before - q);
                    assert!((sum - chain.data[t]).abs() < 1e-11, "{frames} {radius}");
                    assert!(q.abs() <= limit + 1e-11, "{frames} {radius}: {q} above {limit}");
                    if t + 1 < frames {
                        let change = chain.slopes[t + 1] - chain.slopes[t];
                        let taut = limit * change.abs() - q * change;
                        assert!(taut.abs() < 1e-11, "{frames} {radius}: {change} with {q}");
                    }
                    before = q;
                }
            }
        }
    }
}
