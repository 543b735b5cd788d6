//! Touches frame by frame.

use crate::error::{Error, Result};
use crate::frames::array;
use crate::touches::Rows;
use eit_hw::Frame;
use eit_skin::faults::ElectrodeFault;
use eit_skin::live::SkinState;
use eit_skin::{Next, SkinError, Touch};
use numpy::ndarray::{Array2, Ix1, Ix2};
use numpy::{IntoPyArray, PyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How often a wait looks for Ctrl-C.
const WAIT: Duration = Duration::from_millis(50);

/// Touches frame by frame: an iterator for an instrument or a recording, `push` for your own frames.
///
/// Waiting can be interrupted by Ctrl-C. A sensor is used by one thread at a time.
#[pyclass(module = "eit")]
pub(crate) struct Sensor {
    // never locked: makes the class `Sync`
    sensor: Mutex<eit_skin::Sensor>,
    pushed: u64,
}

/// What a frame showed, without a borrow of the sensor.
struct Shown {
    frame: TouchFrame,
    image: Option<Array2<f64>>,
}

impl Shown {
    fn of(shown: &eit_skin::TouchFrame<'_>) -> std::result::Result<Self, SkinError> {
        let image = shown.images.map(|images| images.raster().image_from_pixels(images.pixels()));
        let frame = TouchFrame {
            number: shown.number,
            sequence: shown.sequence,
            epoch: shown.epoch,
            time_s: shown.time_s,
            host_time_s: shown.host_time_s,
            latency_s: shown.latency_s,
            whole: shown.whole,
            skin: shown.state,
            found: shown.touches.to_vec(),
            excluded: shown.faults.to_vec(),
            image: None,
        };
        Ok(Self { frame, image: image.transpose()? })
    }

    fn into_frame(self, py: Python<'_>) -> TouchFrame {
        let image = self.image.map(|image| image.into_pyarray(py).unbind());
        TouchFrame { image, ..self.frame }
    }
}

/// What a wait ended with.
enum Waited {
    Frame(Box<Shown>),
    Other,
    Over,
}

impl Sensor {
    pub(crate) fn new(sensor: eit_skin::Sensor, images: bool) -> Self {
        let sensor = if images { sensor.with_images() } else { sensor };
        Self { sensor: Mutex::new(sensor), pushed: 0 }
    }

    fn inner(&mut self) -> &mut eit_skin::Sensor {
        self.sensor.get_mut().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for the next frame; `None` at the end of the source, or after `timeout`.
    fn wait(&mut self, py: Python<'_>, timeout: Option<Duration>) -> Result<Option<TouchFrame>> {
        let start = Instant::now();
        let sensor = self.inner();
        loop {
            let left =
                timeout.map_or(WAIT, |timeout| WAIT.min(timeout.saturating_sub(start.elapsed())));
            let waited = py.detach(|| {
                Ok::<_, SkinError>(match sensor.next_within(left)? {
                    Next::Frame(shown) => Waited::Frame(Box::new(Shown::of(&shown)?)),
                    Next::Over => Waited::Over,
                    _ => Waited::Other,
                })
            });
            py.check_signals()?;
            match waited? {
                Waited::Frame(shown) => return Ok(Some(shown.into_frame(py))),
                Waited::Over => return Ok(None),
                Waited::Other if timeout.is_some_and(|timeout| start.elapsed() >= timeout) => {
                    return Ok(None);
                }
                Waited::Other => {}
            }
        }
    }
}

#[pymethods]
impl Sensor {
    /// Takes a frame [measurement], volt, at this time; None while the reference is taken. NaN is a lost value.
    #[pyo3(signature = (frame, time_s=None))]
    fn push(
        &mut self,
        py: Python<'_>,
        frame: &Bound<'_, PyAny>,
        time_s: Option<f64>,
    ) -> Result<Option<TouchFrame>> {
        let values = array::<Ix1>("frame", "[measurement]", frame)?.as_array().to_vec();
        let frame = Frame { device_time_s: time_s, ..Frame::new(self.pushed, values) };
        self.pushed += 1;
        let sensor = self.inner();
        let shown = py.detach(|| {
            let shown = sensor.push(&frame)?;
            shown.map(|shown| Shown::of(&shown)).transpose()
        })?;
        Ok(shown.map(|shown| shown.into_frame(py)))
    }

    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__(&mut self, py: Python<'_>) -> Result<Option<TouchFrame>> {
        self.wait(py, None)
    }

    /// The next frame; None if none comes in time, or the source has ended.
    fn next_within(&mut self, py: Python<'_>, timeout_s: f64) -> Result<Option<TouchFrame>> {
        let timeout = Duration::try_from_secs_f64(timeout_s)
            .map_err(|error| PyValueError::new_err(format!("timeout_s: {timeout_s}: {error}")))?;
        self.wait(py, Some(timeout))
    }

    /// Takes frames [frame, measurement] of the untouched skin as the reference.
    fn set_reference(&mut self, py: Python<'_>, frames: &Bound<'_, PyAny>) -> Result<()> {
        let frames = array::<Ix2>("frames", "[frame, measurement]", frames)?;
        let rows = frames.as_array();
        let rows = rows.rows().into_iter().zip(self.pushed..);
        let frames: Vec<Frame> = rows.map(|(row, k)| Frame::new(k, row.to_vec())).collect();
        self.pushed += frames.len() as u64;
        let sensor = self.inner();
        py.detach(|| sensor.set_reference(&frames)).map_err(Error::from)
    }

    /// Takes a new reference: the next frames must show the untouched skin.
    fn restart(&mut self) {
        self.inner().restart();
    }

    /// Number of frames of the reference.
    #[getter]
    fn reference_frames(&mut self) -> usize {
        self.inner().reference_frames()
    }

    /// What the source and the reference say about the scene, such as voltages of another order.
    #[getter]
    fn notes(&mut self) -> Vec<String> {
        let sensor = self.inner();
        sensor.notices().iter().chain(sensor.notes()).cloned().collect()
    }
}

/// The touches of one frame.
#[pyclass(module = "eit", frozen)]
pub(crate) struct TouchFrame {
    /// Number of frames before it that were searched for touches.
    #[pyo3(get)]
    number: u64,
    /// The instrument's number of the frame; gaps are lost frames.
    #[pyo3(get)]
    sequence: u64,
    /// Number of the connection, from 0.
    #[pyo3(get)]
    epoch: u32,
    /// Time of the frame, seconds; always increases.
    #[pyo3(get)]
    time_s: f64,
    /// When its last byte arrived, seconds since 1970.
    #[pyo3(get)]
    host_time_s: Option<f64>,
    /// Time from its last byte to its touches, seconds.
    #[pyo3(get)]
    latency_s: Option<f64>,
    /// Whether every used measurement counted.
    #[pyo3(get)]
    whole: bool,
    /// Change of conductivity [row, column], siemens, if images are made.
    #[pyo3(get)]
    image: Option<Py<PyArray2<f64>>>,
    skin: SkinState,
    found: Vec<Touch>,
    excluded: Vec<ElectrodeFault>,
}

#[pymethods]
impl TouchFrame {
    /// What is known of the skin. Only if it is "sound", no touch means that nothing touches it.
    #[getter]
    fn state(&self) -> &'static str {
        self.skin.name()
    }

    /// Touches, of the type `touch_dtype`. Made when asked for: keep the array, not the attribute.
    #[getter]
    fn touches<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let mut rows = Rows::default();
        self.found.iter().for_each(|touch| rows.touch(self.number, self.time_s, touch, self.skin));
        rows.into_touches(py)
    }

    /// Electrodes that were left out, from 1.
    #[getter]
    fn faulty_electrodes(&self) -> Vec<usize> {
        self.excluded.iter().map(|fault| fault.electrode + 1).collect()
    }

    /// The same in words.
    #[getter]
    fn faults(&self) -> Vec<String> {
        self.excluded.iter().map(ElectrodeFault::description).collect()
    }

    fn __len__(&self) -> usize {
        self.found.len()
    }

    fn __repr__(&self) -> String {
        let (time_s, touches) = (self.time_s, self.found.len());
        format!("<eit.TouchFrame at {time_s:.3} s, {}, {touches} touches>", self.skin.name())
    }
}
