//! Frames with missing data: leaving measurements out of a reconstruction that was built with them.
//!
//! With `G = (A + mu I)^-1`, `mu = lambda^2 s` and weighted data `b`, the image is `P J' W^1/2 G b`.
//! Fill the missing values `b_S` so that `(G b)_S = 0`: then the missing rows of `J` drop out of
//! the image, and the others read `(A_KK + mu I) (G b)_K = b_K`, which is the reconstruction built
//! from the kept measurements `K` alone, at the same `mu`. In the spectrum `A = U diag(d) U'`
//!
//! ```text
//! mu G = I - U diag(d / (d + mu)) U' = I - T T',   T = U diag(d / (d + mu))^1/2
//! (I - T_S T_S') b_S = T_S T_K' b_K
//! ```
//!
//! a positive definite system of as many unknowns as values are left out, with eigenvalues between
//! `mu / (d_1 + mu)` and 1.
//!
//! Source: the fill is the conditional mean of the missing data given the others in the Gaussian
//! model `b ~ N(0, A + mu I)`; `G b` with a zeroed part is the usual leave-out identity, for
//! example Rasmussen, Williams, *Gaussian Processes for Machine Learning* (2006), section 5.4.2.

use super::spectrum::Spectrum;
use crate::InverseError;
use crate::data::Channels;
use faer::dyn_stack::MemStack;
use faer::linalg::cholesky::llt;
use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::{Accum, ColMut, ColRef, MatMut, MatRef, Par, Spec};
use std::mem::MaybeUninit;

/// Largest expected error that is let through, as part of the image.
const MOST_ERROR: f64 = 1e-6;

/// What the fill needs to know of a spectrum at a hyperparameter.
#[derive(Debug, Clone, Default)]
pub(crate) struct Damping {
    /// `sqrt(d (d + mu))`, `[rank]`: from `diag(1 / (d + mu)) U'` to `T'`.
    gains: Vec<f64>,
    /// `mu / (d_1 + mu)`: no eigenvalue of `I - T_S T_S'` is smaller.
    least: f64,
}

impl Damping {
    pub(crate) fn new(spectrum: &Spectrum, hyperparameter: f64) -> Self {
        let mu = spectrum.damping(hyperparameter);
        // two roots: the product may leave the range of doubles
        let gains = spectrum.values.iter().map(|d| d.sqrt() * (d + mu).sqrt()).collect();
        Self { gains, least: mu / (spectrum.values[0] + mu) }
    }

    /// Error of the image, as a part of it, by the smallest pivot of `I - T_S T_S'`.
    ///
    /// The system carries rounding of `eps`, so the fill errs by `eps / pivot`; in the image that
    /// direction counts `sqrt(pivot / mu)` where the data itself counts `1 / sqrt(d_1)` or more.
    fn expected_error(&self, pivot: f64) -> f64 {
        f64::EPSILON / (pivot * self.least).sqrt()
    }
}

/// Memory for the fill; grows with the largest set met so far.
#[derive(Debug, Clone, Default)]
pub(crate) struct MissingData {
    /// Missing measurements as indices into the used ones, ascending.
    pub(crate) indices: Vec<usize>,
    /// `T_S`, row-major `[missing, rank]`.
    rows: Vec<f64>,
    /// `I - T_S T_S'`, then its Cholesky factor, column-major.
    system: Vec<f64>,
    /// `b_S`.
    fill: Vec<f64>,
    /// `T' b`.
    data: Vec<f64>,
    scratch: Vec<MaybeUninit<u8>>,
}

impl MissingData {
    /// Takes the measurements of the protocol that are masked; unused ones are left out already.
    pub(crate) fn choose(
        &mut self,
        channels: &Channels,
        masked: &[usize],
    ) -> Result<(), InverseError> {
        self.indices.clear();
        for &measurement in masked {
            if measurement >= channels.count {
                let measurements = channels.count;
                return Err(InverseError::UnknownMeasurement { measurement, measurements });
            }
            self.indices.extend(channels.used.binary_search(&measurement));
        }
        self.indices.sort_unstable();
        self.indices.dedup();
        if self.indices.len() == channels.used.len() {
            return Err(InverseError::NothingUsed { measurements: channels.count });
        }
        Ok(())
    }

    /// Adds the part of the fill to `coefficients` `diag(1 / (d + mu)) U' b` of data whose missing
    /// values are zero.
    ///
    /// `data_basis` is `diag(1 / (d + mu)) U' W^1/2` `[rank, used]`.
    pub(crate) fn complete(
        &mut self,
        data_basis: MatRef<'_, f64>,
        root_weights: &[f64],
        damping: &Damping,
        coefficients: &mut [f64],
    ) -> Result<(), InverseError> {
        let (k, gains) = (self.indices.len(), &damping.gains);
        if k == 0 {
            return Ok(());
        }
        self.rows.clear();
        for &i in &self.indices {
            let row = gains.iter().enumerate();
            self.rows.extend(row.map(|(j, gain)| data_basis[(j, i)] / root_weights[i] * gain));
        }
        self.data.clear();
        self.data.extend(coefficients.iter().zip(gains).map(|(c, gain)| c * gain));
        self.fill.clear();
        self.fill.resize(k, 0.0);
        let rows = MatRef::from_row_major_slice(&self.rows, k, gains.len());
        let fill = ColMut::from_slice_mut(&mut self.fill);
        matmul(fill, Accum::Replace, rows, ColRef::from_slice(&self.data), 1.0, Par::Seq);
        self.solve(damping)?;
        let rows = MatRef::from_row_major_slice(&self.rows, k, gains.len());
        let data = ColMut::from_slice_mut(&mut self.data);
        let fill = ColRef::from_slice(&self.fill);
        matmul(data, Accum::Replace, rows.transpose(), fill, 1.0, Par::Seq);
        let parts = self.data.iter().zip(gains);
        coefficients.iter_mut().zip(parts).for_each(|(c, (part, gain))| *c += part / gain);
        Ok(())
    }

    /// `(I - T_S T_S')^-1` times the right-hand side in `fill`, in place.
    fn solve(&mut self, damping: &Damping) -> Result<(), InverseError> {
        let k = self.indices.len();
        let rows = MatRef::from_row_major_slice(&self.rows, k, self.rows.len() / k);
        self.system.clear();
        self.system.resize(k * k, 0.0);
        let mut system = MatMut::from_column_major_slice_mut(&mut self.system, k, k);
        (0..k).for_each(|i| system[(i, i)] = 1.0);
        triangular::matmul(
            system.as_mut(),
            BlockStructure::TriangularLower,
            Accum::Add,
            rows,
            BlockStructure::Rectangular,
            rows.transpose(),
            BlockStructure::Rectangular,
            -1.0,
            Par::Seq,
        );
        let needed = llt::factor::cholesky_in_place_scratch::<f64>(k, Par::Seq, Spec::default());
        self.scratch.resize(needed.unaligned_bytes_required(), MaybeUninit::uninit());
        let stack = MemStack::new(&mut self.scratch);
        let regularisation = llt::factor::LltRegularization::default();
        let factor = system.as_mut();
        llt::factor::cholesky_in_place(factor, regularisation, Par::Seq, stack, Spec::default())
            .map_err(|_| InverseError::MaskedDominates { masked: k, expected_error: 1.0 })?;
        let pivot = (0..k).map(|i| system[(i, i)].powi(2)).fold(f64::INFINITY, f64::min);
        let expected_error = damping.expected_error(pivot);
        if expected_error > MOST_ERROR {
            return Err(InverseError::MaskedDominates { masked: k, expected_error });
        }
        let fill = MatMut::from_column_major_slice_mut(&mut self.fill, k, 1);
        llt::solve::solve_in_place(
            system.as_ref(),
            fill,
            Par::Seq,
            MemStack::new(&mut self.scratch),
        );
        Ok(())
    }
}
