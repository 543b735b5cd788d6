//! Products of the basis with arrays of all frames, outside of the iteration.

use super::lanes::{
    BLOCKS, LANES, Lane, Project, by_frames, each, load, splat, store, total, vectorised,
};
use super::operators::Operators;
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;

/// Number of unknowns whose rows fit the L1 cache, and rows of a tile of their products.
const CHUNK: usize = 64;
const TILE: usize = 4;

/// Number of panels whose products are summed in a lane before conversion to `f64`.
pub(crate) const SUMMED_PANELS: usize = 8;

impl<T: Project> Operators<T> {
    /// Computes the first `ranks`, a multiple of the lanes, of `V' x` of all frames, `[frame][padded rank]`. Products
    /// and sums are in `T` over [`SUMMED_PANELS`] panels, then in `f64`.
    ///
    /// `x` is over cells; `sums` is scratch memory, `[padded rank]` of a few frames. Panels of zeros are skipped. The
    /// speed is limited by memory bandwidth: `V` is read once for four frames, `4 n rank` bytes in `f32` and twice
    /// that in `f64`.
    pub(crate) fn analyse<X: Project>(
        &self,
        x: &[X],
        ranks: usize,
        sums: &mut [Lane<T>],
        out: &mut [f64],
    ) {
        Arch::new().dispatch(Analyse { ops: self, x, ranks, sums, out });
    }

    /// Computes `out = V z`, or adds it, on all cells of all frames, over a range of ranks; `z` is
    /// `[frame][padded rank]`.
    pub(crate) fn expand(&self, z: &[T], ranks: Range<usize>, add: bool, out: &mut [T]) {
        Arch::new().dispatch(Expand { ops: self, ranks, z, add, out });
    }

    /// Computes the upper triangle of `V' T V` of the first `ranks`, a multiple of [`LANES`]; `out` is
    /// `[padded rank][padded rank]`.
    pub(crate) fn gram(&self, tau: &[T], ranks: usize, out: &mut [T]) {
        vectorised!(gram(self, tau, ranks, out));
    }
}

struct Analyse<'a, T: Project, X> {
    ops: &'a Operators<T>,
    x: &'a [X],
    ranks: usize,
    sums: &'a mut [Lane<T>],
    out: &'a mut [f64],
}

impl<T: Project, X: Project> WithSimd for Analyse<'_, T, X> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let frames = self.out.len() / self.ops.padded;
        by_frames!(frames, |G, first| self.frames::<S, G>(simd, first));
    }
}

impl<T: Project, X: Project> Analyse<'_, T, X> {
    #[inline(always)]
    fn frames<S: Simd, const G: usize>(&mut self, simd: S, first: usize) {
        let Self { ops, x, ranks, sums, out } = self;
        let (cells, padded) = (ops.cells(), ops.padded);
        let (sums, out) = (&mut sums[..G * padded], &mut out[first * padded..][..G * padded]);
        out.fill(0.0);
        sums.fill([T::default(); LANES]);
        let mut known = 0;
        for (panel, blocks) in ops.places.blocks.chunks_exact(BLOCKS).enumerate() {
            let mut w = [[[T::default(); LANES]; BLOCKS]; G];
            let mut largest = splat(T::default());
            for (f, w) in w.iter_mut().enumerate() {
                for (w, &at) in w.iter_mut().zip(blocks) {
                    let x = load(x, (first + f) * cells + at);
                    *w = each!(|l| T::from_f64(x[l].to_f64()));
                    largest = each!(|l| largest[l].max(w[l].abs()));
                }
            }
            if largest != splat(T::default()) {
                T::project(simd, ops.panel(panel, 0..*ranks), &w, sums, padded);
                known += 1;
            }
            if known == SUMMED_PANELS {
                flush(sums, out);
                known = 0;
            }
        }
        flush(sums, out);
    }
}

/// Adds the lane of each rank to its sum and clears the lane.
#[inline(always)]
fn flush<T: Project>(sums: &mut [Lane<T>], out: &mut [f64]) {
    for (sum, out) in sums.iter_mut().zip(out) {
        *out += total(&each!(|l| sum[l].to_f64()));
        *sum = [T::default(); LANES];
    }
}

struct Expand<'a, T: Project> {
    ops: &'a Operators<T>,
    ranks: Range<usize>,
    z: &'a [T],
    add: bool,
    out: &'a mut [T],
}

impl<T: Project> WithSimd for Expand<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let frames = self.z.len() / self.ops.padded;
        by_frames!(frames, |G, first| self.frames::<S, G>(simd, first));
    }
}

impl<T: Project> Expand<'_, T> {
    #[inline(always)]
    fn frames<S: Simd, const G: usize>(&mut self, simd: S, first: usize) {
        let Self { ops, ranks, z, add, out } = self;
        let (cells, padded) = (ops.cells(), ops.padded);
        let z = &z[first * padded + ranks.start..(first + G - 1) * padded + ranks.end];
        for (panel, blocks) in ops.places.blocks.chunks_exact(BLOCKS).enumerate() {
            let mut sums = [[[T::default(); LANES]; BLOCKS]; G];
            T::expand(simd, ops.panel(panel, ranks.clone()), z, padded, &mut sums);
            for (f, sums) in sums.iter().enumerate() {
                for (sum, &at) in sums.iter().zip(blocks) {
                    let here = (first + f) * cells + at;
                    let before = if *add { load(out, here) } else { splat(T::default()) };
                    store(out, here, each!(|l| before[l] + sum[l]));
                }
            }
        }
    }
}

/// Computes [`Operators::gram`] in tiles.
#[inline(always)]
fn gram<T: Project>(ops: &Operators<T>, tau: &[T], ranks: usize, out: &mut [T]) {
    let padded = ops.padded;
    out.fill(T::default());
    let cells = ops.places.cells.chunks(CHUNK);
    for (rows, cells) in ops.rows.chunks(CHUNK * padded).zip(cells) {
        for first in (0..ranks).step_by(TILE) {
            for second in (first / LANES * LANES..ranks).step_by(LANES) {
                let mut sums = [[T::default(); LANES]; TILE];
                for (row, &cell) in rows.chunks_exact(padded).zip(cells) {
                    let right = load(row, second);
                    let weight = tau[cell];
                    for (i, sum) in sums.iter_mut().enumerate() {
                        let left = weight * row[first + i];
                        for l in 0..LANES {
                            sum[l] = left.mul_add(right[l], sum[l]);
                        }
                    }
                }
                for (i, sum) in sums.iter().enumerate() {
                    let at = (first + i) * padded + second;
                    let old = load(out, at);
                    store(out, at, each!(|l| old[l] + sum[l]));
                }
            }
        }
    }
}
