//! Errors of the program: one line that says what, where and how to mend it, and an exit code.

use eit_report::ReportError;
use eit_skin::SkinError;

/// Why a command stopped.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CliError {
    /// Wrong usage or bad input: exit code 2.
    #[error("{0}")]
    Input(String),
    /// The instrument was silent: exit code 3.
    #[error("{0}")]
    Silent(String),
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
            Self::Silent(_) => crate::commands::SILENT,
        }
    }

    /// The same error with the place in front.
    pub fn within(self, place: &str) -> Self {
        match self {
            Self::Input(m) => Self::Input(format!("{place}: {m}")),
            Self::Failure(m) => Self::Failure(format!("{place}: {m}")),
            Self::Silent(m) => Self::Silent(format!("{place}: {m}")),
        }
    }
}

impl From<ReportError> for CliError {
    fn from(error: ReportError) -> Self {
        match error.is_input() {
            true => Self::Input(error.to_string()),
            false => Self::Failure(error.to_string()),
        }
    }
}

impl From<eit_publish::PublishError> for CliError {
    fn from(error: eit_publish::PublishError) -> Self {
        match error.is_input() {
            true => Self::Input(error.to_string()),
            false => Self::Failure(error.to_string()),
        }
    }
}

/// Errors of the libraries by way of a report's.
macro_rules! by_report {
    ($($error:ty),*) => {
        $(impl From<$error> for CliError {
            fn from(error: $error) -> Self {
                ReportError::from(error).into()
            }
        })*
    };
}

by_report!(
    SkinError,
    eit_denoise::DenoiseError,
    eit_fem::FemError,
    eit_hw::HwError,
    eit_inverse::InverseError,
    eit_mesh::MeshError,
    eit_picture::PictureError
);
