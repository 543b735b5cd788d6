//! Random number streams of the simulated fabric.

use eit_core::Random;

/// Purpose of a random number stream.
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
    Floating,
    Warming,
    Flicker,
    Mains,
    Print,
    Torn,
    Spike,
}

impl Purpose {
    /// Creates the stream of a seed for this purpose and an index within it (an electrode, a
    /// frame).
    pub(crate) fn stream(self, seed: u64, index: usize) -> Random {
        Random::stream(seed, (self as u128) << 64 | index as u128)
    }
}
