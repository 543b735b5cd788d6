//! Arithmetic of one front. Everything here is `inline(always)`, so that it is compiled for the
//! widest registers of the machine inside `pulp`'s dispatch.
//!
//! A panel is `[column, row]` with `stride` rows a column, a multiple of [`LANES`], as is the first
//! row below its columns; what is left of a front is `[column, row]`, its lower triangle. Sums stay
//! in registers: four columns of eight rows are eight of the sixteen registers of 256 bits.

use super::symbolic::LANES;

/// Rows of the larger tile.
const WIDE: usize = 2 * LANES;

/// Eliminates the columns of a panel, in place: `L` in its lower trapezoid. The column whose pivot
/// is not above zero and finite is the error.
#[inline(always)]
pub(super) fn eliminate(panel: &mut [f64], columns: usize, stride: usize) -> Result<(), usize> {
    let mut at = 0;
    while at < columns {
        let (done, rest) = panel.split_at_mut(at * stride);
        let failed = |column: usize| at + column;
        at += match columns - at {
            1 => block::<1>(done, &mut rest[..stride], at, stride).map_err(failed)?,
            2 => block::<2>(done, &mut rest[..2 * stride], at, stride).map_err(failed)?,
            3 => block::<3>(done, &mut rest[..3 * stride], at, stride).map_err(failed)?,
            _ => block::<4>(done, &mut rest[..4 * stride], at, stride).map_err(failed)?,
        };
    }
    Ok(())
}

/// Columns `at..at + W`, from those that are done: returns `W`.
#[inline(always)]
fn block<const W: usize>(
    done: &[f64],
    own: &mut [f64],
    at: usize,
    stride: usize,
) -> Result<usize, usize> {
    let head = updated::<W, LANES>(done, stride, at, at, tile(own, stride, at));
    let mut lower = [[0.0; W]; W];
    let mut inverse = [0.0; W];
    for c in 0..W {
        for r in c..W {
            let mut sum = head[c][r];
            for k in 0..c {
                sum -= lower[r][k] * lower[c][k];
            }
            if r == c {
                if !(sum > 0.0 && sum < f64::INFINITY) {
                    return Err(c);
                }
                lower[c][c] = sum.sqrt();
                inverse[c] = 1.0 / lower[c][c];
            } else {
                lower[r][c] = sum * inverse[c];
            }
        }
    }
    let corner: [[f64; LANES]; W] =
        std::array::from_fn(|c| std::array::from_fn(|r| if r < W { lower[r][c] } else { 0.0 }));
    store(&corner, own, stride, at);
    let mut row = at + LANES;
    while row + WIDE <= stride {
        let mut sums = updated::<W, WIDE>(done, stride, at, row, tile(own, stride, row));
        divide(&lower, &inverse, &mut sums);
        store(&sums, own, stride, row);
        row += WIDE;
    }
    if row < stride {
        let mut sums = updated::<W, LANES>(done, stride, at, row, tile(own, stride, row));
        divide(&lower, &inverse, &mut sums);
        store(&sums, own, stride, row);
    }
    Ok(W)
}

/// Zeros in the lower triangle of what will be left of a front, in whole tiles.
#[inline(always)]
pub(super) fn clear(rest: &mut [f64], side: usize) {
    for j in 0..side {
        rest[j * side + j / LANES * LANES..(j + 1) * side].fill(0.0);
    }
}

/// `rest -= L L^T` for the rows below the columns, the lower triangle in tiles; `rest = -L L^T` where
/// nothing is there yet (`FRESH`).
#[inline(always)]
pub(super) fn subtract<const FRESH: bool>(
    panel: &[f64],
    padded: usize,
    stride: usize,
    rest: &mut [f64],
) {
    let side = stride - padded;
    if side == 0 {
        return;
    }
    for (column, own) in rest.chunks_exact_mut(LANES * side).enumerate() {
        let column = column * LANES;
        let mut row = column;
        while row + WIDE <= side {
            let sums = if FRESH { [[0.0; WIDE]; LANES] } else { tile(own, side, row) };
            let sums = updated(panel, stride, padded + column, padded + row, sums);
            store(&sums, own, side, row);
            row += WIDE;
        }
        if row < side {
            let sums = if FRESH { [[0.0; LANES]; LANES] } else { tile(own, side, row) };
            let sums = updated(panel, stride, padded + column, padded + row, sums);
            store(&sums, own, side, row);
        }
    }
}

/// `sums[c][r] - sum over the columns of `done` of done[row + r] done[factor + c]`.
#[inline(always)]
fn updated<const W: usize, const R: usize>(
    done: &[f64],
    stride: usize,
    factor: usize,
    row: usize,
    mut sums: [[f64; R]; W],
) -> [[f64; R]; W] {
    for column in done.chunks_exact(stride) {
        let rows: [f64; R] = load(&column[row..]);
        let factors: [f64; W] = load(&column[factor..]);
        for c in 0..W {
            for r in 0..R {
                sums[c][r] = (-factors[c]).mul_add(rows[r], sums[c][r]);
            }
        }
    }
    sums
}

/// Rows times the inverse of the transposed corner.
#[inline(always)]
fn divide<const W: usize, const R: usize>(
    lower: &[[f64; W]; W],
    inverse: &[f64; W],
    sums: &mut [[f64; R]; W],
) {
    for c in 0..W {
        for k in 0..c {
            for r in 0..R {
                sums[c][r] = (-lower[c][k]).mul_add(sums[k][r], sums[c][r]);
            }
        }
        sums[c].iter_mut().for_each(|s| *s *= inverse[c]);
    }
}

#[inline(always)]
fn tile<const W: usize, const R: usize>(from: &[f64], stride: usize, row: usize) -> [[f64; R]; W] {
    std::array::from_fn(|c| load(&from[c * stride + row..]))
}

#[inline(always)]
fn load<const R: usize>(from: &[f64]) -> [f64; R] {
    let mut values = [0.0; R];
    values.copy_from_slice(&from[..R]);
    values
}

#[inline(always)]
fn store<const W: usize, const R: usize>(
    sums: &[[f64; R]; W],
    to: &mut [f64],
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
pub(super) fn add_child(
    child: &[f64],
    side: usize,
    places: &[u32],
    (panel, stride): (&mut [f64], usize),
    (rest, padded): (&mut [f64], usize),
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
            column[row as usize - before] += value;
        }
    }
}

/// The columns of a panel in the backward sweep: `x = L^-T (x - below)` on the local rows `x`
/// `[row, lane]` of `lanes` values each, a multiple of [`LANES`], of which the rows below the
/// columns are solved for.
#[inline(always)]
pub(super) fn sweep_back(
    panel: &[f64],
    columns: usize,
    stride: usize,
    x: &mut [f64],
    lanes: usize,
) {
    let mut at = columns.next_multiple_of(LANES);
    while at > 0 {
        at -= LANES;
        let own = &panel[at * stride..columns.min(at + LANES) * stride];
        match columns - at {
            1 => sweep_block::<1>(own, at, stride, x, lanes),
            2 => sweep_block::<2>(own, at, stride, x, lanes),
            3 => sweep_block::<3>(own, at, stride, x, lanes),
            _ => sweep_block::<4>(own, at, stride, x, lanes),
        }
    }
}

#[inline(always)]
fn sweep_block<const W: usize>(own: &[f64], at: usize, stride: usize, x: &mut [f64], lanes: usize) {
    let mut lane = 0;
    while lane + WIDE <= lanes {
        sweep_tile::<W, WIDE>(own, at, stride, x, lanes, lane);
        lane += WIDE;
    }
    if lane < lanes {
        sweep_tile::<W, LANES>(own, at, stride, x, lanes, lane);
    }
}

#[inline(always)]
fn sweep_tile<const W: usize, const R: usize>(
    own: &[f64],
    at: usize,
    stride: usize,
    x: &mut [f64],
    lanes: usize,
    lane: usize,
) {
    let (head, tail) = x.split_at_mut((at + LANES) * lanes);
    let mut sums: [[f64; R]; W] = std::array::from_fn(|c| load(&head[(at + c) * lanes + lane..]));
    let columns: [&[f64]; W] =
        std::array::from_fn(|c| &own[c * stride + at + LANES..(c + 1) * stride]);
    for (row, known) in tail.chunks_exact(lanes).take(stride - at - LANES).enumerate() {
        // everything is loaded first: nothing between the sums can fail
        let known: [f64; R] = load(&known[lane..]);
        let factors: [f64; W] = std::array::from_fn(|c| columns[c][row]);
        for c in 0..W {
            for r in 0..R {
                sums[c][r] = (-factors[c]).mul_add(known[r], sums[c][r]);
            }
        }
    }
    let corner: [[f64; W]; W] =
        std::array::from_fn(|c| std::array::from_fn(|k| own[c * stride + at + k]));
    for c in (0..W).rev() {
        for k in c + 1..W {
            for r in 0..R {
                sums[c][r] = (-corner[c][k]).mul_add(sums[k][r], sums[c][r]);
            }
        }
        let inverse = 1.0 / corner[c][c];
        sums[c].iter_mut().for_each(|s| *s *= inverse);
    }
    for (c, sums) in sums.iter().enumerate() {
        head[(at + c) * lanes + lane..][..R].copy_from_slice(sums);
    }
}
