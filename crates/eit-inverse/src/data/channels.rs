//! Used measurements and their weights.

use super::{DifferenceData, DifferenceKind, FrameStatus};
use crate::InverseError;
use crate::check::check_length;

/// Least noise standard deviation relative to the largest: smaller ones are rejected, since their squared
/// weights would push all other measurements below the rounding of `J P J'`.
const NOISE_RANGE: f64 = 1e-7;

/// The used measurements of a protocol and their weights.
#[derive(Debug, Clone)]
pub(crate) struct Channels {
    /// Number of measurements of the protocol.
    pub(crate) count: usize,
    /// Protocol index of each used measurement, ascending.
    pub(crate) used: Vec<usize>,
    /// `noise_scale / noise_std` of each used measurement: the diagonal of `W^1/2`.
    pub(crate) root_weights: Vec<f64>,
    /// The `noise_std` of weight 1, in the unit of `dv`; `None` if no noise was given.
    pub(crate) noise_scale: Option<f64>,
    /// Whether differences are divided by the reference.
    kind: DifferenceKind,
    /// Divisor of each used measurement's row of the Jacobian.
    divisors: Vec<f64>,
}

impl Channels {
    /// Selects and weights the rows of a Jacobian of `count` rows; `noise_std` and `used` are
    /// `[measurement]`.
    pub(crate) fn new(
        count: usize,
        data: &DifferenceData,
        noise_std: Option<&[f64]>,
        used: Option<&[bool]>,
    ) -> Result<Self, InverseError> {
        let used = used_indices(count, used)?;
        let (root_weights, noise_scale) = match noise_std {
            None => (vec![1.0; used.len()], None),
            Some(noise_std) => {
                let (root_weights, largest) = root_weights(count, &used, noise_std)?;
                (root_weights, Some(largest))
            }
        };
        let divisors = data.divisors(count, &used)?;
        Ok(Self { count, used, root_weights, noise_scale, kind: data.kind(), divisors })
    }

    /// Factor of a used measurement's Jacobian row: `W^1/2`, and `1 / v0` for normalised data.
    pub(crate) fn row_factor(&self, k: usize) -> f64 {
        self.root_weights[k] / self.divisors[k]
    }

    /// Restricts the measurements to those that `used` also selects.
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
            noise_scale: self.noise_scale,
            kind: self.kind,
            divisors: pick(&self.divisors),
        };
        Ok((channels, kept))
    }

    /// Writes the unweighted difference data of the used measurements into `difference` `[used]` and
    /// returns whether any of it is not zero.
    ///
    /// The indices into `used` that `masked` lists in ascending order become zero, and their values are not
    /// read.
    pub(crate) fn difference_into(
        &self,
        frame_index: usize,
        frame: &[f64],
        reference_frame: &[f64],
        masked: &[usize],
        difference: &mut [f64],
    ) -> Result<FrameStatus, InverseError> {
        check_length("frame", frame.len(), self.count)?;
        check_length("reference frame", reference_frame.len(), self.count)?;
        let normalised = self.kind == DifferenceKind::Normalised;
        // usually ends at the first measurement
        let mut used = self.used.iter().map(|&i| (frame[i], reference_frame[i]));
        if masked.is_empty()
            && used.all(|(v, r)| v == r && v.is_finite() && !(normalised && v == 0.0))
        {
            difference.fill(0.0);
            return Ok(FrameStatus::Unchanged);
        }
        let mut masked = masked.iter().peekable();
        let mut changed = false;
        for (k, (dv, &measurement)) in difference.iter_mut().zip(&self.used).enumerate() {
            if masked.next_if_eq(&&k).is_some() {
                *dv = 0.0;
                continue;
            }
            let (value, reference) = (frame[measurement], reference_frame[measurement]);
            if !value.is_finite() {
                return Err(InverseError::NonFiniteData { frame: frame_index, measurement, value });
            }
            if !reference.is_finite() {
                let value = reference;
                return Err(InverseError::NonFiniteReference { measurement, value });
            }
            *dv = self.kind.difference(value, reference);
            if !dv.is_finite() && normalised {
                let (what, value) = ("the reference frame", reference);
                return Err(InverseError::ZeroReference { what, measurement, value });
            }
            if !dv.is_finite() {
                // two finite values of 1e308 and opposite sign
                let (frame, value) = (frame_index, *dv);
                return Err(InverseError::NonFiniteData { frame, measurement, value });
            }
            changed |= *dv != 0.0;
        }
        Ok(if changed { FrameStatus::Computed } else { FrameStatus::Unchanged })
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

/// Returns the weights relative to that of the largest `noise_std`, and that largest value.
fn root_weights(
    count: usize,
    used: &[usize],
    noise_std: &[f64],
) -> Result<(Vec<f64>, f64), InverseError> {
    check_length("noise_std", noise_std.len(), count)?;
    let finite = used.iter().map(|&i| noise_std[i]).filter(|e| e.is_finite());
    let largest = finite.fold(0.0, f64::max);
    let weights: Result<Vec<f64>, InverseError> = used
        .iter()
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
            // relative to the largest, so that no unit overflows; only ratios matter
            if usable { Ok(largest / value) } else { Err(error) }
        })
        .collect();
    Ok((weights?, largest))
}
