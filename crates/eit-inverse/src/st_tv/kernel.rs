//! Inner loops over blocks of frames. Everything here is `inline(always)`, so that it is compiled
//! for the widest registers of the machine inside `pulp`'s dispatch (see `engine`).
//!
//! Layout: a value of unknown `p` at frame `t` is at `p * stride + t`, `stride` a multiple of
//! [`LANES`]. All arithmetic runs along the frames, so that it is the same for every basis and an
//! index is loaded once per row of frames.

use super::scalar::Scalar;

/// Frames that are handled together at least; rows are padded to a multiple of it.
pub(crate) const LANES: usize = 8;

/// Rows of a packed panel: with 24 to 32 frames its sums fill the registers.
pub(crate) const PANEL: usize = 4;

/// `out[r, :] += sum_k a[k][r] x[k, :]` for packed panels `a` `[panel][k]`, `x` `[k, stride]`,
/// `out` `[panel * PANEL, stride]`.
#[inline(always)]
pub(crate) fn panels_times<T: Scalar>(
    a: &[[T; PANEL]],
    depth: usize,
    x: &[T],
    stride: usize,
    out: &mut [T],
) {
    let mut panels = a.chunks_exact(2 * depth);
    let mut outs = out.chunks_exact_mut(2 * PANEL * stride);
    for (a, out) in panels.by_ref().zip(outs.by_ref()) {
        let mut offset = 0;
        while offset < stride {
            // two panels at once where a row of frames fills one register: eight sums hide the
            // latency of an addition. With wider blocks one panel has as many.
            offset += match stride - offset {
                24.. => {
                    let (first, second) = a.split_at(depth);
                    let (top, bottom) = out.split_at_mut(PANEL * stride);
                    panel_times::<T, 24>(first, x, stride, offset, top);
                    panel_times::<T, 24>(second, x, stride, offset, bottom)
                }
                16..24 => pair_times::<T, 16>(a, x, stride, offset, out),
                _ => pair_times::<T, LANES>(a, x, stride, offset, out),
            };
        }
    }
    for (a, out) in panels
        .remainder()
        .chunks_exact(depth)
        .zip(outs.into_remainder().chunks_exact_mut(PANEL * stride))
    {
        for offset in (0..stride).step_by(LANES) {
            panel_times::<T, LANES>(a, x, stride, offset, out);
        }
    }
}

/// One panel, `L` frames; returns `L`.
#[inline(always)]
fn panel_times<T: Scalar, const L: usize>(
    a: &[[T; PANEL]],
    x: &[T],
    stride: usize,
    offset: usize,
    out: &mut [T],
) -> usize {
    let mut sums = [[T::default(); L]; PANEL];
    load(out, stride, offset, &mut sums);
    for (a, row) in a.iter().zip(x.chunks_exact(stride)) {
        let Some(row) = row[offset..].first_chunk::<L>() else { continue };
        for r in 0..PANEL {
            sums[r] = add_row(a[r], row, sums[r]);
        }
    }
    store(out, stride, offset, &sums)
}

/// Two panels, `L` frames; returns `L`.
#[inline(always)]
fn pair_times<T: Scalar, const L: usize>(
    a: &[[T; PANEL]],
    x: &[T],
    stride: usize,
    offset: usize,
    out: &mut [T],
) -> usize {
    let (first, second) = a.split_at(a.len() / 2);
    let (top, bottom) = out.split_at_mut(PANEL * stride);
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
    store(bottom, stride, offset, &more)
}

#[inline(always)]
fn load<T: Scalar, const L: usize>(
    out: &[T],
    stride: usize,
    offset: usize,
    sums: &mut [[T; L]; PANEL],
) {
    for (sum, row) in sums.iter_mut().zip(out.chunks_exact(stride)) {
        sum.copy_from_slice(&row[offset..offset + L]);
    }
}

#[inline(always)]
fn store<T: Scalar, const L: usize>(
    out: &mut [T],
    stride: usize,
    offset: usize,
    sums: &[[T; L]; PANEL],
) -> usize {
    for (sum, row) in sums.iter().zip(out.chunks_exact_mut(stride)) {
        row[offset..offset + L].copy_from_slice(sum);
    }
    L
}

/// `sum + factor * row`. By value, as [`lanes`].
#[inline(always)]
pub(crate) fn add_row<T: Scalar, const L: usize>(factor: T, row: &[T; L], sum: [T; L]) -> [T; L] {
    let mut out = [T::default(); L];
    for l in 0..L {
        out[l] = factor.mul_add(row[l], sum[l]);
    }
    out
}

/// Runs a body for blocks of a row of `$stride` frames: `$offset` is a block's first frame,
/// `$width` its constant length.
macro_rules! for_blocks {
    ($stride:expr, |$offset:ident, $width:ident| $body:block) => {{
        const $width: usize = $crate::st_tv::kernel::LANES;
        for $offset in (0..$stride).step_by($width) {
            $body
        }
    }};
}
pub(crate) use for_blocks;

/// One value for each lane. Results are collected before any is stored, so that the compiler need
/// not prove that slices do not overlap before it takes whole registers.
#[inline(always)]
pub(crate) fn lanes<T: Scalar, const L: usize>(mut value: impl FnMut(usize) -> T) -> [T; L] {
    let mut out = [T::default(); L];
    for (l, out) in out.iter_mut().enumerate() {
        *out = value(l);
    }
    out
}

/// `L` values from a place of an array; zeros where it ends before.
#[inline(always)]
pub(crate) fn block<T: Scalar, const L: usize>(values: &[T], at: usize) -> [T; L] {
    match values.get(at..).and_then(|rest| rest.first_chunk::<L>()) {
        Some(chunk) => *chunk,
        None => [T::default(); L],
    }
}

/// Stores `L` values.
#[inline(always)]
pub(crate) fn put<T: Scalar, const L: usize>(values: &mut [T], at: usize, block: [T; L]) {
    if let Some(chunk) = values.get_mut(at..).and_then(|rest| rest.first_chunk_mut::<L>()) {
        *chunk = block;
    }
}

/// `out += factor * row`, both a multiple of [`LANES`] long.
#[inline(always)]
pub(crate) fn add_scaled<T: Scalar>(factor: T, row: &[T], out: &mut [T]) {
    let (row, out) = (row.as_chunks::<LANES>().0, out.as_chunks_mut::<LANES>().0);
    for (out, row) in out.iter_mut().zip(row) {
        *out = lanes(|l| factor.mul_add(row[l], out[l]));
    }
}
