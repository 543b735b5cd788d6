//! Difference data: what is subtracted and what it is divided by.

use crate::InverseError;
use crate::check::check_length;

/// How a frame `v` and a reference frame `v_ref` become difference data `dv`.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum DifferenceData {
    /// `dv = v - v_ref`, volts. The Jacobian is used as it is.
    #[default]
    Plain,
    /// `dv_i = (v_i - v_ref_i) / v_ref_i`, dimensionless, with the Jacobian's row `i` divided by
    /// the model's own voltage `v0_i` of the background.
    ///
    /// A gain that differs from channel to channel cancels, and so does the sign of instruments
    /// that report amplitudes only. It also lifts small voltages (far from the drive) to the
    /// weight of large ones, so noise that is equal in volts grows there: see
    /// [`DifferenceSettings::noise_std`](crate::DifferenceSettings::noise_std).
    Normalised {
        /// Voltages of the background conductivity the Jacobian was taken at, volts,
        /// `[measurement]`.
        model_voltages_v: Vec<f64>,
    },
}

impl DifferenceData {
    /// Standard deviations of the differences from those in volts, both `[measurement]`: `e_i`
    /// (plain) or `e_i / |v0_i|` (normalised), as
    /// [`DifferenceSettings::noise_std`](crate::DifferenceSettings::noise_std) takes them.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`] where there are not as many model voltages.
    pub fn noise_std(&self, noise_std_v: &[f64]) -> Result<Vec<f64>, InverseError> {
        match self {
            Self::Plain => Ok(noise_std_v.to_vec()),
            Self::Normalised { model_voltages_v } => {
                check_length("noise_std_v", noise_std_v.len(), model_voltages_v.len())?;
                Ok(noise_std_v.iter().zip(model_voltages_v).map(|(e, v)| e / v.abs()).collect())
            }
        }
    }
}

/// Whether there was anything to compute for a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum FrameStatus {
    /// The frame differs from its reference: its image was computed.
    Computed,
    /// Every measurement that counts equals its reference, bit for bit: the image of a linear map is
    /// zero then, exactly, and was written without computing it. A tracker can be told so
    /// ([`TouchStream::push_unchanged`](crate::touch::TouchStream::push_unchanged)).
    Unchanged,
}
