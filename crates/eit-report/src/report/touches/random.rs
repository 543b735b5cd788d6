//! Seeded random numbers.

use rand_distr::{Distribution as _, StandardNormal, StandardUniform};
use rand_pcg::Pcg64Mcg;

/// Seeded random numbers.
pub(super) struct Random(Pcg64Mcg);

impl Random {
    /// Of a seed and a purpose: the same numbers whatever else is drawn.
    pub fn new(seed: u64, purpose: u64) -> Self {
        Self(Pcg64Mcg::new(u128::from(seed) << 64 | u128::from(purpose) << 1 | 1))
    }

    /// Normal, standard deviation 1.
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    /// Uniform from 0 to 1.
    pub fn uniform(&mut self) -> f64 {
        StandardUniform.sample(&mut self.0)
    }

    /// Values with white noise.
    pub fn noisy(&mut self, values: &[f64], std: f64) -> Vec<f64> {
        values.iter().map(|v| v + std * self.normal()).collect()
    }
}
