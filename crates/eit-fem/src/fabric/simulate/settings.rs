//! How to simulate.

/// How to simulate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SimulationSettings {
    /// Everything random comes from it.
    pub seed: u64,
    /// Threads, at least 1; the result does not depend on them.
    pub threads: usize,
    /// Keep the conductivity change of every element, 8 bytes an element and frame.
    pub keep_elements: bool,
}

impl Default for SimulationSettings {
    fn default() -> Self {
        Self { seed: 1, threads: 1, keep_elements: false }
    }
}
