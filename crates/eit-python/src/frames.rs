//! Arguments: arrays, frames and their reference.

use crate::recording::Recording;
use eit_skin::frames::{FramesInput, ReferenceInput};
use eit_skin::scene::Reference;
use numpy::ndarray::{ArrayView2, Axis, Dimension};
use numpy::{AllowTypeChange, PyArrayLike, PyArrayLike2, PyUntypedArray};
use numpy::{PyArrayDescrMethods, PyUntypedArrayMethods};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use std::path::PathBuf;

/// An array of `f64`: read in place if it is one, else converted.
pub(crate) fn array<'py, D: Dimension + 'py>(
    name: &str,
    shape: &str,
    value: &Bound<'py, PyAny>,
) -> PyResult<PyArrayLike<'py, f64, D, AllowTypeChange>> {
    let is_real =
        value.cast::<PyUntypedArray>().is_ok_and(|array| b"fiub".contains(&array.dtype().kind()))
            || value.cast::<PyUntypedArray>().is_err();
    let found = if is_real { value.extract().ok() } else { None };
    found.ok_or_else(|| PyTypeError::new_err(format!("{name}: must be real numbers {shape}")))
}

/// Frames of a caller.
pub(crate) enum Frames<'py> {
    /// Files; the scene's if there are none.
    Files(Vec<PathBuf>),
    Recording(PyRef<'py, Recording>),
    Values(PyArrayLike2<'py, f64, AllowTypeChange>),
}

impl<'py> Frames<'py> {
    pub(crate) fn of(frames: Option<&Bound<'py, PyAny>>) -> PyResult<Self> {
        let Some(frames) = frames else { return Ok(Self::Files(Vec::new())) };
        if let Ok(recording) = frames.cast::<Recording>() {
            return Ok(Self::Recording(recording.borrow()));
        }
        if let Ok(file) = frames.extract::<PathBuf>() {
            return Ok(Self::Files(vec![file]));
        }
        match frames.extract::<Vec<PathBuf>>() {
            Ok(files) if !files.is_empty() => Ok(Self::Files(files)),
            _ => array("frames", "[frame, measurement], a Recording, or files", frames)
                .map(Self::Values),
        }
    }

    pub(crate) fn input(&self) -> FramesInput<'_> {
        match self {
            Self::Files(files) => FramesInput::Files(files),
            Self::Recording(recording) => FramesInput::Recording(recording.frames_of()),
            Self::Values(values) => FramesInput::Values(values.as_array()),
        }
    }
}

/// The reference of a caller.
pub(crate) enum ReferenceOf<'py> {
    Settings,
    Named(Reference),
    Values(PyArrayLike<'py, f64, numpy::IxDyn, AllowTypeChange>),
}

impl<'py> ReferenceOf<'py> {
    pub(crate) fn of(reference: Option<&Bound<'py, PyAny>>) -> PyResult<Self> {
        let Some(reference) = reference else { return Ok(Self::Settings) };
        if let Ok(frame) = reference.extract::<usize>() {
            return Ok(Self::Named(Reference::Frame(frame)));
        }
        if let Ok(path) = reference.extract::<PathBuf>() {
            return Ok(Self::Named(Reference::Text(path.display().to_string())));
        }
        let shape =
            "[measurement] or [frame, measurement], a frame number, \"mean\", \"N..M\", or a file";
        let values = array::<numpy::IxDyn>("reference", shape, reference)?;
        match values.ndim() {
            1 | 2 => Ok(Self::Values(values)),
            axes => {
                Err(PyTypeError::new_err(format!("reference: has {axes} axes; must be {shape}")))
            }
        }
    }

    pub(crate) fn input(&self) -> PyResult<ReferenceInput<'_>> {
        let values = match self {
            Self::Settings => return Ok(ReferenceInput::Settings),
            Self::Named(reference) => return Ok(ReferenceInput::Named(reference)),
            Self::Values(values) => values.as_array(),
        };
        let values = if values.ndim() == 1 { values.insert_axis(Axis(0)) } else { values };
        let values: ArrayView2<'_, f64> = values
            .into_dimensionality()
            .map_err(|error| PyTypeError::new_err(format!("reference: {error}")))?;
        Ok(ReferenceInput::Values(values))
    }
}
