//! Modified Bessel functions of orders 0 and 1, scaled: `exp(-x) I_n(x)` and `exp(x) K_n(x)`.
//!
//! I: the power series (Abramowitz and Stegun 9.6.10), whose terms are all positive, up to x = 30;
//! beyond that the asymptotic series (9.7.1), whose smallest term is then below 1e-17.
//!
//! K: the series with the logarithm (9.6.13, and its derivative) up to x = 2; then up to x = 30
//! `sqrt(x) exp(x) K_n(x)` as a Chebyshev series in `4 / x - 1`, from values of the integral 9.6.24,
//! `exp(x) K_n(x) = integral over t > 0 of exp(-x (cosh t - 1)) cosh(n t)`, by the trapezoidal rule,
//! which converges exponentially for such integrands; beyond that the asymptotic series (9.7.2).
//!
//! Relative errors are below 1e-12 for x from 1e-8 to 1e4 (tested with the Wronskian and against
//! tables).

use std::sync::LazyLock;

/// Euler's constant.
const GAMMA: f64 = 0.577_215_664_901_532_9;

/// Computes `exp(-x) [I_0(x), I_1(x)]`, x >= 0.
pub(super) fn i_scaled(x: f64) -> [f64; 2] {
    if x > 30.0 {
        let root = (std::f64::consts::TAU * x).sqrt();
        return [0.0, 4.0].map(|mu| asymptotic(mu, -x) / root);
    }
    let quarter = 0.25 * x * x;
    let (mut term, mut i0, mut i1) = (1.0, 0.0, 0.0);
    let mut k = 0.0;
    // terms decrease from k = x / 2 on
    while term > 1e-18 * i0 {
        i0 += term;
        i1 += term / (k + 1.0);
        k += 1.0;
        term *= quarter / (k * k);
    }
    let scale = (-x).exp();
    [scale * i0, scale * 0.5 * x * i1]
}

/// Computes `1 + (mu - 1) / 8x + (mu - 1)(mu - 9) / (2! (8x)^2) + ...`, for K at x and for I at -x.
fn asymptotic(mu: f64, x: f64) -> f64 {
    let (mut term, mut sum) = (1.0, 1.0);
    for k in 1..20 {
        let odd = f64::from(2 * k - 1);
        term *= (mu - odd * odd) / (f64::from(k) * 8.0 * x);
        sum += term;
    }
    sum
}

/// Computes `exp(x) [K_0(x), K_1(x)]`, x > 0.
pub(super) fn k_scaled(x: f64) -> [f64; 2] {
    if x > 30.0 {
        return k_far(x);
    }
    if x > 2.0 {
        return k_by_chebyshev(x);
    }
    let scale = x.exp();
    let [i0, i1] = i_scaled(x).map(|i| i * scale);
    let log = (0.5 * x).ln();
    let quarter = 0.25 * x * x;
    // psi(k + 1) = harmonic - gamma
    let (mut term, mut harmonic, mut s0, mut s1) = (1.0, 0.0, 0.0, 0.0);
    for k in 1..=20 {
        let k = f64::from(k);
        s1 += term / k * (2.0 * (harmonic - GAMMA) + 1.0 / k);
        harmonic += 1.0 / k;
        term *= quarter / (k * k);
        s0 += term * harmonic;
    }
    [scale * (s0 - (log + GAMMA) * i0), scale * (1.0 / x + log * i1 - 0.25 * x * s1)]
}

fn k_far(x: f64) -> [f64; 2] {
    let root = (0.5 * std::f64::consts::PI / x).sqrt();
    [0.0, 4.0].map(|mu| root * asymptotic(mu, x))
}

/// Number of terms of the Chebyshev series; the last ones are below 1e-16.
const TERMS: usize = 28;

/// Coefficients of the Chebyshev series of both orders, from its values at the roots of the polynomial of the next degree.
static CHEBYSHEV: LazyLock<[[f64; 2]; TERMS]> = LazyLock::new(|| {
    let angle = |node: usize| std::f64::consts::PI * (node as f64 + 0.5) / TERMS as f64;
    let values: [[f64; 2]; TERMS] = std::array::from_fn(|node| {
        let x = 4.0 / (1.0 + angle(node).cos());
        let k = if x > 30.0 { k_far(x) } else { k_by_integral(x) };
        k.map(|k| k * x.sqrt())
    });
    std::array::from_fn(|term| {
        let weight = if term == 0 { 1.0 } else { 2.0 } / TERMS as f64;
        [0, 1].map(|n| {
            let of = |node: usize| values[node][n] * (term as f64 * angle(node)).cos();
            weight * (0..TERMS).map(of).sum::<f64>()
        })
    })
});

/// The series by Clenshaw's recurrence.
fn k_by_chebyshev(x: f64) -> [f64; 2] {
    let u = 4.0 / x - 1.0;
    let ([mut a0, mut a1], [mut b0, mut b1]) = ([0.0; 2], [0.0; 2]);
    for [c0, c1] in CHEBYSHEV[1..].iter().rev() {
        (a0, b0) = (2.0 * u * a0 - b0 + c0, a0);
        (a1, b1) = (2.0 * u * a1 - b1 + c1, a1);
    }
    let [c0, c1] = CHEBYSHEV[0];
    let root = x.sqrt();
    [(u * a0 - b0 + c0) / root, (u * a1 - b1 + c1) / root]
}

fn k_by_integral(x: f64) -> [f64; 2] {
    // the width of the integrand is proportional to 1 / sqrt(x); six steps per standard deviation
    let step = 0.4 / x.sqrt();
    let first = step.cosh();
    let (mut before, mut cosh) = (1.0, first);
    let (mut k0, mut k1) = (0.5, 0.5);
    loop {
        let value = (x - x * cosh).exp();
        k0 += value;
        k1 += value * cosh;
        // cosh((n + 1) h) = 2 cosh(h) cosh(n h) - cosh((n - 1) h)
        (before, cosh) = (cosh, 2.0 * first * cosh - before);
        if value < 1e-18 {
            return [step * k0, step * k1];
        }
    }
}

/// [`k_scaled`] by linear interpolation over `1 / (1 + x)`: to 1e-3 from x = 0.005 to 20.
#[derive(Debug, Clone)]
pub(super) struct KTable {
    values: Vec<[f64; 2]>,
}

impl KTable {
    const INTERVALS: usize = 4096;

    pub(super) fn new() -> Self {
        let at = |k: usize| {
            let quotient = (k as f64 / Self::INTERVALS as f64).max(1e-6);
            // the last is at x = 0, where both are infinite: an eighth of an interval before it
            k_scaled((1.0 / quotient - 1.0).max(0.125 / Self::INTERVALS as f64))
        };
        Self { values: (0..=Self::INTERVALS).map(at).collect() }
    }

    #[inline]
    pub(super) fn at(&self, x: f64) -> [f64; 2] {
        let place = Self::INTERVALS as f64 / (1.0 + x);
        let k = (place as usize).min(Self::INTERVALS - 1);
        let (part, a, b) = (place - k as f64, self.values[k], self.values[k + 1]);
        [a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1])]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values from Abramowitz and Stegun, tables 9.8 and 9.11, with further digits as any function
    /// library gives.
    #[test]
    fn tabulated_values() {
        let table = [
            (1.0, 1.266_065_877_752_008_4, 0.565_159_103_992_485, 0.421_024_438_240_708_33),
            (2.0, 2.279_585_302_336_067, 1.590_636_854_637_329, 0.113_893_872_749_533_44),
        ];
        for (x, i0, i1, k0) in table {
            let [a, b] = i_scaled(x).map(|v| v * f64::exp(x));
            let k = k_scaled(x)[0] * f64::exp(-x);
            for (found, wanted) in [(a, i0), (b, i1), (k, k0)] {
                // rounding of about twenty terms
                assert!((found / wanted - 1.0).abs() < 1e-14, "{x}: {found} {wanted}");
            }
        }
        let k1 = k_scaled(1.0)[1] * f64::exp(-1.0);
        assert!((k1 / 0.601_907_230_197_234_6 - 1.0).abs() < 1e-14, "{k1}");
    }

    /// `I0 K1 + I1 K0 = 1/x` checks all four functions, over every branch.
    #[test]
    fn wronskian() {
        for k in -160..=80 {
            let x = 10_f64.powf(f64::from(k) / 20.0);
            let ([i0, i1], [k0, k1]) = (i_scaled(x), k_scaled(x));
            let wronskian = x * (i0 * k1 + i1 * k0);
            // thirty times the rounding error of cosh over twenty steps
            assert!((wronskian - 1.0).abs() < 1e-12, "x {x}: {wronskian}");
        }
    }

    /// The second derivative over the quotient limits the interpolation at small x, at large ones that over x.
    #[test]
    fn the_table_interpolates() {
        let table = KTable::new();
        for k in 0..=360 {
            let x = 0.005 * 10_f64.powf(0.01 * f64::from(k));
            let (found, wanted) = (table.at(x), k_scaled(x));
            (0..2).for_each(|n| assert!((found[n] / wanted[n] - 1.0).abs() < 1e-3, "{x} {n}"));
        }
    }

    /// Between the nodes too.
    #[test]
    fn the_series_is_the_integral() {
        for k in 1..=560 {
            let x = 2.0 + 0.05 * f64::from(k);
            let (found, wanted) = (k_by_chebyshev(x), k_by_integral(x));
            // the rounding error of cosh over twenty steps
            (0..2).for_each(|n| assert!((found[n] / wanted[n] - 1.0).abs() < 1e-13, "{x} {n}"));
        }
    }

    /// The methods agree where one takes over from another.
    #[test]
    fn branches_meet() {
        for (x, both) in
            [(2.0, k_scaled as fn(f64) -> [f64; 2]), (30.0, k_scaled), (30.0, i_scaled)]
        {
            let (below, above) = (both(x), both(x * (1.0 + 1e-14)));
            (0..2).for_each(|n| assert!((below[n] / above[n] - 1.0).abs() < 1e-12, "{x} {n}"));
        }
    }
}
