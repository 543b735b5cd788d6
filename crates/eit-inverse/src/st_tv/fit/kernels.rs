//! Inner loops of the data step: Gram matrix and application to all frames.

use super::DataSteps;
use crate::st_tv::ball;
use crate::st_tv::float::Float;
use crate::st_tv::kernel::{CHUNK, LANES, PANEL, TILE, add_row, lanes};
use crate::st_tv::operators::Operators;
use crate::st_tv::state::State;
use pulp::{Simd, WithSimd};

/// Computes the upper triangle of `V' T V` of the head, in tiles.
pub(super) struct Gram<'a, T> {
    pub(super) ops: &'a Operators<T>,
    pub(super) state: &'a State<T>,
    pub(super) block: usize,
    pub(super) head: usize,
    pub(super) scaled: &'a mut [T],
    pub(super) product: &'a mut [T],
}

impl<T: Float> WithSimd for Gram<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { ops, state, block, head, scaled, product } = self;
        let (padded, blocks) = (ops.padded_rank, state.blocks());
        product.fill(T::default());
        for (chunk, panels) in ops.basis.chunks(CHUNK / PANEL * padded).enumerate() {
            let unknowns = panels.len() / padded * PANEL;
            for (p, row) in scaled.chunks_exact_mut(padded).enumerate().take(unknowns) {
                let tau = state.tau[(chunk * CHUNK + p) * blocks + block];
                let (root, panel) = (tau.sqrt(), &panels[p / PANEL * padded..][..head]);
                row.iter_mut().zip(panel).for_each(|(s, v)| *s = root * v[p % PANEL]);
            }
            let rows = &scaled[..unknowns * padded];
            for first in (0..head).step_by(TILE) {
                for second in (first / LANES * LANES..head).step_by(LANES) {
                    tile(rows, padded, [first, second], product);
                }
            }
        }
    }
}

/// Adds the products of the given rows to a tile.
#[inline(always)]
fn tile<T: Float>(rows: &[T], padded: usize, [first, second]: [usize; 2], product: &mut [T]) {
    let mut sums = [[T::default(); LANES]; TILE];
    for row in rows.chunks_exact(padded) {
        let (Some(left), Some(right)) =
            (row[first..].first_chunk::<TILE>(), row[second..].first_chunk::<LANES>())
        else {
            continue;
        };
        for i in 0..TILE {
            sums[i] = add_row(left[i], right, sums[i]);
        }
    }
    for (i, sum) in sums.iter().enumerate() {
        let out = &mut product[(first + i) * padded + second..][..LANES];
        for l in 0..LANES {
            out[l] += sum[l];
        }
    }
}

/// The data step of one iteration.
pub(super) struct Apply<'a, T> {
    pub(super) steps: &'a mut DataSteps<T>,
    pub(super) coefficients: &'a mut [T],
    pub(super) stride: usize,
}

impl<T: Float> WithSimd for Apply<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { steps: all, coefficients, stride } = self;
        let DataSteps { head, steps, used, singular, targets, residual, force, columns, .. } = all;
        let is_constrained = all.eigen.is_some();
        let [first, second] = columns;
        force[..*head * stride].fill(T::default());
        for step in steps[..*used].iter().filter(|step| step.lanes.contains(&true)) {
            let (rows, from) = (step.rows, step.block * LANES);
            load(coefficients, stride, from, &mut first[..*head]);
            if step.is_whole && !is_constrained {
                for (r, (c, s)) in second[..rows].iter_mut().zip(first.iter().zip(&*singular)) {
                    *r = lanes(|l| *s * c[l]);
                }
            } else {
                times(&step.forward, *head, &first[..*head], &mut second[..rows]);
            }
            for (k, r) in second[..rows].iter_mut().enumerate() {
                let b = &targets[k * stride + from..][..LANES];
                *r = lanes(|l| r[l] - b[l]);
            }
            if is_constrained {
                for lane in (0..LANES).filter(|&l| step.lanes[l]) {
                    constrain(&mut second[..rows], lane, &step.values, step.squares[lane]);
                }
            }
            store(&second[..rows], &step.lanes, stride, from, residual);
            times(&step.back, rows, &second[..rows], &mut first[..*head]);
            store(&first[..*head], &step.lanes, stride, from, force);
        }
        coefficients[..*head * stride].copy_from_slice(&force[..*head * stride]);
    }
}

#[inline(always)]
fn load<T: Float>(values: &[T], stride: usize, from: usize, out: &mut [[T; LANES]]) {
    for (k, out) in out.iter_mut().enumerate() {
        out.copy_from_slice(&values[k * stride + from..][..LANES]);
    }
}

#[inline(always)]
fn store<T: Float>(
    values: &[[T; LANES]],
    used: &[bool; LANES],
    stride: usize,
    from: usize,
    out: &mut [T],
) {
    for (k, values) in values.iter().enumerate() {
        let out = &mut out[k * stride + from..][..LANES];
        for l in 0..LANES {
            if used[l] {
                out[l] = values[l];
            }
        }
    }
}

/// Number of rows of a product that are summed together.
const ROWS: usize = 8;

/// Computes `out = a x`, `a` `[row][columns]`.
#[inline(always)]
fn times<T: Float>(a: &[T], columns: usize, x: &[[T; LANES]], out: &mut [[T; LANES]]) {
    if columns == 0 {
        out.fill([T::default(); LANES]);
        return;
    }
    for (a, out) in a.chunks(ROWS * columns).zip(out.chunks_mut(ROWS)) {
        match <&mut [[T; LANES]; ROWS]>::try_from(&mut *out) {
            Ok(out) => {
                let mut sums = [[T::default(); LANES]; ROWS];
                for (k, x) in x.iter().enumerate() {
                    for (r, sum) in sums.iter_mut().enumerate() {
                        *sum = add_row(a[r * columns + k], x, *sum);
                    }
                }
                *out = sums;
            }
            Err(_) => {
                for (a, out) in a.chunks_exact(columns).zip(out) {
                    let mut sum = [T::default(); LANES];
                    for (a, x) in a.iter().zip(x) {
                        sum = add_row(*a, x, sum);
                    }
                    *out = sum;
                }
            }
        }
    }
}

/// Applies `r -> mu r / (1 + mu e)` in a lane.
#[inline(always)]
fn constrain<T: Float>(residual: &mut [[T; LANES]], lane: usize, values: &[f64], square: f64) {
    let terms = || residual.iter().map(|r| r[lane].to_f64()).zip(values.iter().copied());
    let mu = ball::multiplier(terms, square);
    for (r, e) in residual.iter_mut().zip(values) {
        r[lane] = T::from_f64(ball::dual(r[lane].to_f64(), *e, mu));
    }
}
