//! Settings and status of a calibration.

use crate::InverseError;
use crate::check::{check_length, check_positive};
use eit_fem::ForwardModel;

/// Which contact impedances are fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Contacts {
    /// One of each electrode.
    #[default]
    Each,
    /// One factor of all, their ratios as at the start.
    Common,
}

/// Why a calibration stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum CalibrationStatus {
    /// A further step would be below a thousandth of the standard deviations.
    Converged,
    /// Steps ran out.
    IterationCap,
    /// No step, however damped, improved the fit any more.
    Stalled,
}

/// Settings of [`Calibration`](crate::Calibration).
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationSettings {
    /// Conductivity to start from, siemens (per square); its size matters little.
    pub conductivity_s: f64,
    /// Contact impedance of each electrode to start from, and the middle of its prior.
    pub contact_impedance: Vec<f64>,
    /// Which contact impedances are fitted.
    pub contacts: Contacts,
    /// Standard deviation of `ln z` before the data. Default `ln 10`: the impedance is known to
    /// about a factor of ten.
    pub contact_spread: f64,
    /// Standard deviation of the noise of each measurement, volts; `None` (default): equal in all
    /// and unknown.
    pub noise_std_v: Option<Vec<f64>>,
    /// Which measurements to use; `None` (default): all. Values that are not used may be NaN.
    pub used: Option<Vec<bool>>,
    /// Steps at most. Default 50.
    pub max_iterations: usize,
}

impl CalibrationSettings {
    /// The defaults, from a start.
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

    /// Refuses numbers out of range.
    pub(super) fn validate(&self, model: &ForwardModel) -> Result<(), InverseError> {
        check_positive("conductivity_s", self.conductivity_s)?;
        check_positive("contact_spread", self.contact_spread)?;
        let electrodes = model.protocol().electrodes();
        check_length("contact_impedance", self.contact_impedance.len(), electrodes)?;
        for z in &self.contact_impedance {
            // a shunt has no logarithm
            check_positive("contact_impedance to start from", *z)?;
        }
        if self.max_iterations == 0 {
            let (quantity, value, must) = ("max_iterations", 0.0, "1 or more");
            return Err(InverseError::OutOfRange { quantity, value, must });
        }
        Ok(())
    }
}
