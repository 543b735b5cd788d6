//! Backward substitution within one front, compiled like [`super::front`].

#![allow(clippy::needless_range_loop, reason = "rows and columns of small tiles, by their indices")]

use super::tile::{LANES, WIDE};
use crate::sparse::scalar::Scalar;

/// Applies the columns of a panel in the backward sweep: `x = L^-T (x - below)`. `x` holds the
/// local rows, `[row, plane, lane]` with `lanes` numbers each (a multiple of [`LANES`]); the rows
/// below the columns must be solved already.
#[inline(always)]
pub(super) fn sweep_back<T: Scalar>(
    panel: &[f64],
    columns: usize,
    stride: usize,
    x: &mut [f64],
    lanes: usize,
) {
    let (mut at, length) = (columns.next_multiple_of(LANES), T::PLANES * stride);
    while at > 0 {
        at -= LANES;
        let own = &panel[at * length..columns.min(at + LANES) * length];
        match columns - at {
            1 => sweep_block::<T, 1>(own, at, stride, x, lanes),
            2 => sweep_block::<T, 2>(own, at, stride, x, lanes),
            3 => sweep_block::<T, 3>(own, at, stride, x, lanes),
            _ => sweep_block::<T, 4>(own, at, stride, x, lanes),
        }
    }
}

#[inline(always)]
fn sweep_block<T: Scalar, const W: usize>(
    own: &[f64],
    at: usize,
    stride: usize,
    x: &mut [f64],
    lanes: usize,
) {
    let mut lane = 0;
    while T::WIDE_TILES && lane + WIDE <= lanes {
        sweep_tile::<T, W, WIDE>(own, at, stride, x, lanes, lane);
        lane += WIDE;
    }
    while lane < lanes {
        sweep_tile::<T, W, LANES>(own, at, stride, x, lanes, lane);
        lane += LANES;
    }
}

#[inline(always)]
fn sweep_tile<T: Scalar, const W: usize, const R: usize>(
    own: &[f64],
    at: usize,
    stride: usize,
    x: &mut [f64],
    lanes: usize,
    lane: usize,
) {
    let (width, length, zero) = (T::PLANES * lanes, T::PLANES * stride, T::from(0.0));
    let (head, tail) = x.split_at_mut((at + LANES) * width);
    let mut sums: [T::Lanes<R>; W] =
        std::array::from_fn(|c| T::load(&head[(at + c) * width + lane..], lanes));
    let columns: [&[f64]; W] =
        std::array::from_fn(|c| &own[c * length + at + LANES..(c + 1) * length]);
    for (row, known) in tail.chunks_exact(width).take(stride - at - LANES).enumerate() {
        // load everything first, so that no bounds check separates the sums
        let known = T::load::<R>(&known[lane..], lanes);
        let mut factors = [zero; W];
        for c in 0..W {
            factors[c] = T::read(columns[c], row, stride);
        }
        for c in 0..W {
            T::less_products(&mut sums[c], factors[c], &known);
        }
    }
    let mut corner = [[zero; W]; W];
    for c in 0..W {
        for k in c..W {
            corner[c][k] = T::read(own, c * length + at + k, stride);
        }
    }
    for c in (0..W).rev() {
        for k in c + 1..W {
            let known = sums[k];
            T::less_products(&mut sums[c], corner[c][k], &known);
        }
        T::scale(&mut sums[c], corner[c][c].inverse());
    }
    for (c, sums) in sums.iter().enumerate() {
        T::store(sums, &mut head[(at + c) * width + lane..], lanes);
    }
}
