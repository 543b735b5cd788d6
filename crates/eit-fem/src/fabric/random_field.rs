//! Random fields: what of the fabric varies in place or time without a rule.

use super::random::Random;

/// A stationary Gaussian process or field as a sum of waves with random directions: covariance
/// `exp(-|x|^2 / 2 L^2)` on average over seeds (spectral representation, Shinozuka and Deodatis,
/// Applied Mechanics Reviews 44:191, 1991).
#[derive(Debug, Clone)]
pub(super) struct Waves<const D: usize> {
    /// Wave vector and phase.
    waves: Vec<([f64; D], f64)>,
}

impl<const D: usize> Waves<D> {
    /// `count` waves of correlation length (or time) `correlation`.
    pub fn new(random: &mut Random, correlation: f64, count: usize) -> Self {
        let mut wave = || {
            let vector = std::array::from_fn(|_| random.normal() / correlation);
            (vector, random.between(0.0, std::f64::consts::TAU))
        };
        Self { waves: (0..count).map(|_| wave()).collect() }
    }

    /// Value at a place; variance one.
    pub fn at(&self, place: [f64; D]) -> f64 {
        let wave = |(k, phase): &([f64; D], f64)| {
            (k.iter().zip(place).map(|(k, x)| k * x).sum::<f64>() + phase).cos()
        };
        let sum: f64 = self.waves.iter().map(wave).sum();
        sum * (2.0 / self.waves.len() as f64).sqrt()
    }
}
