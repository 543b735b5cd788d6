//! Elimination within one front. All functions are `inline(always)`, so that `pulp`'s dispatch
//! compiles them for the widest registers of the machine.
//!
//! A panel is `[column, plane, row]` with `stride` rows per column. The stride and the index of the
//! first row below the columns are multiples of [`LANES`]. The remainder of a front (its update
//! matrix) is also `[column, plane, row]`, lower triangle. Real numbers have one plane, complex
//! numbers two ([`crate::sparse::arithmetic`]). Sums stay in registers: four columns by eight rows
//! (complex: four rows) take eight of the sixteen 256-bit registers.

#![allow(clippy::needless_range_loop, reason = "rows and columns of small tiles, by their indices")]

use super::tile::{LANES, WIDE, store, tile};
use crate::sparse::scalar::Scalar;

/// Eliminates the columns of a panel in place, leaving `L` in its lower trapezoid. The error is the
/// column whose pivot is not finite or not in the half plane around `direction`.
#[inline(always)]
pub(super) fn eliminate<T: Scalar>(
    panel: &mut [f64],
    columns: usize,
    stride: usize,
    direction: T,
) -> Result<(), usize> {
    let (mut at, length) = (0, T::PLANES * stride);
    while at < columns {
        let (done, rest) = panel.split_at_mut(at * length);
        let failed = |column: usize| at + column;
        at += match columns - at {
            1 => block::<T, 1>(done, &mut rest[..length], at, stride, direction).map_err(failed)?,
            2 => block::<T, 2>(done, &mut rest[..2 * length], at, stride, direction)
                .map_err(failed)?,
            3 => block::<T, 3>(done, &mut rest[..3 * length], at, stride, direction)
                .map_err(failed)?,
            _ => block::<T, 4>(done, &mut rest[..4 * length], at, stride, direction)
                .map_err(failed)?,
        };
    }
    Ok(())
}

/// Eliminates columns `at..at + W` using the finished ones; returns `W`.
#[inline(always)]
fn block<T: Scalar, const W: usize>(
    done: &[f64],
    own: &mut [f64],
    at: usize,
    stride: usize,
    direction: T,
) -> Result<usize, usize> {
    let zero = T::from(0.0);
    let head = updated::<T, W, LANES>(done, stride, at, at, tile::<T, W, LANES>(own, stride, at));
    let mut lower = [[zero; W]; W];
    let mut inverse = [zero; W];
    for c in 0..W {
        for r in c..W {
            let mut sum = T::lane(&head[c], r);
            for k in 0..c {
                sum = sum.less_product(lower[r][k], lower[c][k]);
            }
            if r == c {
                lower[c][c] = sum.pivot_root(direction).ok_or(c)?;
                inverse[c] = lower[c][c].inverse();
            } else {
                lower[r][c] = sum * inverse[c];
            }
        }
    }
    let corner: [T::Lanes<LANES>; W] = std::array::from_fn(|c| {
        T::lanes(std::array::from_fn(|r| if r < W { lower[r][c] } else { zero }))
    });
    store::<T, W, LANES>(&corner, own, stride, at);
    let mut row = at + LANES;
    while T::WIDE_TILES && row + WIDE <= stride {
        let sums = tile::<T, W, WIDE>(own, stride, row);
        let mut sums = updated::<T, W, WIDE>(done, stride, at, row, sums);
        divide::<T, W, WIDE>(&lower, &inverse, &mut sums);
        store::<T, W, WIDE>(&sums, own, stride, row);
        row += WIDE;
    }
    while row < stride {
        let sums = tile::<T, W, LANES>(own, stride, row);
        let mut sums = updated::<T, W, LANES>(done, stride, at, row, sums);
        divide::<T, W, LANES>(&lower, &inverse, &mut sums);
        store::<T, W, LANES>(&sums, own, stride, row);
        row += LANES;
    }
    Ok(W)
}

/// Writes matrix entries to their positions in a panel. `places` index the panel as if it had one
/// plane; `starts` are the entry ranges of its columns.
#[inline(always)]
pub(super) fn enter<T: Scalar>(
    panel: &mut [f64],
    stride: usize,
    starts: &[u32],
    places: &[u32],
    values: &[T],
) {
    let all = starts[0] as usize..starts[starts.len() - 1] as usize;
    if T::PLANES == 1 {
        // columns have few entries; a loop per column would cost a branch each
        for (&place, value) in places[all.clone()].iter().zip(&values[all]) {
            value.write(&mut panel[place as usize..], stride);
        }
        return;
    }
    for (column, ends) in starts.windows(2).enumerate() {
        let own = ends[0] as usize..ends[1] as usize;
        let before = (T::PLANES - 1) * column * stride;
        for (&place, value) in places[own.clone()].iter().zip(&values[own]) {
            value.write(&mut panel[before + place as usize..], stride);
        }
    }
}

/// Clears the lower triangle of a front's update matrix, in whole tiles.
#[inline(always)]
pub(super) fn clear<T: Scalar>(rest: &mut [f64], side: usize) {
    for (at, plane) in rest.chunks_exact_mut(side.max(1)).enumerate() {
        plane[at / T::PLANES / LANES * LANES..].fill(0.0);
    }
}

/// Computes `rest -= L L^T` for the rows below the columns, lower triangle in tiles; with `FRESH`,
/// `rest = -L L^T`.
#[inline(always)]
pub(super) fn subtract<T: Scalar, const FRESH: bool>(
    panel: &[f64],
    padded: usize,
    stride: usize,
    rest: &mut [f64],
) {
    let (side, zero) = (stride - padded, T::from(0.0));
    if side == 0 {
        return;
    }
    for (column, own) in rest.chunks_exact_mut(LANES * T::PLANES * side).enumerate() {
        let column = column * LANES;
        let mut row = column;
        while T::WIDE_TILES && row + WIDE <= side {
            let sums = match FRESH {
                true => [T::lanes([zero; WIDE]); LANES],
                false => tile::<T, LANES, WIDE>(own, side, row),
            };
            let (factor, from) = (padded + column, padded + row);
            let sums = updated::<T, LANES, WIDE>(panel, stride, factor, from, sums);
            store::<T, LANES, WIDE>(&sums, own, side, row);
            row += WIDE;
        }
        while row < side {
            let sums = match FRESH {
                true => [T::lanes([zero; LANES]); LANES],
                false => tile::<T, LANES, LANES>(own, side, row),
            };
            let (factor, from) = (padded + column, padded + row);
            let sums = updated::<T, LANES, LANES>(panel, stride, factor, from, sums);
            store::<T, LANES, LANES>(&sums, own, side, row);
            row += LANES;
        }
    }
}

/// Returns `sums[c][r]` minus the sum over the columns of `done` of `done[row + r] done[factor +
/// c]`.
#[inline(always)]
fn updated<T: Scalar, const W: usize, const R: usize>(
    done: &[f64],
    stride: usize,
    factor: usize,
    row: usize,
    mut sums: [T::Lanes<R>; W],
) -> [T::Lanes<R>; W] {
    for column in done.chunks_exact(T::PLANES * stride) {
        let rows = T::load::<R>(&column[row..], stride);
        let factors = T::load::<W>(&column[factor..], stride);
        for c in 0..W {
            T::less_products(&mut sums[c], T::lane(&factors, c), &rows);
        }
    }
    sums
}

/// Multiplies rows by the inverse of the transposed corner.
#[inline(always)]
fn divide<T: Scalar, const W: usize, const R: usize>(
    lower: &[[T; W]; W],
    inverse: &[T; W],
    sums: &mut [T::Lanes<R>; W],
) {
    for c in 0..W {
        for k in 0..c {
            let known = sums[k];
            T::less_products(&mut sums[c], lower[c][k], &known);
        }
        T::scale(&mut sums[c], inverse[c]);
    }
}

/// Adds the update matrix of a child (lower triangle, columns of `side` rows) to its parent;
/// `places` are the parent's local rows.
#[inline(always)]
pub(super) fn add_child<T: Scalar>(
    child: &[f64],
    side: usize,
    places: &[u32],
    panel: &mut [f64],
    stride: usize,
    rest: &mut [f64],
    padded: usize,
) {
    let rest_side = stride - padded;
    for (j, &place) in places.iter().enumerate() {
        let place = place as usize;
        let (column, width, before) = if place < padded {
            (&mut panel[place * T::PLANES * stride..][..T::PLANES * stride], stride, 0)
        } else {
            let length = T::PLANES * rest_side;
            (&mut rest[(place - padded) * length..][..length], rest_side, padded)
        };
        for plane in 0..T::PLANES {
            let values = &child[(j * T::PLANES + plane) * side + j..][..places.len() - j];
            let column = &mut column[plane * width..][..width];
            for (&row, value) in places[j..].iter().zip(values) {
                column[row as usize - before] += *value;
            }
        }
    }
}
