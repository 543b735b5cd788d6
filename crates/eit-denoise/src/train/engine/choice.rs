//! The engines by name.

use crate::DenoiseError;
use std::fmt;
use std::str::FromStr;

/// What computes error and derivative of a step. The choice is no part of a training: weights and
/// checkpoints of one go on with another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Engine {
    /// The kernels of this crate: the same bits for any number of threads.
    #[default]
    Own,
    /// Automatic differentiation by burn on one thread of the processor (feature `burn`): slower,
    /// and independent of our kernels and of our derivative.
    Burn,
    /// burn on the first CUDA device (feature `cuda`).
    Cuda,
    /// burn on the first graphics device of Vulkan, Metal or DirectX (feature `wgpu`).
    Wgpu,
}

impl Engine {
    /// All of them, those that are not compiled in too.
    pub const ALL: [Self; 4] = [Self::Own, Self::Burn, Self::Cuda, Self::Wgpu];

    /// Its name, which is that of its feature too.
    pub fn name(self) -> &'static str {
        match self {
            Self::Own => "own",
            Self::Burn => "burn",
            Self::Cuda => "cuda",
            Self::Wgpu => "wgpu",
        }
    }
}

impl fmt::Display for Engine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Engine {
    type Err = DenoiseError;

    fn from_str(text: &str) -> Result<Self, DenoiseError> {
        let found = Self::ALL.into_iter().find(|engine| engine.name() == text);
        found.ok_or_else(|| DenoiseError::UnknownEngine { found: text.to_owned() })
    }
}
