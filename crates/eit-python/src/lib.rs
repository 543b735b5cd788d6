//! Electrical impedance tomography for robot skin, from Python: bindings over `eit-skin`, without logic of their own.
//! `python/eit/__init__.pyi` documents the classes.

mod error;
mod frames;
mod learn;
mod recording;
mod sensor;
mod simulation;
mod simulator;
mod skin;
mod touches;

use pyo3::prelude::*;

/// The module `eit._eit`, whose items `eit` re-exports.
#[pymodule]
fn _eit(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("EitError", py.get_type::<error::EitError>())?;
    module.add("touch_dtype", touches::dtype(py)?)?;
    module.add_class::<skin::Skin>()?;
    module.add_class::<sensor::Sensor>()?;
    module.add_class::<sensor::TouchFrame>()?;
    module.add_class::<recording::Recording>()?;
    module.add_class::<simulation::Simulation>()?;
    module.add_class::<simulator::Simulator>()?;
    module.add_class::<learn::LearnedSkin>()
}
