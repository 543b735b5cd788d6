//! Errors of the program: one line that says what, where and how to mend it, and an exit code.

use eit_fem::FemError;
use eit_mesh::MeshError;

/// Why a command stopped.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CliError {
    /// Wrong usage or bad input: exit code 2.
    #[error("{0}")]
    Input(String),
    /// Everything was right and it still failed: exit code 1.
    #[error("{0}")]
    Failure(String),
}

impl CliError {
    /// Bad input.
    pub fn input(message: impl Into<String>) -> Self {
        Self::Input(message.into())
    }

    /// A failure at a path.
    pub fn at(path: &std::path::Path, error: impl std::fmt::Display) -> Self {
        Self::Failure(format!("{}: {error}", path.display()))
    }

    /// The process's exit code.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Input(_) => 2,
            Self::Failure(_) => 1,
        }
    }

    /// The same error with the place in front.
    pub fn within(self, place: &str) -> Self {
        match self {
            Self::Input(m) => Self::Input(format!("{place}: {m}")),
            Self::Failure(m) => Self::Failure(format!("{place}: {m}")),
        }
    }
}

impl From<MeshError> for CliError {
    fn from(error: MeshError) -> Self {
        match error {
            MeshError::RefinementIncomplete { .. } | MeshError::Io { .. } => {
                Self::Failure(error.to_string())
            }
            _ => Self::Input(error.to_string()),
        }
    }
}

impl From<FemError> for CliError {
    fn from(error: FemError) -> Self {
        match error {
            FemError::NotPositiveDefinite { .. }
            | FemError::PivotOutOfPhase { .. }
            | FemError::OutOfMemory { .. } => Self::Failure(error.to_string()),
            _ => Self::Input(error.to_string()),
        }
    }
}

impl From<eit_inverse::InverseError> for CliError {
    fn from(error: eit_inverse::InverseError) -> Self {
        match error {
            eit_inverse::InverseError::Factorisation { .. } => Self::Failure(error.to_string()),
            _ => Self::Input(error.to_string()),
        }
    }
}

impl From<eit_denoise::DenoiseError> for CliError {
    fn from(error: eit_denoise::DenoiseError) -> Self {
        match error {
            eit_denoise::DenoiseError::Io { .. } => Self::Failure(error.to_string()),
            _ => Self::Input(error.to_string()),
        }
    }
}

impl From<eit_hw::HwError> for CliError {
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

impl From<crate::picture::PictureError> for CliError {
    fn from(error: crate::picture::PictureError) -> Self {
        Self::Failure(error.to_string())
    }
}
