//! A simulated recording with its truth.

use crate::skin::Skin;
use crate::touches::Rows;
use eit_skin::simulate::SimulatedRecording;
use numpy::{IntoPyArray, PyArray2, PyArray3};
use pyo3::prelude::*;

/// A simulated recording with its truth.
#[pyclass(module = "eit", frozen, get_all)]
pub(crate) struct Simulation {
    /// Voltages [frame, measurement], volt.
    frames: Py<PyArray2<f64>>,
    /// True change of conductivity [frame, row, column], siemens.
    images: Py<PyArray3<f64>>,
    /// True touches, one row per finger and frame: frame, time_s, finger, x_m, y_m, force_n, tip_radius_m,
    /// contact_radius_m, area_m2, depth_m.
    touches: Py<PyAny>,
    /// Frames per second.
    frame_rate_hz: f64,
    /// Number of frames at the start in which nothing touches the skin.
    quiet_frames: usize,
    /// The skin, with the reference, frame rate and noise of these frames.
    skin: Py<Skin>,
}

impl Simulation {
    /// Moves the frames and images into Python.
    pub(crate) fn new(py: Python<'_>, skin: Skin, made: SimulatedRecording) -> PyResult<Self> {
        let mut rows = Rows::default();
        let frame_rate_hz = made.script.frame_rate_hz;
        for touch in &made.simulation.truth.touches {
            rows.true_touch(touch.frame as f64 / frame_rate_hz, touch);
        }
        Ok(Self {
            touches: rows.into_true_touches(py)?.unbind(),
            frame_rate_hz,
            quiet_frames: made.script.quiet_frames,
            skin: Py::new(py, skin)?,
            frames: made.simulation.frames_v.into_pyarray(py).unbind(),
            images: made.simulation.truth.conductivity_change_s.into_pyarray(py).unbind(),
        })
    }
}

#[pymethods]
impl Simulation {
    fn __repr__(&self) -> String {
        format!("<eit.Simulation at {} frames a second>", self.frame_rate_hz)
    }
}
