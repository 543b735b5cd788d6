//! Settings and status of a calibration.

use crate::InverseError;
use crate::check::{check_length, check_positive, check_range};
use eit_fem::ForwardModel;

/// Which contact impedances are fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Contacts {
    /// Contact impedance of each electrode.
    #[default]
    Each,
    /// One common factor; the ratios stay as at the start.
    Common,
}

/// Why a calibration stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum CalibrationStatus {
    /// A further step would be below a thousandth of the standard deviations.
    Converged,
    /// The step limit was reached.
    IterationCap,
    /// No step, however damped, improved the fit further.
    Stalled,
}

/// Settings of [`Calibration`](crate::Calibration).
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct CalibrationSettings {
    /// Starting value of the conductivity, siemens (per square); its size matters little.
    pub conductivity_s: f64,
    /// Starting value of each electrode's contact impedance, and the mean of its prior: ohm metre (rim),
    /// ohm square metre (patch).
    pub contact_impedance: Vec<f64>,
    /// Which contact impedances are fitted.
    pub contacts: Contacts,
    /// Prior standard deviation of `ln z`. Default `ln 10`: the impedance is known to about a factor of ten.
    pub contact_spread: f64,
    /// Standard deviation of the noise of each measurement, volts; `None` (default): equal in all
    /// measurements and unknown.
    pub noise_std_v: Option<Vec<f64>>,
    /// Which measurements are used; `None` (default): all. Unused values may be NaN.
    pub used: Option<Vec<bool>>,
    /// Most steps. Default 50.
    pub max_iterations: usize,
}

impl CalibrationSettings {
    /// Returns the defaults with the given starting values.
    pub fn starting_at(conductivity_s: f64, contact_impedance: &[f64]) -> Self {
        Self {
            conductivity_s,
            contact_impedance: contact_impedance.to_vec(),
            contacts: Contacts::Each,
            contact_spread: std::f64::consts::LN_10,
            noise_std_v: None,
            used: None,
            max_iterations: 50,
        }
    }

    /// Rejects invalid settings.
    pub(super) fn validate(&self, model: &ForwardModel) -> Result<(), InverseError> {
        check_positive("conductivity_s", self.conductivity_s)?;
        check_positive("contact_spread", self.contact_spread)?;
        let electrodes = model.protocol().electrodes();
        check_length("contact_impedance", self.contact_impedance.len(), electrodes)?;
        for z in &self.contact_impedance {
            // zero impedance has no logarithm
            check_positive("starting contact_impedance", *z)?;
        }
        check_range("max_iterations", 0.0, self.max_iterations > 0, "at least 1")
    }
}
