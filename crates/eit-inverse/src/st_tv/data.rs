//! The data of a movie, compressed: measurements to coefficients in the space that the Jacobian
//! can see.
//!
//! With `W^1/2 J = U S V'` (singular values `S` above the rounding floor only), a frame is
//!
//! ```text
//! |W^1/2 (J x - dv)|^2 = |S V' x - U' W^1/2 dv|^2 + rest^2
//! ```
//!
//! exactly: reciprocal measurements fall into one coefficient with the weight of both, duplicate
//! and zero rows cost nothing, and the iteration sees `rank` numbers a frame instead of all
//! measurements. A frame with masked channels keeps the basis `V`: its Gram matrix
//! `S U_t' U_t S = Q diag(s^2) Q'` of the rows left is `rank x rank`, and one set of masked
//! channels is expanded once, however many frames share it.

mod mode;
mod target;

use crate::check::check_length;
use crate::{Differences, InverseError};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::svd::{ComputeSvdVectors, svd, svd_scratch};
use faer::{Col, Mat, Par, Spec};
pub(crate) use mode::{Mode, ModeScratch};
use ndarray::ArrayRef2;
pub(crate) use target::Target;

/// The whitened Jacobian's singular expansion.
#[derive(Debug, Clone)]
pub(crate) struct Compression {
    /// Measurements of the protocol.
    pub(crate) measurements: usize,
    /// `W^1/2` of each measurement; 0 for one that is never used.
    pub(crate) root_weights: Vec<f64>,
    /// `U` `[measurement, rank]`.
    pub(crate) left: Mat<f64>,
    /// `S`, descending.
    pub(crate) singular: Vec<f64>,
    /// `V` `[unknown, rank]`.
    pub(crate) basis: Mat<f64>,
}

impl Compression {
    /// Expands a Jacobian `[measurement, unknown]` with the weights of its rows.
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
        // scaled to 1 first: squares of 1e-200 would vanish
        let transposed = Mat::from_fn(unknowns, measurements, |p, i| match root_weights[i] {
            0.0 => 0.0,
            w => w * jacobian[(i, p)] / largest,
        });
        let rank = unknowns.min(measurements);
        let failed = InverseError::Factorisation {
            what: "singular values of the Jacobian",
            size: measurements,
        };
        let (mut basis, mut left) = (Mat::zeros(unknowns, rank), Mat::zeros(measurements, rank));
        let mut singular = Col::<f64>::zeros(rank);
        let thin = ComputeSvdVectors::Thin;
        let scratch =
            svd_scratch::<f64>(unknowns, measurements, thin, thin, Par::Seq, Spec::default());
        svd(
            transposed.as_ref(),
            singular.as_diagonal_mut(),
            Some(basis.as_mut()),
            Some(left.as_mut()),
            Par::Seq,
            MemStack::new(&mut MemBuffer::new(scratch)),
            Spec::default(),
        )
        .map_err(|_| failed)?;
        let floor = unknowns.max(measurements) as f64 * f64::EPSILON * singular[0];
        let kept = (0..rank).take_while(|&k| singular[k] > floor).count();
        Ok(Self {
            measurements,
            root_weights,
            left: left.get(.., ..kept).to_owned(),
            singular: (0..kept).map(|k| largest * singular[k]).collect(),
            basis: basis.get(.., ..kept).to_owned(),
        })
    }

    pub(crate) fn rank(&self) -> usize {
        self.singular.len()
    }
}

/// Modes and targets of a whole sequence.
pub(crate) struct MovieData {
    pub(crate) modes: Vec<Mode>,
    /// Index into `modes`, `[frame]`.
    pub(crate) mode_of: Vec<usize>,
    /// `[frame]`.
    pub(crate) targets: Vec<Target>,
}

impl MovieData {
    pub(crate) fn new(
        compression: &Compression,
        frames: &Differences<'_>,
    ) -> Result<Self, InverseError> {
        check_length("columns of differences", frames.values.ncols(), compression.measurements)?;
        let rank = compression.rank();
        let mut modes = vec![Mode::full(compression)];
        let (mut mode_of, mut targets) = (Vec::new(), Vec::new());
        let mut scratch = None;
        let (mut coefficients, mut whitened) = (vec![0.0; rank], vec![0.0; frames.values.ncols()]);
        for frame in 0..frames.values.nrows() {
            let masked = |i: usize| compression.root_weights[i] > 0.0 && !frames.is_good(frame, i);
            let known = modes
                .iter()
                .position(|m| m.masked.iter().enumerate().all(|(i, &b)| b == masked(i)));
            let index = match known {
                Some(index) => index,
                None => {
                    let scratch = scratch.get_or_insert_with(|| ModeScratch::new(compression));
                    let mut mode = Mode::full(compression);
                    mode.set(compression, masked, scratch)?;
                    modes.push(mode);
                    modes.len() - 1
                }
            };
            let mut target = Target::zero(rank);
            let dv = |i: usize| frames.values[(frame, i)];
            target.set(compression, &modes[index], dv, &mut coefficients, &mut whitened);
            mode_of.push(index);
            targets.push(target);
        }
        Ok(Self { modes, mode_of, targets })
    }
}
