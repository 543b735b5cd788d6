//! Inner loops over blocks of frames. Everything here is `inline(always)`, so that it is compiled
//! for the widest SIMD registers of the machine inside `pulp`'s dispatch (see `engine`).
//!
//! Layout: the value of unknown `p` at frame `t` is at `p * stride + t`, with `stride` a multiple of
//! [`LANES`]. All arithmetic runs along the frames, so that it is the same for every basis and an
//! index is loaded once per row of frames.
//!
//! Both products read the basis in the same order, panels of [`PANEL`] unknowns `[panel][rank]`, so
//! that it is stored and read from memory only once. Sums stay in registers (`products`): eight
//! rows of two registers where there are 32 registers (512 bits), four where there are 16, enough to hide the
//! latency of an addition (12 would spill). With 512 bits an iteration on 20 frames takes 0.084 ms at 32 x 32 and
//! 0.38 ms at 64 x 64, where tiles of 256 bits took 0.096 and 0.45 (one core, both builds in turn).

use super::float::Float;
use super::products::Frames;
use pulp::Simd;
use std::ops::Range;

/// Number of frames processed together; rows are padded to a multiple of it.
pub(crate) const LANES: usize = 8;

/// Number of unknowns of a packed panel, and of coefficients that a product processes together.
pub(crate) const PANEL: usize = 4;

/// Ranks are padded to a multiple of this number.
pub(crate) const RANKS: usize = 2 * PANEL;

/// Number of unknowns whose rows fit the L1 cache, and rows of a tile of a product of them.
pub(crate) const CHUNK: usize = 64;
pub(crate) const TILE: usize = 4;

/// Calls tile functions for a row: pieces of two registers, eight rows of which fit 32 registers and four of
/// them 16, then one register, and [`LANES`] frames that do not fill one.
macro_rules! for_tiles {
    ($t:ty, $s:ty, $stride:expr, $offset:ident, $eight:block, $four:block, $single:block, $part:block) => {{
        let lanes = <$t>::lanes::<$s>();
        let mut $offset = 0;
        while $offset < $stride {
            let rest = $stride - $offset;
            if rest >= 2 * lanes && <$s>::REGISTER_COUNT >= 32 {
                $eight
                $offset += 2 * lanes;
            } else if rest >= 2 * lanes {
                $four
                $offset += 2 * lanes;
            } else if rest >= lanes {
                $single
                $offset += lanes;
            } else {
                $part
                $offset += LANES;
            }
        }
    }};
}

/// `out[p, :] += sum_k a[p][k] x[k, :]` over the ranks `k` of `range` for panels `a`
/// `[panel][rank]` of unknowns `p`, `x` `[rank, stride]`, `out` `[panel * PANEL, stride]`.
#[inline(always)]
pub(crate) fn synthesise<T: Float, S: Simd>(
    simd: S,
    a: &[[T; PANEL]],
    rank: usize,
    range: Range<usize>,
    x: &[T],
    stride: usize,
    out: &mut [T],
) {
    let x = &x[range.start * stride..range.end * stride];
    let mut panels = a.chunks_exact(2 * rank);
    let mut outs = out.chunks_exact_mut(2 * PANEL * stride);
    for (a, out) in panels.by_ref().zip(outs.by_ref()) {
        let both = [&a[range.clone()], &a[rank..][range.clone()]];
        for_tiles!(
            T,
            S,
            stride,
            offset,
            {
                T::spread::<S, 2, 2>(simd, both, x, Frames { stride, offset }, out);
            },
            {
                let (top, bottom) = out.split_at_mut(PANEL * stride);
                T::spread::<S, 1, 2>(simd, [both[0]], x, Frames { stride, offset }, top);
                T::spread::<S, 1, 2>(simd, [both[1]], x, Frames { stride, offset }, bottom);
            },
            {
                T::spread::<S, 2, 1>(simd, both, x, Frames { stride, offset }, out);
            },
            {
                let outs = out.split_at_mut(PANEL * stride);
                pair_times::<T, LANES>(both[0], both[1], x, stride, offset, outs.into());
            }
        );
    }
}

/// `out[k, :] += sum_p a[p][k] x[p, :]` for the ranks `k` of `range`, a multiple of [`RANKS`], for
/// panels `a` `[panel][rank]` of unknowns `p`, `x` `[panel * PANEL, stride]`, `out`
/// `[rank, stride]`.
#[inline(always)]
pub(crate) fn analyse<T: Float, S: Simd>(
    simd: S,
    a: &[[T; PANEL]],
    rank: usize,
    range: Range<usize>,
    x: &[T],
    stride: usize,
    out: &mut [T],
) {
    let out = &mut out[range.start * stride..range.end * stride];
    for (k, out) in range.step_by(RANKS).zip(out.chunks_exact_mut(RANKS * stride)) {
        for_tiles!(
            T,
            S,
            stride,
            offset,
            {
                T::collect::<S, RANKS, 2>(simd, a, [rank, k], x, Frames { stride, offset }, out);
            },
            {
                let (top, bottom) = out.split_at_mut(PANEL * stride);
                let (own, next) = ([rank, k], [rank, k + PANEL]);
                T::collect::<S, PANEL, 2>(simd, a, own, x, Frames { stride, offset }, top);
                T::collect::<S, PANEL, 2>(simd, a, next, x, Frames { stride, offset }, bottom);
            },
            {
                T::collect::<S, RANKS, 1>(simd, a, [rank, k], x, Frames { stride, offset }, out);
            },
            {
                gather_times::<T, LANES, RANKS>(a, rank, k, x, stride, offset, out);
            }
        );
    }
}

/// Rows `k..k + R` of [`analyse`], `L` frames.
#[inline(always)]
fn gather_times<T: Float, const L: usize, const R: usize>(
    a: &[[T; PANEL]],
    rank: usize,
    k: usize,
    x: &[T],
    stride: usize,
    offset: usize,
    out: &mut [T],
) {
    let mut sums = [[T::default(); L]; R];
    load(out, stride, offset, &mut sums);
    for (a, rows) in a.chunks_exact(rank).zip(x.chunks_exact(PANEL * stride)) {
        let Some(a) = a[k..].first_chunk::<R>() else { continue };
        for (r, row) in rows.chunks_exact(stride).enumerate().take(PANEL) {
            let Some(row) = row[offset..].first_chunk::<L>() else { continue };
            for s in 0..R {
                sums[s] = add_row(a[s][r], row, sums[s]);
            }
        }
    }
    store(out, stride, offset, &sums);
}

/// Two panels, `L` frames.
#[inline(always)]
fn pair_times<T: Float, const L: usize>(
    first: &[[T; PANEL]],
    second: &[[T; PANEL]],
    x: &[T],
    stride: usize,
    offset: usize,
    [top, bottom]: [&mut [T]; 2],
) {
    let mut sums = [[T::default(); L]; PANEL];
    let mut more = [[T::default(); L]; PANEL];
    load(top, stride, offset, &mut sums);
    load(bottom, stride, offset, &mut more);
    for ((a, b), row) in first.iter().zip(second).zip(x.chunks_exact(stride)) {
        let Some(row) = row[offset..].first_chunk::<L>() else { continue };
        for r in 0..PANEL {
            sums[r] = add_row(a[r], row, sums[r]);
            more[r] = add_row(b[r], row, more[r]);
        }
    }
    store(top, stride, offset, &sums);
    store(bottom, stride, offset, &more);
}

#[inline(always)]
fn load<T: Float, const L: usize, const R: usize>(
    out: &[T],
    stride: usize,
    offset: usize,
    sums: &mut [[T; L]; R],
) {
    for (sum, row) in sums.iter_mut().zip(out.chunks_exact(stride)) {
        sum.copy_from_slice(&row[offset..offset + L]);
    }
}

#[inline(always)]
fn store<T: Float, const L: usize, const R: usize>(
    out: &mut [T],
    stride: usize,
    offset: usize,
    sums: &[[T; L]; R],
) {
    for (sum, row) in sums.iter().zip(out.chunks_exact_mut(stride)) {
        row[offset..offset + L].copy_from_slice(sum);
    }
}

/// Returns `sum + factor * row`; by value, for the same reason as [`lanes`].
#[inline(always)]
pub(crate) fn add_row<T: Float, const L: usize>(factor: T, row: &[T; L], sum: [T; L]) -> [T; L] {
    let mut out = [T::default(); L];
    for l in 0..L {
        out[l] = factor.mul_add(row[l], sum[l]);
    }
    out
}

/// Computes one value for each lane. All results are computed before any is stored, so that the
/// compiler can vectorise without proving that slices do not overlap.
#[inline(always)]
pub(crate) fn lanes<T: Float>(mut value: impl FnMut(usize) -> T) -> [T; LANES] {
    let mut out = [T::default(); LANES];
    for (l, out) in out.iter_mut().enumerate() {
        *out = value(l);
    }
    out
}

/// Returns the row of an array that starts at `at`, in blocks of [`LANES`].
#[inline(always)]
pub(crate) fn row<T>(values: &[T], at: usize, stride: usize) -> &[[T; LANES]] {
    values[at..at + stride].as_chunks().0
}

/// Mutable version of [`row`].
#[inline(always)]
pub(crate) fn row_mut<T>(values: &mut [T], at: usize, stride: usize) -> &mut [[T; LANES]] {
    values[at..at + stride].as_chunks_mut().0
}

/// Adds `factor` times the values from `at` on to blocks of frames.
#[inline(always)]
pub(crate) fn add_blocks<T: Float, const B: usize>(
    factor: T,
    values: &[T],
    at: usize,
    sums: &mut [[T; LANES]; B],
) {
    let rows = row(values, at, B * LANES);
    for b in 0..B {
        sums[b] = add_row(factor, &rows[b], sums[b]);
    }
}

/// Adds `factor * row` to `out`; both lengths are multiples of [`LANES`].
#[inline(always)]
pub(crate) fn add_scaled<T: Float>(factor: T, row: &[T], out: &mut [T]) {
    let (row, out) = (row.as_chunks::<LANES>().0, out.as_chunks_mut::<LANES>().0);
    for (out, row) in out.iter_mut().zip(row) {
        *out = lanes(|l| factor.mul_add(row[l], out[l]));
    }
}

/// Returns the dot product.
#[inline(always)]
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut parts = [0.0; 8];
    let (whole_a, rest_a) = a.as_chunks::<8>();
    let (whole_b, rest_b) = b.as_chunks::<8>();
    for (a, b) in whole_a.iter().zip(whole_b) {
        for l in 0..8 {
            parts[l] = a[l].mul_add(b[l], parts[l]);
        }
    }
    let mut sum = (parts[0] + parts[4]) + (parts[1] + parts[5]);
    sum += (parts[2] + parts[6]) + (parts[3] + parts[7]);
    for (a, b) in rest_a.iter().zip(rest_b) {
        sum += a * b;
    }
    sum
}
