//! Errors of the library as exceptions.

use eit_skin::SkinError;
use pyo3::exceptions::{PyException, PyValueError};
use pyo3::prelude::*;

pyo3::create_exception!(
    eit,
    EitError,
    PyException,
    "Invalid input, or a failure; the message says what, where and how to mend it."
);

/// An exception.
pub(crate) struct Error(PyErr);

/// Result of a method.
pub(crate) type Result<T> = std::result::Result<T, Error>;

impl From<SkinError> for Error {
    fn from(error: SkinError) -> Self {
        let is_argument = error.as_argument().is_some()
            || matches!(error, SkinError::MeasurementCount { .. } | SkinError::FrameLength { .. });
        let message = error.to_string();
        Self(match is_argument {
            true => PyValueError::new_err(message),
            false => EitError::new_err(message),
        })
    }
}

impl From<PyErr> for Error {
    fn from(error: PyErr) -> Self {
        Self(error)
    }
}

impl From<Error> for PyErr {
    fn from(error: Error) -> Self {
        error.0
    }
}
