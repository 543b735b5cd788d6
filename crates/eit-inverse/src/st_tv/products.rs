//! Explicitly vectorised tiles of the two products with the basis.
//!
//! A tile keeps 4 or 8 rows of one or two registers of frames in registers while it runs over the other
//! index: eight sums or more hide the latency of an addition, and an entry of the basis is read once for
//! all frames of the tile. The compiler vectorises such tiles well up to 256 bits (see `kernel`); wider
//! ones it builds from scalars, at a fifth of the speed.

use super::kernel::PANEL;
use pulp::Simd;

/// Frames of a tile: those of whole registers from `offset` on.
#[derive(Clone, Copy)]
pub(crate) struct Frames {
    pub(crate) stride: usize,
    pub(crate) offset: usize,
}

/// Tiles for one floating-point type.
pub(crate) trait Tiles: Sized {
    /// Number of frames of one register.
    fn lanes<S: Simd>() -> usize;

    /// `out[p, :] += sum_k a[p][k] x[k, :]` for the unknowns of `P` panels and `V` registers of frames.
    fn spread<S: Simd, const P: usize, const V: usize>(
        simd: S,
        a: [&[[Self; PANEL]]; P],
        x: &[Self],
        frames: Frames,
        out: &mut [Self],
    );

    /// `out[k, :] += sum_p a[p][k] x[p, :]` for `R` ranks from `k` on and `V` registers of frames, over
    /// all panels of `rank` entries; `at` holds `rank` and `k`.
    fn collect<S: Simd, const R: usize, const V: usize>(
        simd: S,
        a: &[[Self; PANEL]],
        at: [usize; 2],
        x: &[Self],
        frames: Frames,
        out: &mut [Self],
    );
}

macro_rules! tiles {
    ($t:ty, $lanes:ident, $read:ident, $write:ident, $splat:ident, $mul_add:ident) => {
        impl Tiles for $t {
            #[inline(always)]
            fn lanes<S: Simd>() -> usize {
                S::$lanes
            }

            #[inline(always)]
            fn spread<S: Simd, const P: usize, const V: usize>(
                simd: S,
                a: [&[[$t; PANEL]]; P],
                x: &[$t],
                Frames { stride, offset }: Frames,
                out: &mut [$t],
            ) {
                let width = V * S::$lanes;
                let mut sums = [[[simd.$splat(0.0); V]; PANEL]; P];
                for p in 0..P {
                    for r in 0..PANEL {
                        let own = S::$read(&out[(p * PANEL + r) * stride + offset..][..width]).0;
                        sums[p][r].copy_from_slice(own);
                    }
                }
                let ranks = a[0].len();
                let a = a.map(|a| &a[..ranks]);
                for (k, row) in x.chunks_exact(stride).enumerate().take(ranks) {
                    let row = S::$read(&row[offset..][..width]).0;
                    for p in 0..P {
                        for r in 0..PANEL {
                            let entry = simd.$splat(a[p][k][r]);
                            for v in 0..V {
                                sums[p][r][v] = simd.$mul_add(entry, row[v], sums[p][r][v]);
                            }
                        }
                    }
                }
                for p in 0..P {
                    for r in 0..PANEL {
                        let own = &mut out[(p * PANEL + r) * stride + offset..][..width];
                        S::$write(own).0.copy_from_slice(&sums[p][r]);
                    }
                }
            }

            #[inline(always)]
            fn collect<S: Simd, const R: usize, const V: usize>(
                simd: S,
                a: &[[$t; PANEL]],
                [rank, k]: [usize; 2],
                x: &[$t],
                Frames { stride, offset }: Frames,
                out: &mut [$t],
            ) {
                let width = V * S::$lanes;
                let mut sums = [[simd.$splat(0.0); V]; R];
                for s in 0..R {
                    let own = S::$read(&out[s * stride + offset..][..width]).0;
                    sums[s].copy_from_slice(own);
                }
                for (a, rows) in a.chunks_exact(rank).zip(x.chunks_exact(PANEL * stride)) {
                    let Some(a) = a[k..].first_chunk::<R>() else { continue };
                    for r in 0..PANEL {
                        let row = S::$read(&rows[r * stride + offset..][..width]).0;
                        for s in 0..R {
                            let entry = simd.$splat(a[s][r]);
                            for v in 0..V {
                                sums[s][v] = simd.$mul_add(entry, row[v], sums[s][v]);
                            }
                        }
                    }
                }
                for s in 0..R {
                    let own = &mut out[s * stride + offset..][..width];
                    S::$write(own).0.copy_from_slice(&sums[s]);
                }
            }
        }
    };
}

tiles!(f32, F32_LANES, as_simd_f32s, as_mut_simd_f32s, splat_f32s, mul_add_f32s);
tiles!(f64, F64_LANES, as_simd_f64s, as_mut_simd_f64s, splat_f64s, mul_add_f64s);
