//! Inner loops on lanes of [`LANES`] neighbouring cells of a frame, and on panels of [`PANEL`] cells of a few
//! frames for the products with the basis.
//!
//! Arrays of fixed length, passed by value, become registers: 16 values of `f32` fill one register of
//! 512 bits or two of 256. Everything is `inline(always)`, so that it is compiled for the widest SIMD registers of
//! the machine inside `pulp`'s dispatch; for the same reason no closures are passed to `map`.

use super::float::Float;
use pulp::{Simd, WithSimd};

/// Number of cells processed together.
pub(crate) const LANES: usize = 16;
/// Number of lanes of a panel.
pub(crate) const BLOCKS: usize = 4;
/// Number of cells of a panel.
pub(crate) const PANEL: usize = LANES * BLOCKS;

/// Values of neighbouring cells.
pub(crate) type Lane<T> = [T; LANES];

/// Computes a lane value by value: `each!(|l| value)`. A closure would be compiled once for all registers.
macro_rules! each {
    (|$l:ident| $value:expr) => {{
        let mut out = [Default::default(); $crate::st_tv::lanes::LANES];
        for $l in 0..$crate::st_tv::lanes::LANES {
            out[$l] = $value;
        }
        out
    }};
}
pub(crate) use each;

/// Loads the lane that starts at `at`.
#[inline(always)]
pub(crate) fn load<T: Float>(values: &[T], at: usize) -> Lane<T> {
    let mut out = [T::default(); LANES];
    out.copy_from_slice(&values[at..at + LANES]);
    out
}

/// Stores a lane at `at`.
#[inline(always)]
pub(crate) fn store<T: Float>(values: &mut [T], at: usize, lane: Lane<T>) {
    values[at..at + LANES].copy_from_slice(&lane);
}

/// Returns a lane of equal values.
#[inline(always)]
pub(crate) fn splat<T: Float>(value: T) -> Lane<T> {
    [value; LANES]
}

/// Clips `value` to `[-limit, limit]`.
#[inline(always)]
pub(crate) fn clip<T: Float>(value: T, limit: T) -> T {
    value.min(limit).max(T::default() - limit)
}

/// Returns `radius / max(|(a, b)|, least)`.
#[inline(always)]
pub(crate) fn shrink<T: Float>(a: Lane<T>, b: Lane<T>, radius: Lane<T>, least: Lane<T>) -> Lane<T> {
    each!(|l| radius[l] / a[l].mul_add(a[l], b[l] * b[l]).sqrt().max(least[l]))
}

/// Returns the sum of a lane, by pairwise summation.
#[inline(always)]
pub(crate) fn total<T: Float>(lane: &Lane<T>) -> T {
    let mut part = *lane;
    let mut width = LANES / 2;
    while width > 0 {
        for l in 0..width {
            part[l] += part[l + width];
        }
        width /= 2;
    }
    part[0]
}

/// Returns the largest value of a lane.
#[inline(always)]
pub(crate) fn largest<T: Float>(lane: &Lane<T>) -> T {
    let mut most = lane[0];
    for value in lane {
        most = most.max(*value);
    }
    most
}

/// Stored entry of a basis: at full precision, or as an integer fraction of the largest entry of its
/// rank, which is stored as 32767.
pub(crate) trait Entry<T>: Copy + Send + Sync + std::fmt::Debug {
    /// Returns the unit of the entries of a rank whose largest entry is `largest`.
    fn unit(largest: f64) -> f64;
    /// Rounds a value in units of its rank.
    fn rounded(value: f64) -> Self;
    /// Returns the entry, in units of its rank.
    fn value(self) -> T;
}

impl<T: Float> Entry<T> for T {
    fn unit(_: f64) -> f64 {
        1.0
    }

    fn rounded(value: f64) -> Self {
        T::from_f64(value)
    }

    #[inline(always)]
    fn value(self) -> T {
        self
    }
}

impl Entry<f32> for i16 {
    fn unit(largest: f64) -> f64 {
        if largest > 0.0 { largest / f64::from(i16::MAX) } else { 1.0 }
    }

    fn rounded(value: f64) -> Self {
        value.round() as i16
    }

    #[inline(always)]
    fn value(self) -> f32 {
        f32::from(self)
    }
}

/// Products with the basis, explicitly vectorised, because the compiler would vectorise along the ranks, with
/// gathers; and short entries of the basis. An entry is read once for `G` frames.
pub(crate) trait Project: Float {
    /// Entries of half the length, which halve the traffic from the L2 cache; `Self` for `f64`.
    type Short: Entry<Self>;

    /// Computes `sums[frame][k] += sum over the panel of basis[k] w[frame]`, with partial sums in lanes; rows of
    /// `sums` are `stride` apart.
    fn project<S: Simd, E: Entry<Self>, const G: usize>(
        simd: S,
        basis: &[[E; PANEL]],
        w: &[[Lane<Self>; BLOCKS]; G],
        sums: &mut [Lane<Self>],
        stride: usize,
    );

    /// Computes `out[frame] = sum over k of basis[k] z[frame][k]`; rows of `z` are `stride` apart.
    fn expand<S: Simd, E: Entry<Self>, const G: usize>(
        simd: S,
        basis: &[[E; PANEL]],
        z: &[Self],
        stride: usize,
        out: &mut [[Lane<Self>; BLOCKS]; G],
    );
}

/// Number of registers of a tile of [`Project::expand`].
const TILE: usize = 4;

macro_rules! project {
    ($t:ty, $short:ty, $lanes:ident, $read:ident, $write:ident, $splat:ident, $mul_add:ident) => {
        impl Project for $t {
            type Short = $short;

            #[inline(always)]
            fn project<S: Simd, E: Entry<Self>, const G: usize>(
                simd: S,
                basis: &[[E; PANEL]],
                w: &[[Lane<Self>; BLOCKS]; G],
                sums: &mut [Lane<Self>],
                stride: usize,
            ) {
                for (k, row) in basis.iter().enumerate() {
                    let mut wide = [0.0; PANEL];
                    for (wide, entry) in wide.iter_mut().zip(row) {
                        *wide = entry.value();
                    }
                    let row = S::$read(&wide).0;
                    for f in 0..G {
                        let w = S::$read(w[f].as_flattened()).0;
                        let sum = S::$write(&mut sums[f * stride + k]).0;
                        let width = sum.len();
                        for (i, sum) in sum.iter_mut().enumerate() {
                            let mut own = *sum;
                            for j in 0..BLOCKS {
                                let at = j * width + i;
                                own = simd.$mul_add(row[at], w[at], own);
                            }
                            *sum = own;
                        }
                    }
                }
            }

            #[inline(always)]
            fn expand<S: Simd, E: Entry<Self>, const G: usize>(
                simd: S,
                basis: &[[E; PANEL]],
                z: &[Self],
                stride: usize,
                out: &mut [[Lane<Self>; BLOCKS]; G],
            ) {
                let width = TILE * S::$lanes;
                for at in (0..PANEL).step_by(width) {
                    let mut sums = [[simd.$splat(0.0); TILE]; G];
                    for (k, row) in basis.iter().enumerate() {
                        let mut wide = [0.0; PANEL];
                        for (wide, entry) in wide[..width].iter_mut().zip(&row[at..at + width]) {
                            *wide = entry.value();
                        }
                        let row = S::$read(&wide[..width]).0;
                        for f in 0..G {
                            let factor = simd.$splat(z[f * stride + k]);
                            for j in 0..TILE {
                                sums[f][j] = simd.$mul_add(row[j], factor, sums[f][j]);
                            }
                        }
                    }
                    for f in 0..G {
                        let own = &mut out[f].as_flattened_mut()[at..at + width];
                        S::$write(own).0.copy_from_slice(&sums[f]);
                    }
                }
            }
        }
    };
}
project!(f32, i16, F32_LANES, as_simd_f32s, as_mut_simd_f32s, splat_f32s, mul_add_f32s);
project!(f64, f64, F64_LANES, as_simd_f64s, as_mut_simd_f64s, splat_f64s, mul_add_f64s);

/// A call to run with the widest registers.
pub(crate) struct Wide<F>(pub(crate) F);

impl<R, F: FnMut() -> R> WithSimd for Wide<F> {
    type Output = R;

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _: S) -> R {
        // pulp calls closures as `FnOnce`, by a function that is not inlined
        (self.0)()
    }
}

/// Runs a call with the widest registers of the machine. All that it calls must be `inline(always)`, and no closures.
macro_rules! vectorised {
    ($call:expr) => {
        ::pulp::Arch::new().dispatch($crate::st_tv::lanes::Wide(
            #[inline(always)]
            || $call,
        ))
    };
}
pub(crate) use vectorised;

/// Calls a method for all frames, a few at a time: `by_frames!(frames, |G, first| call)`.
macro_rules! by_frames {
    ($frames:expr, |$count:ident, $first:ident| $call:expr) => {{
        let mut $first = 0;
        while $first < $frames {
            $first += match $frames - $first {
                4.. => {
                    const $count: usize = 4;
                    $call;
                    $count
                }
                2.. => {
                    const $count: usize = 2;
                    $call;
                    $count
                }
                _ => {
                    const $count: usize = 1;
                    $call;
                    $count
                }
            };
        }
    }};
}
pub(crate) use by_frames;
