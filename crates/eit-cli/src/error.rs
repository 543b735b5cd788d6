//! Errors of the program: one line that says what is wrong, where and how to fix it, with an exit code.

use eit_report::ReportError;
use eit_skin::SkinError;

/// Exit codes of the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Exit {
    Done = 0,
    /// A failure although the input was valid.
    Failed = 1,
    /// Wrong usage or invalid input.
    Input = 2,
    /// The instrument was silent or unplugged at the end.
    Silent = 3,
    /// `eit check` found a fault.
    Faulty = 4,
}

/// The reason why a command stopped.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub(crate) struct CliError {
    message: String,
    pub(crate) exit: Exit,
}

impl CliError {
    /// Creates an error for invalid input.
    pub(crate) fn input(message: impl Into<String>) -> Self {
        Self { message: message.into(), exit: Exit::Input }
    }

    /// Creates a failure with valid input.
    pub(crate) fn failure(message: impl Into<String>) -> Self {
        Self { message: message.into(), exit: Exit::Failed }
    }

    /// Creates the error for an instrument that sends nothing.
    pub(crate) fn silent(message: impl Into<String>) -> Self {
        Self { message: message.into(), exit: Exit::Silent }
    }

    /// Creates a failure at a path.
    pub(crate) fn at(path: &std::path::Path, error: impl std::fmt::Display) -> Self {
        Self::failure(format!("{}: {error}", path.display()))
    }

    /// Prefixes the error with its location.
    pub(crate) fn within(self, place: &str) -> Self {
        Self { message: format!("{place}: {}", self.message), ..self }
    }

    fn of(error: impl std::fmt::Display, is_input: bool) -> Self {
        let exit = if is_input { Exit::Input } else { Exit::Failed };
        Self { message: error.to_string(), exit }
    }
}

impl From<ReportError> for CliError {
    fn from(error: ReportError) -> Self {
        Self::of(with_option(&error), error.is_input())
    }
}

/// Text of an error, in which an argument of a function is the option that it comes from: `usual_tips` is
/// `--usual-tips`.
fn with_option(error: &ReportError) -> String {
    let text = error.to_string();
    let ReportError::Skin(skin) = error else { return text };
    let Some((name, problem)) = skin.as_argument() else { return text };
    // the place comes first
    let place = text.strip_suffix(&format!("{name}: {problem}")).unwrap_or_default();
    format!("{place}--{}: {problem}", name.replace('_', "-"))
}

impl From<eit_publish::PublishError> for CliError {
    fn from(error: eit_publish::PublishError) -> Self {
        Self::of(&error, error.is_input())
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
