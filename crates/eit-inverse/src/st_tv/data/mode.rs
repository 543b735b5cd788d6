//! What a frame with masked channels sees of the coefficients.

use super::Compression;
use crate::InverseError;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::{Accum, Col, Mat, Par, Spec};

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
