//! Difference data: what is subtracted and what it is divided by.

use crate::InverseError;
use crate::check::check_length;
use ndarray::ArrayRef2;

/// Whether differences are divided by the reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum DifferenceKind {
    /// `dv = v - v_ref`, volts.
    #[default]
    Plain,
    /// `dv = (v - v_ref) / v_ref`, dimensionless.
    Normalised,
}

impl DifferenceKind {
    /// The difference of one measurement: `v - v_ref`, or `(v - v_ref) / v_ref`.
    #[inline]
    pub fn difference(self, value_v: f64, reference_v: f64) -> f64 {
        match self {
            Self::Plain => value_v - reference_v,
            Self::Normalised => (value_v - reference_v) / reference_v,
        }
    }

    /// [`difference`](Self::difference) of every measurement of a frame for which `counts` holds,
    /// into `difference`; the others get `missing` (0, or NaN for a method that is told which they
    /// are), and nothing of them is looked at. All are `[measurement]`. Allocates nothing.
    ///
    /// Nothing is said of values that are not finite, and of references that are zero: what takes
    /// difference data refuses them.
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

/// How a frame `v` and a reference frame `v_ref` become difference data `dv`, and what that does to
/// the Jacobian.
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
    /// [`OneStepSettings::noise_std`](crate::OneStepSettings::noise_std).
    Normalised {
        /// Voltages of the background conductivity the Jacobian was taken at, volts,
        /// `[measurement]`.
        model_voltages_v: Vec<f64>,
    },
}

impl DifferenceData {
    /// Whether differences are divided by the reference.
    pub fn kind(&self) -> DifferenceKind {
        match self {
            Self::Plain => DifferenceKind::Plain,
            Self::Normalised { .. } => DifferenceKind::Normalised,
        }
    }

    /// Standard deviations of the differences from those in volts, both `[measurement]`: `e_i`
    /// (plain) or `e_i / |v0_i|` (normalised), as
    /// [`OneStepSettings::noise_std`](crate::OneStepSettings::noise_std) takes them.
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

    /// Turns the rows of a Jacobian of the measurements `[measurement, unknown]`, volts for each unit
    /// of an unknown, into those of the differences: `J_ij` (plain) or `J_ij / v0_i` (normalised).
    /// Unknowns are what they may: elements, pixels, displacements. Rows of measurements that are
    /// not used become zero; they and their voltages are not looked at.
    ///
    /// For methods that take difference data and the Jacobian of it, such as total variation;
    /// [`OneStepGaussNewton`](crate::OneStepGaussNewton) does this itself.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`]; [`InverseError::ZeroReference`] for a used measurement whose
    /// model voltage cannot be divided by.
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

    /// What each used measurement's row of the Jacobian is divided by: 1 for plain data.
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
