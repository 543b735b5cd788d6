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

use crate::data::check_length;
use crate::{Differences, InverseError};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::linalg::svd::{ComputeSvdVectors, svd, svd_scratch};
use faer::{Accum, Col, Mat, Par, Spec};
use ndarray::ArrayRef2;

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

/// How the data of a frame sees the coefficients `c = V' x`: `|s . (Q' c) - target|^2 + rest^2`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Mode {
    /// Channels left out, `[measurement]`, beside those of weight 0.
    pub(crate) masked: Vec<bool>,
    /// `s`, `[rank]`.
    pub(crate) singular: Vec<f64>,
    /// `Q` `[rank, rank]` by columns; empty for the identity.
    pub(crate) rotation: Vec<f64>,
    /// Good channels.
    pub(crate) good: usize,
}

/// Scratch memory for a mode.
pub(crate) struct ModeScratch {
    gram: Mat<f64>,
    rows: Mat<f64>,
    values: Col<f64>,
    vectors: Mat<f64>,
    memory: MemBuffer,
}

impl ModeScratch {
    pub(crate) fn new(compression: &Compression) -> Self {
        let rank = compression.rank();
        let yes = ComputeEigenvectors::Yes;
        let scratch = self_adjoint_evd_scratch::<f64>(rank, yes, Par::Seq, Spec::default());
        Self {
            gram: Mat::zeros(rank, rank),
            rows: Mat::zeros(compression.measurements, rank),
            values: Col::zeros(rank),
            vectors: Mat::zeros(rank, rank),
            memory: MemBuffer::new(scratch),
        }
    }
}

impl Mode {
    /// No masked channel.
    pub(crate) fn full(compression: &Compression) -> Self {
        Self {
            masked: vec![false; compression.measurements],
            singular: compression.singular.clone(),
            rotation: Vec::new(),
            good: compression.root_weights.iter().filter(|w| **w > 0.0).count(),
        }
    }

    /// Room for any mode.
    pub(crate) fn with_room(compression: &Compression) -> Self {
        let rank = compression.rank();
        let mut this = Self::full(compression);
        this.rotation.reserve_exact(rank * rank);
        this
    }

    /// The same mode in memory of its own, with room for any.
    pub(crate) fn with_same_room(&self) -> Self {
        let mut this = self.clone();
        this.rotation.reserve_exact(self.rotation.capacity());
        this
    }

    /// Copies another mode; allocates nothing in a mode with room.
    pub(crate) fn take(&mut self, other: &Self) {
        self.masked.copy_from_slice(&other.masked);
        self.singular.copy_from_slice(&other.singular);
        self.rotation.clear();
        self.rotation.extend_from_slice(&other.rotation);
        self.good = other.good;
    }

    /// Makes it the mode of a frame without data.
    pub(crate) fn drop_data(&mut self) {
        self.masked.fill(true);
        self.singular.fill(0.0);
        self.rotation.clear();
        self.good = 0;
    }

    /// Is it the mode of a frame with these good channels?
    pub(crate) fn fits(&self, compression: &Compression, good: &[bool]) -> bool {
        let channels = self.masked.iter().zip(good).zip(&compression.root_weights);
        self.good > 0
            && channels.into_iter().all(|((masked, good), w)| *w == 0.0 || *masked != *good)
    }

    /// Sets the mode to one with masked channels. Allocates nothing in a mode with room.
    pub(crate) fn set(
        &mut self,
        compression: &Compression,
        masked: impl Fn(usize) -> bool,
        scratch: &mut ModeScratch,
    ) -> Result<(), InverseError> {
        let mut any = false;
        self.good = 0;
        for (i, slot) in self.masked.iter_mut().enumerate() {
            let used = compression.root_weights[i] > 0.0;
            *slot = used && masked(i);
            any |= *slot;
            self.good += usize::from(used && !*slot);
        }
        self.rotation.clear();
        self.singular.copy_from_slice(&compression.singular);
        if !any {
            return Ok(());
        }
        let rank = compression.rank();
        let ModeScratch { gram, rows, values, vectors, memory } = scratch;
        for k in 0..rank {
            for (i, &masked) in self.masked.iter().enumerate() {
                let entry = compression.left[(i, k)] * compression.singular[k];
                rows[(i, k)] = if masked { 0.0 } else { entry };
            }
        }
        faer::linalg::matmul::matmul(
            gram.as_mut(),
            Accum::Replace,
            rows.transpose(),
            rows.as_ref(),
            1.0,
            Par::Seq,
        );
        self_adjoint_evd(
            gram.as_ref(),
            values.as_diagonal_mut(),
            Some(vectors.as_mut()),
            Par::Seq,
            MemStack::new(memory),
            Spec::default(),
        )
        .map_err(|_| InverseError::Factorisation {
            what: "eigenvalues of a frame with masked channels",
            size: rank,
        })?;
        // rounding leaves eigenvalues of lost directions just above or below zero
        let floor = rank as f64 * f64::EPSILON * values.iter().fold(0.0_f64, |m, v| m.max(*v));
        for (s, &v) in self.singular.iter_mut().zip(values.iter()) {
            *s = if v > floor { v.sqrt() } else { 0.0 };
        }
        (0..rank).for_each(|k| self.rotation.extend(vectors.col(k).iter()));
        Ok(())
    }

    /// `Q' c`.
    pub(crate) fn rotate(&self, c: &[f64], out: &mut [f64]) {
        if self.rotation.is_empty() {
            out.copy_from_slice(c);
            return;
        }
        for (out, column) in out.iter_mut().zip(self.rotation.chunks_exact(c.len())) {
            *out = column.iter().zip(c).map(|(q, c)| q * c).sum();
        }
    }

    /// `Q u`.
    pub(crate) fn rotate_back(&self, u: &[f64], out: &mut [f64]) {
        if self.rotation.is_empty() {
            out.copy_from_slice(u);
            return;
        }
        out.fill(0.0);
        for (u, column) in u.iter().zip(self.rotation.chunks_exact(u.len())) {
            out.iter_mut().zip(column).for_each(|(o, q)| *o += q * u);
        }
    }
}

/// Data of one frame in the coordinates of its mode.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Target {
    /// `[rank]`.
    pub(crate) values: Vec<f64>,
    /// Squared norm of what no image can explain.
    pub(crate) rest_squared: f64,
}

impl Target {
    pub(crate) fn zero(rank: usize) -> Self {
        Self { values: vec![0.0; rank], rest_squared: 0.0 }
    }

    /// Norm of what an image can explain.
    pub(crate) fn norm(&self) -> f64 {
        self.values.iter().map(|b| b * b).sum::<f64>().sqrt()
    }

    /// The target in a unit of this many of its own.
    pub(crate) fn divide(&mut self, unit: f64) {
        self.values.iter_mut().for_each(|b| *b /= unit);
        self.rest_squared /= unit * unit;
    }

    /// No data.
    pub(crate) fn clear(&mut self) {
        self.values.fill(0.0);
        self.rest_squared = 0.0;
    }

    /// Takes the good channels of a frame `dv`. `coefficients` and `whitened` are scratch, `[rank]`
    /// and `[measurement]`.
    pub(crate) fn set(
        &mut self,
        compression: &Compression,
        mode: &Mode,
        dv: impl Fn(usize) -> f64,
        coefficients: &mut [f64],
        whitened: &mut [f64],
    ) {
        for (i, value) in whitened.iter_mut().enumerate() {
            let weight = compression.root_weights[i];
            // masked values may be NaN
            *value = if mode.masked[i] || weight == 0.0 { 0.0 } else { weight * dv(i) };
        }
        for (k, c) in coefficients.iter_mut().enumerate() {
            let column = compression.left.col(k);
            *c = column.iter().zip(whitened.iter()).map(|(u, v)| u * v).sum();
        }
        if mode.rotation.is_empty() {
            self.values.copy_from_slice(coefficients);
        } else {
            // B = U_t S = P diag(s) Q', so the target is P' v = diag(1/s) Q' B' v
            coefficients.iter_mut().zip(&compression.singular).for_each(|(c, s)| *c *= s);
            mode.rotate(coefficients, &mut self.values);
            for (value, s) in self.values.iter_mut().zip(&mode.singular) {
                *value = if *s > 0.0 { *value / s } else { 0.0 };
            }
        }
        // what is left, value by value: a difference of squares would leave the root of rounding
        if mode.rotation.is_empty() {
            coefficients.copy_from_slice(&self.values);
        } else {
            for (value, s) in self.values.iter_mut().zip(&mode.singular) {
                *value = if *s > 0.0 { *value / s } else { 0.0 };
            }
            mode.rotate_back(&self.values, coefficients);
            coefficients.iter_mut().zip(&compression.singular).for_each(|(c, s)| *c *= s);
            self.values.iter_mut().zip(&mode.singular).for_each(|(v, s)| *v *= s);
        }
        for (k, c) in coefficients.iter().enumerate() {
            let column = compression.left.col(k);
            whitened.iter_mut().zip(column.iter()).for_each(|(w, u)| *w -= c * u);
        }
        let rest = whitened.iter().zip(&mode.masked).filter(|(_, masked)| !**masked);
        self.rest_squared = rest.map(|(w, _)| w * w).sum();
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
