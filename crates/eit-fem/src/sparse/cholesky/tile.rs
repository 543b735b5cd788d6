//! Tiles: a few columns by a few neighbouring rows, held in registers.

use crate::sparse::scalar::Scalar;

/// Rows of the smaller tile. Rows and columns are padded to a multiple of it.
pub(super) const LANES: usize = 4;

/// Rows of the larger tile.
pub(super) const WIDE: usize = 2 * LANES;

/// Loads `W` columns of `R` rows, starting at `row`.
#[inline(always)]
pub(super) fn tile<T: Scalar, const W: usize, const R: usize>(
    from: &[f64],
    stride: usize,
    row: usize,
) -> [T::Lanes<R>; W] {
    std::array::from_fn(|c| T::load(&from[c * T::PLANES * stride + row..], stride))
}

/// Stores `W` columns of `R` rows, starting at `row`.
#[inline(always)]
pub(super) fn store<T: Scalar, const W: usize, const R: usize>(
    sums: &[T::Lanes<R>; W],
    to: &mut [f64],
    stride: usize,
    row: usize,
) {
    for (c, sums) in sums.iter().enumerate() {
        T::store(sums, &mut to[c * T::PLANES * stride + row..], stride);
    }
}
