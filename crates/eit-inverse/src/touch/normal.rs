//! Tails of the normal distribution, and samples of them for Monte Carlo integrals.

use std::f64::consts::SQRT_2;

/// `P(Z > t)` of a standard normal variable.
pub(super) fn upper_tail(t: f64) -> f64 {
    0.5 * libm::erfc(t / SQRT_2)
}

/// The `t >= 0` with `P(Z > t) = p`, by bisection.
///
/// 0 for `p >= 1/2`; at most 38, where the tail leaves the range of doubles.
pub(super) fn upper_quantile(p: f64) -> f64 {
    let (mut low, mut high) = (0.0_f64, 38.0_f64);
    // 60 halvings of 38 reach the last bit
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if upper_tail(middle) > p { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Student's quantile for `degrees` of freedom from the normal quantile with the same tail.
///
/// Source: Wallace, *Ann. Math. Stat.* 30 (1959), 1124-1130, inverted; within 1 % from 10 degrees on at the
/// levels used here.
pub(super) fn student_quantile(z: f64, degrees: f64) -> f64 {
    let scaled = z * (8.0 * degrees + 3.0) / (8.0 * degrees + 1.0);
    (degrees * (scaled * scaled / degrees).exp_m1()).sqrt()
}

/// Samples for a Monte Carlo integral over a normal tail, the same on every machine (Knuth's MMIX
/// multiplier, upper bits).
///
/// Touch thresholds depend on these numbers. Simulated data for training or tests comes from
/// `eit_fem::fabric::Random`, which would add two more crates here.
#[derive(Debug, Clone)]
pub(super) struct TailSampler(u64);

impl TailSampler {
    /// Starts from a seed.
    pub(super) fn new(seed: u64) -> Self {
        let mut this = Self(seed ^ 0x9e37_79b9_7f4a_7c15);
        (0..4).for_each(|_| _ = this.uniform());
        this
    }

    /// Uniform in (0, 1].
    pub(super) fn uniform(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 11) + 1) as f64 / (1_u64 << 53) as f64
    }

    /// Standard normal (Box-Muller).
    pub(super) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * self.uniform().ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }

    /// Standard normal conditioned on exceeding `t > 0` (Marsaglia 1964: a Rayleigh tail, accepted with
    /// probability `t / z`).
    pub(super) fn normal_above(&mut self, t: f64) -> f64 {
        loop {
            let z = (t * t - 2.0 * self.uniform().ln()).sqrt();
            if z * self.uniform() <= t {
                return z;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_are_those_of_tables() {
        // Abramowitz and Stegun, tables 26.1 and 26.2: eight digits and more
        for (t, p) in [(1.0, 0.158_655_253_931), (3.0, 1.349_898_031_63e-3), (5.0, 2.866_515_72e-7)]
        {
            assert!((upper_tail(t) / p - 1.0).abs() < 1e-8, "{t}");
            assert!((upper_quantile(p) - t).abs() < 1e-8, "{t}");
        }
        // t of 30 degrees at a tail of 0.0005: 3.646 (four digits of the table)
        assert!((student_quantile(upper_quantile(5e-4), 30.0) - 3.646).abs() < 0.01);
    }

    #[test]
    fn conditional_samples_have_the_tail_mean() {
        let mut random = TailSampler::new(1);
        let mean = (0..20_000).map(|_| random.normal_above(3.0)).sum::<f64>() / 20_000.0;
        // density over tail: 4.4318e-3 / 1.3499e-3 = 3.2831; std 0.27 over root 20 000, 5 of it
        assert!((mean - 3.2831).abs() < 0.01, "{mean}");
    }
}
