//! A simulated skin that is stepped.

use crate::error::Result;
use crate::frames::array;
use eit_skin::eit_fem::fabric::{Contact, SimulatedSkin, Tip};
use numpy::ndarray::Ix2;
use numpy::{IntoPyArray, PyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::sync::{Mutex, PoisonError};

/// A simulated skin, stepped frame by frame with the contacts of a robot's simulator.
#[pyclass(module = "eit")]
pub(crate) struct Simulator {
    // never locked: makes the class `Sync`
    skin: Mutex<SimulatedSkin>,
    time_s: f64,
    exact: Option<Py<PyArray1<f64>>>,
}

impl Simulator {
    pub(crate) fn new(skin: SimulatedSkin) -> Self {
        Self { skin: Mutex::new(skin), time_s: f64::NAN, exact: None }
    }
}

#[pymethods]
impl Simulator {
    /// Moves the contacts and measures the next frame [measurement], volt, `dt_s` after the one before.
    ///
    /// `contacts` are [contact, (x_m, y_m, force_n, radius_m)], spheres, or with `flat` soft pads of that radius.
    /// `fingers` are their numbers, by which a moved finger is known; without them, the rows' from 1.
    #[pyo3(signature = (contacts, dt_s, *, fingers=None, flat=false))]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        contacts: &Bound<'py, PyAny>,
        dt_s: f64,
        fingers: Option<Vec<u32>>,
        flat: bool,
    ) -> Result<Bound<'py, PyArray1<f64>>> {
        let shape = "[contact, (x_m, y_m, force_n, radius_m)]";
        let none = contacts.len().is_ok_and(|contacts| contacts == 0);
        let given = if none { None } else { Some(array::<Ix2>("contacts", shape, contacts)?) };
        let rows = given.as_ref().map(|given| given.as_array());
        let count = rows.as_ref().map_or(0, |rows| rows.nrows());
        if rows.as_ref().is_some_and(|rows| rows.ncols() != 4) {
            return Err(PyValueError::new_err(format!("contacts: must be {shape}")).into());
        }
        let fingers = fingers.unwrap_or_else(|| (1..).take(count).collect());
        if fingers.len() != count {
            let problem = format!("fingers: {} for {count} contacts", fingers.len());
            return Err(PyValueError::new_err(problem).into());
        }
        let tip = if flat { Tip::Flat } else { Tip::Round };
        let rows = rows.iter().flat_map(|rows| rows.rows());
        let contacts = rows.zip(fingers).map(|(row, finger)| Contact {
            finger,
            tip,
            position_m: [row[0], row[1]],
            force_n: row[2],
            radius_m: row[3],
        });
        let contacts: Vec<Contact> = contacts.collect();
        let skin = self.skin.get_mut().unwrap_or_else(PoisonError::into_inner);
        let (values_v, exact_v, time_s) = py.detach(|| {
            let frame = skin.step(&contacts, dt_s).map_err(eit_skin::SkinError::from)?;
            Ok::<_, eit_skin::SkinError>((
                frame.values_v.to_vec(),
                frame.exact_v.to_vec(),
                frame.time_s,
            ))
        })?;
        self.time_s = time_s;
        self.exact = Some(exact_v.into_pyarray(py).unbind());
        Ok(values_v.into_pyarray(py))
    }

    /// Time of the last frame since the first, seconds; NaN before the first.
    #[getter]
    fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Exact voltages [measurement] of the last frame, before the instrument, volt; None before the first.
    #[getter]
    fn exact<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.exact.as_ref().map(|exact| exact.bind(py).clone())
    }

    /// Exact voltages [measurement] of the untouched skin, volt.
    #[getter]
    fn reference<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let skin = self.skin.get_mut().unwrap_or_else(PoisonError::into_inner);
        skin.reference_v().to_vec().into_pyarray(py)
    }
}
