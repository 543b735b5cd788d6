//! Errors of the program: one line that says what is wrong, where and how to fix it, with an exit code.

use eit_report::ReportError;
use eit_skin::SkinError;

/// The reason why a command stopped.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CliError {
    /// Wrong usage or invalid input: exit code 2.
    #[error("{0}")]
    Input(String),
    /// The instrument was silent: exit code 3.
    #[error("{0}")]
    Silent(String),
    /// A failure although the input was valid: exit code 1.
    #[error("{0}")]
    Failure(String),
}

impl CliError {
    /// Creates an error for invalid input.
    pub fn input(message: impl Into<String>) -> Self {
        Self::Input(message.into())
    }

    /// Creates a failure at a path.
    pub fn at(path: &std::path::Path, error: impl std::fmt::Display) -> Self {
        Self::Failure(format!("{}: {error}", path.display()))
    }

    /// Returns the process's exit code.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Input(_) => 2,
            Self::Failure(_) => 1,
            Self::Silent(_) => crate::commands::SILENT,
        }
    }

    /// Prefixes the error with its location.
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
            true => Self::Input(with_option(&error)),
            false => Self::Failure(error.to_string()),
        }
    }
}

/// Text of an error in which the argument of a function is replaced by its option: `usual_tips` is
/// `--usual-tips`.
fn with_option(error: &ReportError) -> String {
    let words = error.to_string();
    let ReportError::Skin(skin) = error else { return words };
    let Some((name, problem)) = skin.as_argument() else { return words };
    // the place comes first
    let place = words.strip_suffix(&format!("{name}: {problem}")).unwrap_or_default();
    format!("{place}--{}: {problem}", name.replace('_', "-"))
}

impl From<eit_publish::PublishError> for CliError {
    fn from(error: eit_publish::PublishError) -> Self {
        match error.is_input() {
            true => Self::Input(error.to_string()),
            false => Self::Failure(error.to_string()),
        }
    }
}

/// Converts errors of the libraries via the report's.
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
