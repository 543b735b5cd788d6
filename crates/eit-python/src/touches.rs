//! Touches as structured arrays.

use eit_skin::Touch;
use eit_skin::eit_fem::fabric::TrueTouch;
use eit_skin::live::{SkinState, TouchFields};
use numpy::IntoPyArray;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

/// The columns of `touches.csv`. Numbers that are not known are NaN, ids -1.
const COLUMNS: [(&str, &str); 28] = [
    ("frame", "i8"),
    ("time_s", "f8"),
    ("id", "i8"),
    ("state", "U5"),
    ("x_m", "f8"),
    ("y_m", "f8"),
    ("z_m", "f8"),
    ("std_x_m", "f8"),
    ("std_y_m", "f8"),
    ("std_z_m", "f8"),
    ("nx", "f8"),
    ("ny", "f8"),
    ("nz", "f8"),
    ("vx_m_s", "f8"),
    ("vy_m_s", "f8"),
    ("vz_m_s", "f8"),
    ("intensity_s_m2", "f8"),
    ("intensity_std_s_m2", "f8"),
    ("confidence", "f8"),
    ("valid", "?"),
    ("whole", "?"),
    ("age_s", "f8"),
    ("force_n", "f8"),
    ("force_std_n", "f8"),
    ("unlike", "?"),
    ("split_from", "i8"),
    ("merged_into", "i8"),
    ("skin", "U13"),
];

/// The columns of the `touches.csv` of a simulation.
const TRUE_COLUMNS: [(&str, &str); 10] = [
    ("frame", "i8"),
    ("time_s", "f8"),
    ("finger", "i8"),
    ("x_m", "f8"),
    ("y_m", "f8"),
    ("force_n", "f8"),
    ("tip_radius_m", "f8"),
    ("contact_radius_m", "f8"),
    ("area_m2", "f8"),
    ("depth_m", "f8"),
];

static DTYPE: PyOnceLock<Py<PyAny>> = PyOnceLock::new();

/// The type of touches.
pub(crate) fn dtype(py: Python<'_>) -> PyResult<&Bound<'_, PyAny>> {
    let made = DTYPE.get_or_try_init(py, || Ok::<_, PyErr>(dtype_of(py, &COLUMNS)?.unbind()))?;
    Ok(made.bind(py))
}

fn dtype_of<'py>(py: Python<'py>, columns: &[(&str, &str)]) -> PyResult<Bound<'py, PyAny>> {
    py.import("numpy")?.call_method1("dtype", (columns.to_vec(),))
}

/// Rows of a structured array, byte by byte: NumPy then reads them in place.
#[derive(Default)]
pub(crate) struct Rows(Vec<u8>);

impl Rows {
    pub(crate) fn touch(&mut self, frame: u64, time_s: f64, touch: &Touch, skin: SkinState) {
        let touch = TouchFields::from(touch);
        self.int(frame as i64).real(time_s).int(touch.id as i64).text::<5>(touch.state);
        self.reals(touch.position_m).reals(touch.position_std_m);
        self.reals(touch.normal.unwrap_or([f64::NAN; 3])).reals(touch.velocity_m_s);
        self.real(touch.intensity_s_m2).known(touch.intensity_std_s_m2).real(touch.confidence);
        self.flag(touch.valid).flag(touch.whole).real(touch.age_s);
        self.known(touch.force_n).known(touch.force_std_n).flag(touch.unlike == Some(true));
        self.id(touch.split_from).id(touch.merged_into).text::<13>(skin.name());
    }

    pub(crate) fn true_touch(&mut self, time_s: f64, touch: &TrueTouch) {
        self.int(touch.frame as i64).real(time_s).int(i64::from(touch.finger));
        self.reals(touch.position_m).real(touch.force_n).real(touch.tip_radius_m);
        self.real(touch.contact_radius_m).real(touch.area_m2).real(touch.depth_m);
    }

    /// Moves the rows of touches into an array.
    pub(crate) fn into_touches(self, py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
        self.0.into_pyarray(py).call_method1("view", (dtype(py)?,))
    }

    /// Moves the rows of true touches into an array.
    pub(crate) fn into_true_touches(self, py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
        self.0.into_pyarray(py).call_method1("view", (dtype_of(py, &TRUE_COLUMNS)?,))
    }

    fn int(&mut self, value: i64) -> &mut Self {
        self.0.extend(value.to_ne_bytes());
        self
    }

    fn id(&mut self, id: Option<u64>) -> &mut Self {
        self.int(id.map_or(-1, |id| id as i64))
    }

    fn real(&mut self, value: f64) -> &mut Self {
        self.0.extend(value.to_ne_bytes());
        self
    }

    fn known(&mut self, value: Option<f64>) -> &mut Self {
        self.real(value.unwrap_or(f64::NAN))
    }

    fn reals<const N: usize>(&mut self, values: [f64; N]) -> &mut Self {
        values.into_iter().fold(self, Self::real)
    }

    fn flag(&mut self, value: bool) -> &mut Self {
        self.0.push(u8::from(value));
        self
    }

    /// Text of at most N characters, four bytes each.
    fn text<const N: usize>(&mut self, text: &str) -> &mut Self {
        let letters = text.chars().map(u32::from).chain(std::iter::repeat(0));
        self.0.extend(letters.take(N).flat_map(u32::to_ne_bytes));
        self
    }
}
