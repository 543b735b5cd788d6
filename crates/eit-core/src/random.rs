//! Seeded random numbers in independent streams.

use ndarray::Array2;
use rand_distr::{Distribution as _, StandardNormal, StandardUniform};
use rand_pcg::Pcg64;

/// Random number generator for simulation, training and tests: PCG XSL RR 128/64 (O'Neill, *PCG: a
/// family of simple fast space-efficient statistically good algorithms*, HMC-CS-2014-0905).
///
/// The same seed and stream give the same numbers on every machine, independent of other streams. A
/// part of a simulation with its own stream ([`Random::named`]) therefore does not affect the other
/// parts if it is switched on or off, or runs in another order.
#[derive(Debug, Clone)]
pub struct Random(Pcg64);

impl Random {
    /// Creates the first stream of a seed, for uses that need only one.
    pub fn new(seed: u64) -> Self {
        Self::stream(seed, 0)
    }

    /// Creates the stream for a purpose, such as `"contact drift"`, and an index within it, such as
    /// a frame or an electrode. Two names share a stream with a probability of 2^-64.
    pub fn named(seed: u64, purpose: &str, index: u64) -> Self {
        Self::stream(seed, u128::from(fnv1a(purpose)) << 64 | u128::from(index))
    }

    /// Creates the stream with this number; streams of one seed are independent.
    pub fn stream(seed: u64, stream: u128) -> Self {
        Self(Pcg64::new(u128::from(seed), stream))
    }

    /// Draws a number uniformly from [0, 1).
    pub fn uniform(&mut self) -> f64 {
        StandardUniform.sample(&mut self.0)
    }

    /// Draws a number uniformly from `low` to `high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Draws a number log-uniformly between two positive numbers.
    pub fn log_between(&mut self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }

    /// Draws an integer uniformly from 0 to below `count`; returns 0 if `count` is 0.
    pub fn below(&mut self, count: usize) -> usize {
        ((count as f64 * self.uniform()) as usize).min(count.saturating_sub(1))
    }

    /// Draws a normal number with mean 0 and standard deviation 1.
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    /// Returns the values with added white noise of standard deviation `std`.
    pub fn noisy(&mut self, values: &[f64], std: f64) -> Vec<f64> {
        values.iter().map(|value| value + std * self.normal()).collect()
    }

    /// Draws independent [`normal`](Self::normal) numbers, [row, column], row by row.
    pub fn normals(&mut self, rows: usize, columns: usize) -> Array2<f64> {
        Array2::from_shape_simple_fn((rows, columns), || self.normal())
    }
}

/// FNV-1a, 64 bits (Fowler, Noll and Vo, RFC 9923).
fn fnv1a(text: &str) -> u64 {
    const BASIS: u64 = 0xcbf2_9ce4_8422_2325;
    const PRIME: u64 = 0x0100_0000_01b3;
    text.bytes().fold(BASIS, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(PRIME))
}

#[cfg(test)]
mod tests {
    use super::{Random, fnv1a};

    /// If the generator's numbers changed, every simulated frame would change silently.
    #[test]
    fn numbers_stay_the_same() {
        let mut random = Random::stream(5, 8 << 64 | 17);
        let uniform = [0_u64; 3].map(|_| random.uniform().to_bits());
        let normal = [0_u64; 3].map(|_| random.normal().to_bits());
        assert_eq!(uniform, UNIFORM, "{uniform:x?}");
        assert_eq!(normal, NORMAL, "{normal:x?}");
    }

    const UNIFORM: [u64; 3] = [0x3fd0_80a3_a5ba_9dbc, 0x3fe6_2bd7_2cb6_fb2b, 0x3fee_16d8_35fa_dfe5];
    const NORMAL: [u64; 3] = [0xbfca_1259_3182_4b7f, 0xbff1_48dc_1a3f_1002, 0x3ff3_c36a_454d_ea21];

    #[test]
    fn streams_are_independent_and_repeat() {
        // a hash from the published test suite
        assert_eq!(fnv1a("foobar"), 0x8594_4171_f739_67e8);
        let first = |mut random: Random| [0; 4].map(|_| random.uniform().to_bits());
        let gain = first(Random::named(3, "gain", 0));
        assert_eq!(gain, first(Random::named(3, "gain", 0)));
        for other in [
            Random::new(3),
            Random::named(4, "gain", 0),
            Random::named(3, "gain", 1),
            Random::named(3, "noise", 0),
        ] {
            assert!(first(other).iter().all(|bits| !gain.contains(bits)));
        }
        // two streams of one seed: 10 000 products with mean 0 and deviation 1; allow five
        // deviations
        let (mut one, mut two) = (Random::named(1, "a", 0), Random::named(1, "b", 0));
        let mean = (0..10_000).map(|_| one.normal() * two.normal()).sum::<f64>() / 10_000.0;
        assert!(mean.abs() < 0.05, "{mean}");
    }

    /// Ten thousand numbers each; the tolerance is five standard deviations of the mean.
    #[test]
    fn distributions_have_their_moments() {
        const N: usize = 10_000;
        let mut random = Random::new(1);
        let uniform: Vec<f64> = (0..N).map(|_| random.between(-1.0, 3.0)).collect();
        assert!(uniform.iter().all(|v| (-1.0..3.0).contains(v)));
        let mean = uniform.iter().sum::<f64>() / N as f64;
        assert!((mean - 1.0).abs() < 5.0 * 1.155 / 100.0, "{mean}");
        let normal = random.normals(N / 10, 10);
        assert!(normal.mean().is_some_and(|mean| mean.abs() < 5.0 / 100.0));
        let variance = normal.iter().map(|v| v * v).sum::<f64>() / N as f64;
        assert!((variance - 1.0).abs() < 5.0 * 1.414 / 100.0, "{variance}");
        let mut counts = [0_usize; 4];
        (0..N).for_each(|_| counts[random.below(4)] += 1);
        // binomial: mean 2500, deviation 43
        assert!(counts.iter().all(|count| count.abs_diff(2500) < 217), "{counts:?}");
        assert_eq!((random.below(1), random.below(0)), (0, 0));
    }
}
