//! The error type of this crate.

use eit_denoise::DenoiseError;
use eit_fem::FemError;
use eit_hw::HwError;
use eit_inverse::InverseError;
use eit_mesh::MeshError;
use eit_picture::PictureError;
use eit_skin::SkinError;
use std::path::Path;

/// A report that failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// Invalid settings or input.
    #[error("{0}")]
    Input(String),
    /// A failure with valid input.
    #[error("{0}")]
    Failure(String),
    /// An error of `eit-skin`.
    #[error(transparent)]
    Skin(#[from] SkinError),
}

impl ReportError {
    /// Creates an error for invalid input.
    pub fn input(message: impl Into<String>) -> Self {
        Self::Input(message.into())
    }

    /// Creates a failure that names a path.
    pub fn at(path: &Path, error: impl std::fmt::Display) -> Self {
        Self::Failure(format!("{}: {error}", path.display()))
    }

    /// Whether the caller's input is at fault.
    pub fn is_input(&self) -> bool {
        match self {
            Self::Input(_) => true,
            Self::Failure(_) => false,
            Self::Skin(error) => error.is_input(),
        }
    }

    /// Prepends the place to the error.
    pub fn within(self, place: &str) -> Self {
        match self {
            Self::Input(m) => Self::Input(format!("{place}: {m}")),
            Self::Failure(m) => Self::Failure(format!("{place}: {m}")),
            Self::Skin(error) => Self::Skin(error.within(place)),
        }
    }
}

macro_rules! by_skin {
    ($($error:ty),*) => {
        $(impl From<$error> for ReportError {
            fn from(error: $error) -> Self {
                Self::Skin(error.into())
            }
        })*
    };
}

by_skin!(DenoiseError, FemError, HwError, InverseError, MeshError);

impl From<ndarray::ShapeError> for ReportError {
    fn from(error: ndarray::ShapeError) -> Self {
        Self::Failure(error.to_string())
    }
}

impl From<PictureError> for ReportError {
    fn from(error: PictureError) -> Self {
        Self::Failure(error.to_string())
    }
}
