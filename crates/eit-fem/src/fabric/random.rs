//! Random numbers: one stream for each purpose and frame, so that neither the order of work nor a
//! part that is switched off changes the numbers of another.

use rand_distr::{Distribution as _, StandardNormal, StandardUniform};
use rand_pcg::Pcg64;

/// What numbers are for.
#[derive(Debug, Clone, Copy)]
pub(super) enum Purpose {
    Script = 1,
    Weave,
    SheetDrift,
    ContactDrift,
    Loose,
    NoiseLevel,
    Gain,
    Noise,
}

/// A stream of random numbers.
pub(super) struct Random(Pcg64);

impl Random {
    /// Of a seed, a purpose and an index within it (an electrode, a frame).
    pub fn new(seed: u64, purpose: Purpose, index: usize) -> Self {
        let stream = (purpose as u128) << 64 | index as u128;
        Self(Pcg64::new(u128::from(seed), stream))
    }

    /// Uniform between two numbers.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        let unit: f64 = StandardUniform.sample(&mut self.0);
        low + (high - low) * unit
    }

    /// Normal with mean zero and standard deviation one.
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }
}

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
