//! What is learnt from presses at known places.

use crate::error::Result;
use crate::frames::array;
use eit_skin::learn::{Learning, Press, PressTable};
use numpy::ndarray::Ix1;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use std::path::PathBuf;

/// A skin that was learnt from presses.
#[pyclass(module = "eit", frozen)]
pub(crate) struct LearnedSkin(pub(crate) Learning);

#[pymethods]
impl LearnedSkin {
    /// Writes the file that `Skin.with_learned` and the scene's [touch] learned take.
    fn write(&self, py: Python<'_>, path: PathBuf) -> Result<()> {
        Ok(py.detach(|| self.0.skin.write(path))?)
    }

    /// Number of presses.
    #[getter]
    fn presses(&self) -> usize {
        self.0.skin.presses.places_m.len()
    }

    /// How touches are found: by the presses, or by the model alone.
    #[getter]
    fn places_by(&self) -> &'static str {
        self.0.skin.places_by.description()
    }

    /// Median position error of presses that are held out, metres.
    #[getter]
    fn median_error_m(&self) -> f64 {
        self.0.skin.errors().median_m
    }

    /// Their mean position error, metres.
    #[getter]
    fn mean_error_m(&self) -> f64 {
        self.0.skin.errors().mean_m
    }

    /// Least and largest force that was learnt, newton; None if none was.
    #[getter]
    fn force_range_n(&self) -> Option<(f64, f64)> {
        self.0.skin.force.as_ref().map(|force| force.forces_n.into())
    }

    /// Presses that all others contradict, from 0: was the skin touched elsewhere?
    #[getter]
    fn unlike_presses(&self) -> Vec<usize> {
        self.0.unlike.iter().map(|unlike| unlike.press).collect()
    }

    fn __repr__(&self) -> String {
        format!("<eit.LearnedSkin of {} presses>", self.presses())
    }
}

/// Reads a table of presses: a file, or columns by name.
pub(crate) fn table(presses: &Bound<'_, PyAny>) -> Result<PressTable> {
    if let Ok(path) = presses.extract::<PathBuf>() {
        return Ok(PressTable::read(path)?);
    }
    let names = match presses.getattr("dtype").and_then(|dtype| dtype.getattr("names")) {
        Ok(names) => names.extract(),
        Err(_) => presses
            .call_method0("keys")
            .and_then(|keys| keys.try_iter()?.map(|key| key?.extract()).collect()),
    };
    let names: Vec<String> = names.map_err(|_| {
        PyTypeError::new_err("presses: must be a file, a structured array, or a dict of columns")
    })?;
    let mut rows: Vec<Press> = Vec::new();
    for (k, name) in names.iter().enumerate() {
        let column = array::<Ix1>(name, "[press]", &presses.get_item(name)?)?;
        let column = column.as_array();
        if k == 0 {
            rows.resize(column.len(), Press::default());
        }
        if rows.len() != column.len() {
            let (found, first) = (column.len(), rows.len());
            let message = format!("presses: {name} has {found} values, {} {first}", names[0]);
            return Err(PyValueError::new_err(message).into());
        }
        for (press, &value) in rows.iter_mut().zip(column) {
            set(press, name, value)?;
        }
    }
    Ok(PressTable::new(rows, "presses")?)
}

/// Sets a column of a press; NaN is a value that is not known.
fn set(press: &mut Press, name: &str, value: f64) -> PyResult<()> {
    let known = (!value.is_nan()).then_some(value);
    let frame = known.map(|value| value as usize);
    match name {
        "x_m" => press.x_m = value,
        "y_m" => press.y_m = value,
        "z_m" => press.z_m = known,
        "force_n" => press.force_n = known,
        "depth_m" => press.depth_m = known,
        "first_frame" => press.first_frame = frame,
        "last_frame" => press.last_frame = frame,
        "before_first" => press.before_first = frame,
        "before_last" => press.before_last = frame,
        _ => {
            let message = format!(
                "presses: {name} is no column; columns are x_m, y_m and optionally z_m, force_n, depth_m, first_frame, \
                 last_frame, before_first, before_last"
            );
            return Err(PyValueError::new_err(message));
        }
    }
    Ok(())
}
