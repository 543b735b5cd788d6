//! A skin: from its scene to voltages, images and touches.

use crate::error::Result;
use crate::frames::{Frames, ReferenceOf, array};
use crate::learn::{LearnedSkin, table};
use crate::sensor::Sensor;
use crate::simulation::Simulation;
use crate::simulator::Simulator;
use crate::touches::Rows;
use eit_skin::eit_fem::Solution;
use eit_skin::learn::{Frame, LearnedSkin as Learned};
use eit_skin::simulate::{SimulateSettings, SimulatedRecording, simulator};
use eit_skin::touches::touches;
use eit_skin::{Observer, Progress, Scene, SkinError, rounding_warning};
use numpy::ndarray::{Array2, Ix1};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use std::borrow::Cow;
use std::path::PathBuf;
use std::sync::Arc;

/// A skin: mesh, protocol and model, set up from its scene. Its methods release the GIL while they compute.
#[pyclass(module = "eit", frozen)]
pub(crate) struct Skin {
    scene: Scene,
    skin: eit_skin::Skin,
}

/// Passes notes to the logger `eit`.
struct Logger;

impl Observer for Logger {
    fn note(&mut self, text: &str) {
        // a logger that fails must not stop the work
        let _ = Python::attach(|py| log(py, text));
    }
}

fn log(py: Python<'_>, text: &str) -> PyResult<()> {
    let logger = py.import("logging")?.call_method1("getLogger", ("eit",))?;
    logger.call_method1("info", (text,)).map(drop)
}

fn progress() -> Progress {
    Progress::new(Box::new(Logger))
}

impl Skin {
    /// Solves for a conductivity, else for that of the untouched skin, and takes something from the solution.
    fn solve<T: Send>(
        &self,
        py: Python<'_>,
        conductivity: Option<&Bound<'_, PyAny>>,
        take: fn(&mut Solution<'_>) -> T,
    ) -> Result<T> {
        let given = conductivity.map(|given| array::<Ix1>("conductivity", "[element]", given));
        let given = given.transpose()?;
        let given = given.as_ref().map(|given| given.as_array());
        let (taken, warning) = py.detach(|| {
            let conductivity_s = match given {
                None => Cow::Owned(self.skin.background_s()),
                Some(given) => match given.to_slice() {
                    Some(values) => Cow::Borrowed(values),
                    None => Cow::Owned(given.to_vec()),
                },
            };
            let mut workspace = self.skin.model.workspace()?;
            let mut solution = self.skin.solve(&conductivity_s, &mut workspace)?;
            Ok::<_, SkinError>((take(&mut solution), rounding_warning(&solution.report())?))
        })?;
        warning.map_or(Ok(()), |warning| log(py, &warning))?;
        Ok(taken)
    }
}

#[pymethods]
impl Skin {
    /// Reads a scene file, or a built-in scene such as "paper-disc".
    #[staticmethod]
    fn load(py: Python<'_>, scene: PathBuf) -> Result<Self> {
        Ok(py.detach(|| {
            let scene = Scene::load(scene)?;
            scene.check_stages()?;
            let skin = eit_skin::Skin::set_up(&scene, &Default::default(), &mut progress())?;
            Ok::<_, SkinError>(Self { scene, skin })
        })?)
    }

    /// Name of the scene.
    #[getter]
    fn name(&self) -> &str {
        &self.skin.name
    }

    /// Number of electrodes.
    #[getter]
    fn electrodes(&self) -> usize {
        self.skin.mesh.electrodes().len()
    }

    /// Number of voltages of a frame.
    #[getter]
    fn measurements(&self) -> usize {
        self.skin.protocol.measurements()
    }

    /// Number of elements of the mesh.
    #[getter]
    fn elements(&self) -> usize {
        self.skin.model.elements()
    }

    /// Conductivity of the untouched skin, siemens per square.
    #[getter]
    fn conductivity_s(&self) -> f64 {
        self.skin.conductivity_s
    }

    /// Electrodes [measurement, (a, b, m, n)], from 0: current enters at a, leaves at b; the value is the potential
    /// at m minus that at n. None for general current patterns.
    #[getter]
    fn quadruples<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray2<u32>>> {
        let quadruples = self.skin.protocol.quadruples()?;
        Some(Array2::from(quadruples.to_vec()).into_pyarray(py))
    }

    /// Centre of each element, metres, [element, (x, y, z)].
    #[getter]
    fn centroids_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        Array2::from(self.skin.mesh.surface().centroids().to_vec()).into_pyarray(py)
    }

    /// Voltages [measurement], volt, for conductivities [element] in siemens, else for the untouched skin.
    #[pyo3(signature = (conductivity=None))]
    fn forward<'py>(
        &self,
        py: Python<'py>,
        conductivity: Option<&Bound<'py, PyAny>>,
    ) -> Result<Bound<'py, PyArray1<f64>>> {
        let voltages = self.solve(py, conductivity, |solution| solution.measurements())?;
        Ok(voltages.into_pyarray(py))
    }

    /// Derivatives [measurement, element] of the voltages, volt per siemens.
    #[pyo3(signature = (conductivity=None))]
    fn jacobian<'py>(
        &self,
        py: Python<'py>,
        conductivity: Option<&Bound<'py, PyAny>>,
    ) -> Result<Bound<'py, PyArray2<f64>>> {
        let jacobian = self.solve(py, conductivity, |solution| solution.jacobian())?;
        Ok(jacobian.into_pyarray(py))
    }

    /// Runs a touch script, a built-in one or a file F.toml, on the simulated fabric of the scene.
    ///
    /// Built in are paper-one-finger and paper-two-fingers (one frame per second), one-finger, two-fingers, random, press-and-hold, tapping, stroking and closing-in.
    /// `frames` ends it early, `nodes` are those of the mesh. The same seed gives the same bytes.
    #[pyo3(signature = (script="random", seed=1, *, frames=None, nodes=None))]
    fn simulate(
        &self,
        py: Python<'_>,
        script: &str,
        seed: u64,
        frames: Option<usize>,
        nodes: Option<usize>,
    ) -> Result<Simulation> {
        let settings =
            SimulateSettings { script: script.to_owned(), seed, frames, nodes, threads: None };
        let made =
            py.detach(|| SimulatedRecording::run(&self.scene, &settings, &mut progress()))?;
        let skin = self.with(made.described(self.skin.clone()));
        Ok(Simulation::new(py, skin, made)?)
    }

    /// The simulated fabric of the scene, to be stepped with the contacts of a robot's simulator.
    ///
    /// `fast` linearises it: some fifty times as fast, and 4 to 6 % off. `nodes` are those of the mesh.
    #[pyo3(signature = (seed=1, *, fast=false, nodes=None))]
    fn simulator(
        &self,
        py: Python<'_>,
        seed: u64,
        fast: bool,
        nodes: Option<usize>,
    ) -> Result<Simulator> {
        Ok(Simulator::new(py.detach(|| simulator(&self.scene, seed, nodes, fast))?))
    }

    /// Images [frame, row, column] of the change of conductivity, siemens; `eit reconstruct` writes the same.
    ///
    /// `frames` are an array [frame, measurement] in volt, a Recording, or files; without them, the scene's files.
    /// `reference` is the frame to subtract: a number, "mean", "N..M" (frames N to M - 1), a file, or an array
    /// [measurement] or [frame, measurement] of the untouched skin; without it, the scene's. Several frames also
    /// show the noise. `method` is the scene's, or what suits it.
    #[pyo3(signature = (frames=None, reference=None, *, method=None))]
    fn reconstruct<'py>(
        &self,
        py: Python<'py>,
        frames: Option<&Bound<'py, PyAny>>,
        reference: Option<&Bound<'py, PyAny>>,
        method: Option<&str>,
    ) -> Result<Bound<'py, PyArray3<f64>>> {
        let (frames, reference) = (Frames::of(frames)?, ReferenceOf::of(reference)?);
        let (frames, reference) = (frames.input(), reference.input()?);
        let images = py.detach(|| {
            let progress = &mut progress();
            let frames = self.skin.frames(frames, reference)?;
            let mut done = self.skin.reconstruct(frames, method, progress)?;
            done.denoise(progress)?;
            Ok::<_, SkinError>(done.images.values)
        })?;
        Ok(images.into_pyarray(py))
    }

    /// Touches of a recording, one row per touch and frame, of the type `touch_dtype`; see `reconstruct`.
    #[pyo3(signature = (frames=None, reference=None))]
    fn touches<'py>(
        &self,
        py: Python<'py>,
        frames: Option<&Bound<'py, PyAny>>,
        reference: Option<&Bound<'py, PyAny>>,
    ) -> Result<Bound<'py, PyAny>> {
        let (frames, reference) = (Frames::of(frames)?, ReferenceOf::of(reference)?);
        let (frames, reference) = (frames.input(), reference.input()?);
        let rows = py.detach(|| {
            let progress = &mut progress();
            let frames = self.skin.frames(frames, reference)?;
            let fitted = Arc::new(self.skin.linearise(progress)?).fit(frames)?;
            fitted.frames.notes.iter().for_each(|note| progress.note(note));
            let found = touches(&fitted, progress)?;
            let found = found.ok_or(SkinError::UnknownNoise { who: "the detection of touches" })?;
            let mut rows = Rows::default();
            for row in &found.rows {
                let (frame, time_s) = found.in_recording(row);
                rows.touch(frame, time_s, &row.touch, found.state(row.frame));
            }
            Ok::<_, SkinError>(rows)
        })?;
        Ok(rows.into_touches(py)?)
    }

    /// Learns the skin from presses at known places; `eit learn` does the same.
    ///
    /// `presses` is a CSV file, or columns [press] by name: x_m, y_m (metres) and optionally z_m, force_n, depth_m,
    /// first_frame, last_frame (else each press has one frame), before_first, before_last (frames of the untouched
    /// skin before it, else the reference). `earlier` is a file learnt before, `fit_frame` says that places are
    /// a robot's coordinates.
    #[pyo3(signature = (presses, frames=None, reference=None, *, earlier=None, fit_frame=false))]
    fn learn(
        &self,
        py: Python<'_>,
        presses: &Bound<'_, PyAny>,
        frames: Option<&Bound<'_, PyAny>>,
        reference: Option<&Bound<'_, PyAny>>,
        earlier: Option<PathBuf>,
        fit_frame: bool,
    ) -> Result<LearnedSkin> {
        let (table, frame) =
            (table(presses)?, if fit_frame { Frame::Fitted } else { Frame::Scene });
        let (frames, reference) = (Frames::of(frames)?, ReferenceOf::of(reference)?);
        let (frames, reference) = (frames.input(), reference.input()?);
        let learning = py.detach(|| {
            let progress = &mut progress();
            let earlier = earlier.map(Learned::read).transpose()?;
            let recorded = self.skin.recorded_presses(&table, frames, reference, progress)?;
            Learned::learn(&recorded.fitted, &recorded.pressed, frame, earlier.as_ref(), progress)
        })?;
        Ok(LearnedSkin(learning))
    }

    /// The same skin, whose touches and forces come from what was learnt (`LearnedSkin.write`).
    fn with_learned(&self, path: PathBuf) -> Self {
        let mut skin = self.skin.clone();
        skin.settings.touch.learned = Some(path);
        self.with(skin)
    }

    /// A sensor whose frames you push. The first ones must show the untouched skin.
    #[pyo3(signature = (*, images=false))]
    fn sensor(&self, py: Python<'_>, images: bool) -> Result<Sensor> {
        Ok(Sensor::new(py.detach(|| self.skin.sensor())?, images))
    }

    /// Opens the instrument of the scene, at `port` if given: a serial port or tcp:HOST:PORT.
    #[pyo3(signature = (port=None, *, images=false))]
    fn open(&self, py: Python<'_>, port: Option<&str>, images: bool) -> Result<Sensor> {
        Ok(Sensor::new(py.detach(|| self.skin.open_at(port))?, images))
    }

    /// Plays a recording as if it were live, as fast as touches are asked for.
    #[pyo3(signature = (path, *, images=false))]
    fn replay(&self, py: Python<'_>, path: PathBuf, images: bool) -> Result<Sensor> {
        Ok(Sensor::new(py.detach(|| self.skin.replay(path))?, images))
    }

    fn __repr__(&self) -> String {
        format!("<eit.Skin {}, {} electrodes>", self.skin.name, self.electrodes())
    }
}

impl Skin {
    fn with(&self, skin: eit_skin::Skin) -> Self {
        Self { scene: self.scene.clone(), skin }
    }
}
