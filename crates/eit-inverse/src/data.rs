//! Difference data: what is subtracted, what it is divided by, which measurements count and how
//! much.

use crate::InverseError;

/// Noise standard deviations below the largest one times this are refused: their squared weights
/// would push every other measurement below the rounding of `J P J'`.
const NOISE_RANGE: f64 = 1e-7;

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
    /// [`DifferenceSettings::noise_std`].
    Normalised {
        /// Voltages of the background conductivity the Jacobian was taken at, volts,
        /// `[measurement]`.
        model_voltages_v: Vec<f64>,
    },
}

/// Settings of [`Difference`](crate::Difference).
#[derive(Debug, Clone, PartialEq)]
pub struct DifferenceSettings {
    /// Hyperparameter lambda, dimensionless, entering as `lambda^2` (see
    /// [`Difference`](crate::Difference)). Default 0.03.
    pub hyperparameter: f64,
    /// Plain (default) or normalised difference.
    pub data: DifferenceData,
    /// Standard deviation of the noise of each difference `dv_i`, `[measurement]`, in the unit of
    /// `dv`: volts (plain) or dimensionless (normalised; noise of `e` volts in a channel is
    /// `e / |v_ref_i|`). `None`: equal in all. Only ratios matter, because the scale `s` contains
    /// the weights. The noise covariance `W^-1` is the diagonal of the squares.
    pub noise_std: Option<Vec<f64>>,
    /// Which measurements to use, `[measurement]`; `None`: all. An unused one is left out, not
    /// filled in: its row is removed from the problem, and its values in frames, reference,
    /// `noise_std` and `model_voltages_v` are never looked at (they may be NaN).
    pub used: Option<Vec<bool>>,
}

impl Default for DifferenceSettings {
    fn default() -> Self {
        Self { hyperparameter: 0.03, data: DifferenceData::Plain, noise_std: None, used: None }
    }
}

/// The used measurements of a protocol and their weights.
#[derive(Debug, Clone)]
pub(crate) struct Channels {
    /// Measurements of the protocol.
    pub(crate) count: usize,
    /// Protocol index of each used measurement, ascending.
    pub(crate) used: Vec<usize>,
    /// `1 / noise_std` of each used measurement: the diagonal of `W^1/2`.
    pub(crate) root_weights: Vec<f64>,
    /// Model voltage of each used measurement; empty for plain data.
    pub(crate) model_voltages_v: Vec<f64>,
}

impl Channels {
    /// Checks the settings against a Jacobian of `count` rows.
    pub(crate) fn new(count: usize, settings: &DifferenceSettings) -> Result<Self, InverseError> {
        let used = used_indices(count, settings.used.as_deref())?;
        let root_weights = match &settings.noise_std {
            None => vec![1.0; used.len()],
            Some(noise_std) => root_weights(count, &used, noise_std)?,
        };
        let model_voltages_v = match &settings.data {
            DifferenceData::Plain => Vec::new(),
            DifferenceData::Normalised { model_voltages_v } => {
                check_length("model_voltages_v", model_voltages_v.len(), count)?;
                let picked: Vec<f64> = used.iter().map(|&i| model_voltages_v[i]).collect();
                if let Some(k) = picked.iter().position(|v| !v.recip().is_finite() || *v == 0.0) {
                    let (measurement, value) = (used[k], picked[k]);
                    let what = "the model voltages";
                    return Err(InverseError::ZeroReference { what, measurement, value });
                }
                picked
            }
        };
        Ok(Self { count, used, root_weights, model_voltages_v })
    }

    /// Whether data is divided by the reference.
    pub(crate) fn normalised(&self) -> bool {
        !self.model_voltages_v.is_empty()
    }

    /// Factor of a used measurement's Jacobian row: `W^1/2`, and `1 / v0` for normalised data.
    pub(crate) fn row_factor(&self, k: usize) -> f64 {
        match self.model_voltages_v.get(k) {
            None => self.root_weights[k],
            Some(v0) => self.root_weights[k] / v0,
        }
    }

    /// Keeps the measurements that `used` also names.
    pub(crate) fn restrict(&self, used: &[bool]) -> Result<(Self, Vec<usize>), InverseError> {
        check_length("used", used.len(), self.count)?;
        let wanted = used_indices(self.count, Some(used))?;
        let mut kept = Vec::with_capacity(wanted.len());
        for measurement in wanted {
            let k = self.used.binary_search(&measurement);
            kept.push(k.map_err(|_| InverseError::NotAvailable { measurement })?);
        }
        let pick = |values: &[f64]| kept.iter().filter_map(|&k| values.get(k).copied()).collect();
        let channels = Self {
            count: self.count,
            used: kept.iter().map(|&k| self.used[k]).collect(),
            root_weights: pick(&self.root_weights),
            model_voltages_v: pick(&self.model_voltages_v),
        };
        Ok((channels, kept))
    }

    /// Difference data of the used measurements, not weighted, into `difference` `[used]`.
    pub(crate) fn difference_into(
        &self,
        frame_index: usize,
        frame: &[f64],
        reference_frame: &[f64],
        difference: &mut [f64],
    ) -> Result<(), InverseError> {
        check_length("frame", frame.len(), self.count)?;
        check_length("reference frame", reference_frame.len(), self.count)?;
        let normalised = self.normalised();
        for (dv, &measurement) in difference.iter_mut().zip(&self.used) {
            let (value, reference) = (frame[measurement], reference_frame[measurement]);
            if !value.is_finite() {
                return Err(InverseError::NonFiniteData { frame: frame_index, measurement, value });
            }
            if !reference.is_finite() {
                let value = reference;
                return Err(InverseError::NonFiniteReference { measurement, value });
            }
            *dv = value - reference;
            if normalised {
                *dv /= reference;
                if !dv.is_finite() {
                    let (what, value) = ("the reference frame", reference);
                    return Err(InverseError::ZeroReference { what, measurement, value });
                }
            }
        }
        Ok(())
    }
}

/// Refuses a wrong length, naming both counts.
pub(crate) fn check_length(
    what: &'static str,
    found: usize,
    wanted: usize,
) -> Result<(), InverseError> {
    if found == wanted { Ok(()) } else { Err(InverseError::WrongLength { what, found, wanted }) }
}

/// Refuses anything but a finite number above zero.
pub(crate) fn check_positive(quantity: &'static str, value: f64) -> Result<(), InverseError> {
    if value > 0.0 && value.is_finite() {
        Ok(())
    } else {
        Err(InverseError::OutOfRange { quantity, value, must: "finite and above zero" })
    }
}

fn used_indices(count: usize, used: Option<&[bool]>) -> Result<Vec<usize>, InverseError> {
    let indices: Vec<usize> = match used {
        None => (0..count).collect(),
        Some(used) => {
            check_length("used", used.len(), count)?;
            (0..count).filter(|&i| used[i]).collect()
        }
    };
    if indices.is_empty() {
        return Err(InverseError::NothingUsed { measurements: count });
    }
    Ok(indices)
}

fn root_weights(count: usize, used: &[usize], noise_std: &[f64]) -> Result<Vec<f64>, InverseError> {
    check_length("noise_std", noise_std.len(), count)?;
    let largest = used.iter().map(|&i| noise_std[i]).fold(0.0, f64::max);
    used.iter()
        .map(|&measurement| {
            let value = noise_std[measurement];
            let must = "finite, above zero and at least 1e-7 of the largest";
            let usable = value > 0.0 && value.is_finite() && value >= NOISE_RANGE * largest;
            let error = InverseError::MeasurementOutOfRange {
                quantity: "noise_std",
                measurement,
                value,
                must,
            };
            // relative to the largest, so that no unit can overflow; only ratios matter
            if usable { Ok(largest / value) } else { Err(error) }
        })
        .collect()
}
