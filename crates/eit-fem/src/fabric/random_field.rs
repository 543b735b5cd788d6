//! Random fields, for random variation of the fabric in space or time.

use eit_core::Random;

/// Stationary Gaussian process or field as a sum of waves with random directions. Averaged over
/// seeds, its covariance is `exp(-|x|^2 / 2 L^2)` (spectral representation, Shinozuka and Deodatis,
/// Applied Mechanics Reviews 44:191, 1991).
#[derive(Debug, Clone)]
pub(super) struct Waves<const D: usize> {
    /// Wave vector and phase of each wave.
    waves: Vec<([f64; D], f64)>,
}

impl<const D: usize> Waves<D> {
    /// Draws `count` waves for the correlation length (or time) `correlation`.
    pub(crate) fn new(random: &mut Random, correlation: f64, count: usize) -> Self {
        let mut wave = || {
            let vector = std::array::from_fn(|_| random.normal() / correlation);
            (vector, random.between(0.0, std::f64::consts::TAU))
        };
        Self { waves: (0..count).map(|_| wave()).collect() }
    }

    /// Returns the value at a point. The variance is one.
    pub(crate) fn at(&self, place: [f64; D]) -> f64 {
        let wave = |(k, phase): &([f64; D], f64)| {
            (k.iter().zip(place).map(|(k, x)| k * x).sum::<f64>() + phase).cos()
        };
        let sum: f64 = self.waves.iter().map(wave).sum();
        sum * (2.0 / self.waves.len() as f64).sqrt()
    }
}
