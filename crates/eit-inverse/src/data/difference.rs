//! Difference data: frames minus a reference, plain or normalised.

use crate::InverseError;
use crate::check::check_length;
use ndarray::ArrayRef2;

/// Whether differences are divided by the reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
pub enum DifferenceKind {
    /// `dv = v - v_ref`, volts.
    #[default]
    Plain,
    /// `dv = (v - v_ref) / v_ref`, dimensionless.
    Normalised,
}

impl DifferenceKind {
    /// Returns the difference of one measurement: `v - v_ref`, or `(v - v_ref) / v_ref`.
    #[inline]
    pub fn difference(self, value_v: f64, reference_v: f64) -> f64 {
        match self {
            Self::Plain => value_v - reference_v,
            Self::Normalised => (value_v - reference_v) / reference_v,
        }
    }

    /// Writes the [`difference`](Self::difference) of every measurement for which `counts` is true into
    /// `difference`.
    ///
    /// The other measurements become `missing` (0, or NaN for a method that is told which they are) and are
    /// not read. All arrays are `[measurement]`. Does not allocate, and does not check for non-finite
    /// values or references of zero; methods that take difference data reject those.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`].
    ///
    /// # Example
    /// ```
    /// use eit_inverse::DifferenceKind;
    ///
    /// let (frame, reference_frame) = ([1.5, f64::NAN, 2.0], [1.0, 1.0, 4.0]);
    /// let mut difference = [0.0; 3];
    /// let kind = DifferenceKind::Normalised;
    /// kind.difference_into(&frame, &reference_frame, |i| i != 1, 0.0, &mut difference)?;
    /// assert_eq!(difference, [0.5, 0.0, -0.5]);
    /// # Ok::<(), eit_inverse::InverseError>(())
    /// ```
    pub fn difference_into(
        self,
        frame: &[f64],
        reference_frame: &[f64],
        counts: impl Fn(usize) -> bool,
        missing: f64,
        difference: &mut [f64],
    ) -> Result<(), InverseError> {
        check_length("reference frame", reference_frame.len(), frame.len())?;
        check_length("difference", difference.len(), frame.len())?;
        let values = frame.iter().zip(reference_frame);
        for (i, (dv, (value, reference))) in difference.iter_mut().zip(values).enumerate() {
            *dv = if counts(i) { self.difference(*value, *reference) } else { missing };
        }
        Ok(())
    }
}

/// How a frame `v` and a reference frame `v_ref` become difference data `dv`, and how the Jacobian changes
/// with it.
///
/// ```
/// use eit_inverse::{DifferenceData, DifferenceKind};
///
/// let data = DifferenceData::Normalised { model_voltages_v: vec![2.0, -4.0] };
/// assert_eq!(data.kind(), DifferenceKind::Normalised);
/// assert_eq!(data.kind().difference(2.2, 2.0), 0.10000000000000009);
/// // noise in volts becomes noise of the relative difference
/// assert_eq!(data.noise_std(&[0.1, 0.1])?, [0.05, 0.025]);
/// # Ok::<(), eit_inverse::InverseError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum DifferenceData {
    /// `dv = v - v_ref`, volts. The Jacobian is unchanged.
    #[default]
    Plain,
    /// `dv_i = (v_i - v_ref_i) / v_ref_i`, dimensionless, with row `i` of the Jacobian divided by the
    /// model's own background voltage `v0_i`.
    ///
    /// Gains of single channels cancel, and so does the sign for instruments that report magnitudes only.
    /// Small voltages (far from the drive) get the same weight as large ones, so noise that is equal in
    /// volts grows there: see [`OneStepSettings::noise_std`](crate::OneStepSettings::noise_std).
    Normalised {
        /// Voltages of the background conductivity at which the Jacobian was computed, volts,
        /// `[measurement]`.
        model_voltages_v: Vec<f64>,
    },
}

impl DifferenceData {
    /// Returns whether differences are divided by the reference.
    pub fn kind(&self) -> DifferenceKind {
        match self {
            Self::Plain => DifferenceKind::Plain,
            Self::Normalised { .. } => DifferenceKind::Normalised,
        }
    }

    /// Converts standard deviations in volts to those of the differences, both `[measurement]`: `e_i`
    /// (plain) or `e_i / |v0_i|` (normalised), as used for
    /// [`OneStepSettings::noise_std`](crate::OneStepSettings::noise_std).
    ///
    /// # Errors
    /// [`InverseError::WrongLength`] if the number of model voltages differs.
    pub fn noise_std(&self, noise_std_v: &[f64]) -> Result<Vec<f64>, InverseError> {
        match self {
            Self::Plain => Ok(noise_std_v.to_vec()),
            Self::Normalised { model_voltages_v } => {
                check_length("noise_std_v", noise_std_v.len(), model_voltages_v.len())?;
                Ok(noise_std_v.iter().zip(model_voltages_v).map(|(e, v)| e / v.abs()).collect())
            }
        }
    }

    /// Converts a Jacobian of the measurements `[measurement, unknown]`, volts per unit of an unknown, to
    /// one of the differences: `J_ij` (plain) or `J_ij / v0_i` (normalised).
    ///
    /// The unknowns may be anything: elements, pixels, displacements. Rows of unused measurements become
    /// zero; they and their voltages are not read.
    ///
    /// This is for methods that take difference data and their Jacobian, such as total variation;
    /// [`OneStepGaussNewton`](crate::OneStepGaussNewton) does it itself.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`]; [`InverseError::ZeroReference`] if the model voltage of a used
    /// measurement cannot be divided by.
    pub fn apply_to_rows(
        &self,
        jacobian: &mut ArrayRef2<f64>,
        used: Option<&[bool]>,
    ) -> Result<(), InverseError> {
        let measurements = jacobian.nrows();
        check_length("used", used.map_or(measurements, <[bool]>::len), measurements)?;
        let is_used = |i: usize| used.is_none_or(|used| used[i]);
        let indices: Vec<usize> = (0..measurements).filter(|&i| is_used(i)).collect();
        let divisors = self.divisors(measurements, &indices)?;
        for i in (0..measurements).filter(|&i| !is_used(i)) {
            jacobian.row_mut(i).fill(0.0);
        }
        for (i, divisor) in indices.into_iter().zip(divisors) {
            jacobian.row_mut(i).mapv_inplace(|j| j / divisor);
        }
        Ok(())
    }

    /// Returns the divisor of each used measurement's row of the Jacobian: 1 for plain data.
    pub(crate) fn divisors(
        &self,
        measurements: usize,
        used: &[usize],
    ) -> Result<Vec<f64>, InverseError> {
        let Self::Normalised { model_voltages_v } = self else { return Ok(vec![1.0; used.len()]) };
        check_length("model_voltages_v", model_voltages_v.len(), measurements)?;
        let divisor = |&measurement: &usize| {
            let value = model_voltages_v[measurement];
            let what = "the model voltages";
            let fine = value.is_finite() && value.recip().is_finite();
            fine.then_some(value).ok_or(InverseError::ZeroReference { what, measurement, value })
        };
        used.iter().map(divisor).collect()
    }
}

/// Whether a frame needed computation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum FrameStatus {
    /// The frame differs from its reference; its image was computed.
    Computed,
    /// Every used measurement equals its reference bit for bit. The image of a linear map is then exactly
    /// zero and was written without computing it.
    Unchanged,
}
