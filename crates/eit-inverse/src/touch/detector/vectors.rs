//! Products of vectors of rows, in a fixed order of sums.

/// Runs loops with the widest vectors of this processor. Results do not depend on them: sums are in parts of their own
/// ([`dot`]), and products are rounded before they are added.
#[inline(always)]
pub(in crate::touch) fn widest<R>(loops: impl FnOnce() -> R) -> R {
    pulp::Arch::new().dispatch(loops)
}

/// Scales the component along a unit vector.
#[inline(always)]
pub(super) fn shrink(y: &mut [f64], direction: &[f64], kept: f64) {
    let part = (1.0 - kept) * dot(direction, y);
    y.iter_mut().zip(direction).for_each(|(y, u)| *y -= part * u);
}

/// Dot product in eight partial sums, which lets the compiler vectorise it.
#[inline(always)]
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (a8, b8) = (a.chunks_exact(8), b.chunks_exact(8));
    let (a_rest, b_rest) = (a8.remainder(), b8.remainder());
    for (a, b) in a8.zip(b8) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    let mut rest = 0.0;
    for (a, b) in a_rest.iter().zip(b_rest) {
        rest += a * b;
    }
    let mut sum = 0.0;
    for part in sums {
        sum += part;
    }
    sum + rest
}

pub(super) fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}
