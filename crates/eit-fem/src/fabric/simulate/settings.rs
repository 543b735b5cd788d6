//! Settings of a simulation.

/// Settings of a simulation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct SimulationSettings {
    /// Seed of all random numbers.
    pub seed: u64,
    /// Number of threads, at least 1; more than 64 count as 64, the frames that are processed together. The result does
    /// not depend on it.
    pub threads: usize,
    /// Whether to keep the conductivity change of every element, 8 bytes per element and frame.
    pub keep_elements: bool,
}

impl Default for SimulationSettings {
    fn default() -> Self {
        Self { seed: 1, threads: 1, keep_elements: false }
    }
}
