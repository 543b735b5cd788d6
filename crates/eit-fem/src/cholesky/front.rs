//! Arithmetic of one front. Everything here is `inline(always)`, so that it is compiled for the
//! widest registers of the machine inside `pulp`'s dispatch.
//!
//! A panel is `[column, row]` with `stride` rows a column, a multiple of [`LANES`], as is the first
//! row below its columns; what is left of a front is `[column, row]`, its lower triangle. Sums stay
//! in registers: four columns of eight rows are eight of the sixteen registers of 256 bits.

#![allow(clippy::needless_range_loop, reason = "rows and columns of small tiles, by their indices")]

use super::symbolic::LANES;
use crate::scalar::Scalar;

/// Rows of the larger tile.
const WIDE: usize = 2 * LANES;

/// Eliminates the columns of a panel, in place: `L` in its lower trapezoid. The column whose pivot
/// is not above zero and finite is the error.
#[inline(always)]
pub(super) fn eliminate<T: Scalar>(
    panel: &mut [T],
    columns: usize,
    stride: usize,
    direction: T,
) -> Result<(), usize> {
    let mut at = 0;
    while at < columns {
        let (done, rest) = panel.split_at_mut(at * stride);
        let failed = |column: usize| at + column;
        at += match columns - at {
            1 => {
                block::<T, 1>(done, &mut rest[..stride], (at, stride), direction).map_err(failed)?
            }
            2 => block::<T, 2>(done, &mut rest[..2 * stride], (at, stride), direction)
                .map_err(failed)?,
            3 => block::<T, 3>(done, &mut rest[..3 * stride], (at, stride), direction)
                .map_err(failed)?,
            _ => block::<T, 4>(done, &mut rest[..4 * stride], (at, stride), direction)
                .map_err(failed)?,
        };
    }
    Ok(())
}

/// Columns `at..at + W`, from those that are done: returns `W`.
#[inline(always)]
fn block<T: Scalar, const W: usize>(
    done: &[T],
    own: &mut [T],
    (at, stride): (usize, usize),
    direction: T,
) -> Result<usize, usize> {
    let zero = T::from(0.0);
    let head = updated::<T, W, LANES>(done, stride, at, at, tile(own, stride, at));
    let mut lower = [[zero; W]; W];
    let mut inverse = [zero; W];
    for c in 0..W {
        for r in c..W {
            let mut sum = head[c][r];
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
    let corner: [[T; LANES]; W] =
        std::array::from_fn(|c| std::array::from_fn(|r| if r < W { lower[r][c] } else { zero }));
    store(&corner, own, stride, at);
    let mut row = at + LANES;
    while row + WIDE <= stride {
        let mut sums = updated::<T, W, WIDE>(done, stride, at, row, tile(own, stride, row));
        divide(&lower, &inverse, &mut sums);
        store(&sums, own, stride, row);
        row += WIDE;
    }
    if row < stride {
        let mut sums = updated::<T, W, LANES>(done, stride, at, row, tile(own, stride, row));
        divide(&lower, &inverse, &mut sums);
        store(&sums, own, stride, row);
    }
    Ok(W)
}

/// Zeros in the lower triangle of what will be left of a front, in whole tiles.
#[inline(always)]
pub(super) fn clear<T: Scalar>(rest: &mut [T], side: usize) {
    for j in 0..side {
        rest[j * side + j / LANES * LANES..(j + 1) * side].fill(T::from(0.0));
    }
}

/// `rest -= L L^T` for the rows below the columns, the lower triangle in tiles; `rest = -L L^T` where
/// nothing is there yet (`FRESH`).
#[inline(always)]
pub(super) fn subtract<T: Scalar, const FRESH: bool>(
    panel: &[T],
    padded: usize,
    stride: usize,
    rest: &mut [T],
) {
    let (side, zero) = (stride - padded, T::from(0.0));
    if side == 0 {
        return;
    }
    for (column, own) in rest.chunks_exact_mut(LANES * side).enumerate() {
        let column = column * LANES;
        let mut row = column;
        while row + WIDE <= side {
            let sums = if FRESH { [[zero; WIDE]; LANES] } else { tile(own, side, row) };
            let sums = updated(panel, stride, padded + column, padded + row, sums);
            store(&sums, own, side, row);
            row += WIDE;
        }
        if row < side {
            let sums = if FRESH { [[zero; LANES]; LANES] } else { tile(own, side, row) };
            let sums = updated(panel, stride, padded + column, padded + row, sums);
            store(&sums, own, side, row);
        }
    }
}

/// `sums[c][r] - sum over the columns of `done` of done[row + r] done[factor + c]`.
#[inline(always)]
fn updated<T: Scalar, const W: usize, const R: usize>(
    done: &[T],
    stride: usize,
    factor: usize,
    row: usize,
    mut sums: [[T; R]; W],
) -> [[T; R]; W] {
    for column in done.chunks_exact(stride) {
        let rows: [T; R] = load(&column[row..]);
        let factors: [T; W] = load(&column[factor..]);
        for c in 0..W {
            for r in 0..R {
                sums[c][r] = sums[c][r].less_product(factors[c], rows[r]);
            }
        }
    }
    sums
}

/// Rows times the inverse of the transposed corner.
#[inline(always)]
fn divide<T: Scalar, const W: usize, const R: usize>(
    lower: &[[T; W]; W],
    inverse: &[T; W],
    sums: &mut [[T; R]; W],
) {
    for c in 0..W {
        for k in 0..c {
            for r in 0..R {
                sums[c][r] = sums[c][r].less_product(lower[c][k], sums[k][r]);
            }
        }
        sums[c].iter_mut().for_each(|s| *s *= inverse[c]);
    }
}

#[inline(always)]
fn tile<T: Scalar, const W: usize, const R: usize>(
    from: &[T],
    stride: usize,
    row: usize,
) -> [[T; R]; W] {
    std::array::from_fn(|c| load(&from[c * stride + row..]))
}

#[inline(always)]
fn load<T: Scalar, const R: usize>(from: &[T]) -> [T; R] {
    let mut values = [T::from(0.0); R];
    values.copy_from_slice(&from[..R]);
    values
}

#[inline(always)]
fn store<T: Scalar, const W: usize, const R: usize>(
    sums: &[[T; R]; W],
    to: &mut [T],
    stride: usize,
    row: usize,
) {
    for (c, sums) in sums.iter().enumerate() {
        to[c * stride + row..][..R].copy_from_slice(sums);
    }
}

/// Adds what a child has left (lower triangle, `rows` of `side`) to its parent: `places` are the
/// parent's local rows.
#[inline(always)]
pub(super) fn add_child<T: Scalar>(
    child: &[T],
    side: usize,
    places: &[u32],
    (panel, stride): (&mut [T], usize),
    (rest, padded): (&mut [T], usize),
) {
    let rest_side = stride - padded;
    for (j, &place) in places.iter().enumerate() {
        let values = &child[j * side + j..][..places.len() - j];
        let place = place as usize;
        let (column, before) = if place < padded {
            (&mut panel[place * stride..][..stride], 0)
        } else {
            (&mut rest[(place - padded) * rest_side..][..rest_side], padded)
        };
        for (&row, value) in places[j..].iter().zip(values) {
            column[row as usize - before] += *value;
        }
    }
}

/// The columns of a panel in the backward sweep: `x = L^-T (x - below)` on the local rows `x`
/// `[row, lane]` of `lanes` values each, a multiple of [`LANES`], of which the rows below the
/// columns are solved for.
#[inline(always)]
pub(super) fn sweep_back<T: Scalar>(
    panel: &[T],
    columns: usize,
    stride: usize,
    x: &mut [T],
    lanes: usize,
) {
    let mut at = columns.next_multiple_of(LANES);
    while at > 0 {
        at -= LANES;
        let own = &panel[at * stride..columns.min(at + LANES) * stride];
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
    own: &[T],
    at: usize,
    stride: usize,
    x: &mut [T],
    lanes: usize,
) {
    let mut lane = 0;
    while lane + WIDE <= lanes {
        sweep_tile::<T, W, WIDE>(own, at, stride, x, lanes, lane);
        lane += WIDE;
    }
    if lane < lanes {
        sweep_tile::<T, W, LANES>(own, at, stride, x, lanes, lane);
    }
}

#[inline(always)]
fn sweep_tile<T: Scalar, const W: usize, const R: usize>(
    own: &[T],
    at: usize,
    stride: usize,
    x: &mut [T],
    lanes: usize,
    lane: usize,
) {
    let (head, tail) = x.split_at_mut((at + LANES) * lanes);
    let mut sums: [[T; R]; W] = std::array::from_fn(|c| load(&head[(at + c) * lanes + lane..]));
    let columns: [&[T]; W] =
        std::array::from_fn(|c| &own[c * stride + at + LANES..(c + 1) * stride]);
    for (row, known) in tail.chunks_exact(lanes).take(stride - at - LANES).enumerate() {
        // everything is loaded first: nothing between the sums can fail
        let known: [T; R] = load(&known[lane..]);
        let factors: [T; W] = std::array::from_fn(|c| columns[c][row]);
        for c in 0..W {
            for r in 0..R {
                sums[c][r] = sums[c][r].less_product(factors[c], known[r]);
            }
        }
    }
    let corner: [[T; W]; W] =
        std::array::from_fn(|c| std::array::from_fn(|k| own[c * stride + at + k]));
    for c in (0..W).rev() {
        for k in c + 1..W {
            for r in 0..R {
                sums[c][r] = sums[c][r].less_product(corner[c][k], sums[k][r]);
            }
        }
        let inverse = corner[c][c].inverse();
        sums[c].iter_mut().for_each(|s| *s *= inverse);
    }
    for (c, sums) in sums.iter().enumerate() {
        head[(at + c) * lanes + lane..][..R].copy_from_slice(sums);
    }
}
