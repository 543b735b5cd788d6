//! Singular value decomposition of the whitened Jacobian.

use crate::InverseError;
use faer::Mat;
use ndarray::ArrayRef2;

/// Truncated singular value decomposition of the whitened Jacobian, `W^1/2 J = U S V'`.
#[derive(Debug, Clone)]
pub(crate) struct Compression {
    /// Number of measurements of the protocol.
    pub(crate) measurements: usize,
    /// `W^1/2` of each measurement; 0 if it is unused.
    pub(crate) root_weights: Vec<f64>,
    /// `U` `[measurement, rank]`.
    pub(crate) left: Mat<f64>,
    /// `S`, descending.
    pub(crate) singular: Vec<f64>,
    /// `V` `[unknown, rank]`.
    pub(crate) basis: Mat<f64>,
}

impl Compression {
    /// Decomposes a Jacobian `[measurement, unknown]` with given row weights.
    pub(crate) fn new(
        jacobian: &ArrayRef2<f64>,
        root_weights: Vec<f64>,
    ) -> Result<Self, InverseError> {
        let (measurements, unknowns) = jacobian.dim();
        if measurements == 0 || unknowns == 0 {
            return Err(InverseError::EmptyJacobian { measurements, elements: unknowns });
        }
        let mut largest = 0.0_f64;
        for ((measurement, element), &value) in jacobian.indexed_iter() {
            if root_weights[measurement] == 0.0 {
                continue;
            }
            if !value.is_finite() {
                return Err(InverseError::NonFiniteJacobian { measurement, element, value });
            }
            largest = largest.max((root_weights[measurement] * value).abs());
        }
        if !(largest > 0.0 && largest.is_finite()) {
            return Err(InverseError::NoSensitivity { measurements });
        }
        // scale to 1 first, because squares of 1e-200 would underflow
        let transposed = Mat::from_fn(unknowns, measurements, |p, i| match root_weights[i] {
            0.0 => 0.0,
            w => w * jacobian[(i, p)] / largest,
        });
        let svd = transposed.thin_svd().map_err(|_| InverseError::Factorisation {
            what: "singular values of the Jacobian",
            size: measurements,
        })?;
        let singular = svd.S().column_vector();
        let floor = unknowns.max(measurements) as f64 * f64::EPSILON * singular[0];
        let kept = singular.iter().take_while(|s| **s > floor).count();
        Ok(Self {
            measurements,
            root_weights,
            left: svd.V().get(.., ..kept).to_owned(),
            singular: (0..kept).map(|k| largest * singular[k]).collect(),
            basis: svd.U().get(.., ..kept).to_owned(),
        })
    }

    pub(crate) fn rank(&self) -> usize {
        self.singular.len()
    }
}
