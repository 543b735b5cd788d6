//! Recorded frames.

use crate::error::Result;
use crate::frames::array;
use eit_hw::{Layout, Unit, read_recording};
use eit_skin::SkinError;
use numpy::ndarray::{Array2, Ix2};
use numpy::{IntoPyArray, PyArray1, PyArray2, ToPyArray};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::path::PathBuf;

/// Frames of a recording, as its file has them; or of an array [frame, measurement], volt, in protocol order.
#[pyclass(module = "eit", frozen)]
pub(crate) struct Recording(eit_hw::Recording);

impl Recording {
    pub(crate) fn frames_of(&self) -> &eit_hw::Recording {
        &self.0
    }
}

#[pymethods]
impl Recording {
    #[new]
    #[pyo3(signature = (frames, frame_rate_hz=None))]
    fn new(py: Python<'_>, frames: &Bound<'_, PyAny>, frame_rate_hz: Option<f64>) -> Result<Self> {
        if let Some(rate) = frame_rate_hz.filter(|rate| !(*rate > 0.0 && rate.is_finite())) {
            let message = format!("frame_rate_hz: {rate}; it must be above 0");
            return Err(PyValueError::new_err(message).into());
        }
        let frames = array::<Ix2>("frames", "[frame, measurement]", frames)?;
        let frames = frames.as_array();
        let made = py.detach(|| eit_hw::Recording::of_values(frames, frame_rate_hz));
        Ok(Self(made.map_err(SkinError::from)?))
    }

    /// Reads a recording: MCAP, CSV, NPY, NPZ, MATLAB, or the format of an instrument.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> Result<Self> {
        let read = py.detach(|| read_recording(path, None, &Default::default()));
        Ok(Self(read.map_err(SkinError::from)?))
    }

    /// Writes a new MCAP recording, which `eit replay` and `Skin.replay` play.
    fn write(&self, py: Python<'_>, path: PathBuf) -> Result<()> {
        Ok(py.detach(|| eit_skin::recording::write(&self.0, path))?)
    }

    /// A copy of the values [frame, value], in the order of the file.
    #[getter]
    fn frames<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.0.real.to_pyarray(py)
    }

    /// Time of each frame, seconds.
    #[getter]
    fn time_s<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.0.device_time_s.as_ref().map(|times| times.to_pyarray(py))
    }

    /// Electrodes [value, (a, b, m, n)], from 0, if the file names them.
    #[getter]
    fn quadruples<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray2<u32>>> {
        match &self.0.layout {
            Layout::Quadruples(quadruples) => {
                Some(Array2::from(quadruples.clone()).into_pyarray(py))
            }
            _ => None,
        }
    }

    /// Unit of the values.
    #[getter]
    fn unit(&self) -> &'static str {
        match self.0.unit {
            Unit::Volt => "volt",
            Unit::Ohm => "ohm",
            Unit::Arbitrary => "arbitrary",
        }
    }

    /// What the reader noticed.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.0.notes.iter().map(ToString::to_string).collect()
    }

    fn __len__(&self) -> usize {
        self.0.frame_count()
    }

    fn __repr__(&self) -> String {
        let [frames, values] = [self.0.frame_count(), self.0.value_count()];
        format!("<eit.Recording of {frames} frames of {values} values>")
    }
}
