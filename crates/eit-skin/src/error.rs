//! Errors: one line that says what, where and how to mend it.

use eit_fem::FemError;
use eit_mesh::MeshError;

/// Why a command stopped.
#[derive(Debug, thiserror::Error)]
pub enum SkinError {
    /// Wrong usage or bad input: exit code 2.
    #[error("{0}")]
    Input(String),
    /// Everything was right and it still failed: exit code 1.
    #[error("{0}")]
    Failure(String),
}

impl SkinError {
    /// Bad input.
    pub fn input(message: impl Into<String>) -> Self {
        Self::Input(message.into())
    }

    /// A failure at a path.
    pub fn at(path: &std::path::Path, error: impl std::fmt::Display) -> Self {
        Self::Failure(format!("{}: {error}", path.display()))
    }

    /// Whether the caller's input is at fault.
    pub fn is_input(&self) -> bool {
        matches!(self, Self::Input(_))
    }

    /// The same error with the place in front.
    pub fn within(self, place: &str) -> Self {
        match self {
            Self::Input(m) => Self::Input(format!("{place}: {m}")),
            Self::Failure(m) => Self::Failure(format!("{place}: {m}")),
        }
    }
}

impl From<MeshError> for SkinError {
    fn from(error: MeshError) -> Self {
        match error {
            MeshError::RefinementIncomplete { .. } | MeshError::Io { .. } => {
                Self::Failure(error.to_string())
            }
            _ => Self::Input(error.to_string()),
        }
    }
}

impl From<FemError> for SkinError {
    fn from(error: FemError) -> Self {
        match error {
            FemError::NotPositiveDefinite { .. }
            | FemError::PivotOutOfPhase { .. }
            | FemError::OutOfMemory { .. } => Self::Failure(error.to_string()),
            _ => Self::Input(error.to_string()),
        }
    }
}

impl From<eit_inverse::InverseError> for SkinError {
    fn from(error: eit_inverse::InverseError) -> Self {
        match error {
            eit_inverse::InverseError::Factorisation { .. } => Self::Failure(error.to_string()),
            _ => Self::Input(error.to_string()),
        }
    }
}

impl From<eit_denoise::DenoiseError> for SkinError {
    fn from(error: eit_denoise::DenoiseError) -> Self {
        match error {
            eit_denoise::DenoiseError::Io { .. } => Self::Failure(error.to_string()),
            _ => Self::Input(error.to_string()),
        }
    }
}

impl From<eit_hw::HwError> for SkinError {
    fn from(error: eit_hw::HwError) -> Self {
        match error {
            eit_hw::HwError::Write { .. }
            | eit_hw::HwError::Lost { .. }
            | eit_hw::HwError::Overflow { .. }
            | eit_hw::HwError::Identity { .. } => Self::Failure(error.to_string()),
            _ => Self::Input(error.to_string()),
        }
    }
}
