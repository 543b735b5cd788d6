//! Missing data: excludes measurements from a reconstruction that was built with them.
//!
//! With `G = (A + mu I)^-1`, `mu = lambda^2 s` and weighted data `b`, the image is `P J' W^1/2 G b`.
//! Choose the missing values `b_S` so that `(G b)_S = 0`. Then the missing rows of `J` drop out of
//! the image, and the others satisfy `(A_KK + mu I) (G b)_K = b_K`, which is the reconstruction built
//! from the kept measurements `K` alone, at the same `mu`. With the spectrum `A = U diag(d) U'` this
//! is
//!
//! ```text
//! mu G = I - U diag(d / (d + mu)) U' = I - T T',   T = U diag(d / (d + mu))^1/2
//! (I - T_S T_S') b_S = T_S T_K' b_K
//! ```
//!
//! a positive definite system with one unknown per missing value and eigenvalues between
//! `mu / (d_1 + mu)` and 1.
//!
//! Source: the filled values are the conditional mean of the missing data given the other data in
//! the Gaussian model `b ~ N(0, A + mu I)`; `G b` with zeroed entries is the standard
//! cross-validation identity, for example Rasmussen, Williams, *Gaussian Processes for Machine
//! Learning* (2006), section 5.4.2.

use super::spectrum::Spectrum;
use crate::InverseError;
use crate::data::Channels;
use faer::dyn_stack::MemStack;
use faer::linalg::cholesky::llt;
use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::{Accum, ColMut, ColRef, MatMut, MatRef, Par, Spec};
use std::mem::MaybeUninit;

/// Largest accepted expected error, relative to the image.
const MOST_ERROR: f64 = 1e-6;

/// Quantities of a spectrum at one hyperparameter that the fill needs.
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
        // two roots, because the product may overflow or underflow
        let gains = spectrum.values.iter().map(|d| d.sqrt() * (d + mu).sqrt()).collect();
        Self { gains, least: mu / (spectrum.values[0] + mu) }
    }

    /// Estimates the relative error of the image from the smallest pivot of `I - T_S T_S'`.
    ///
    /// The system has rounding errors of `eps`, so the fill has an error of `eps / pivot`. In the
    /// image that direction has the weight `sqrt(pivot / mu)`, and the data has `1 / sqrt(d_1)` or
    /// more.
    fn expected_error(&self, pivot: f64) -> f64 {
        f64::EPSILON / (pivot * self.least).sqrt()
    }
}

/// Scratch memory for the fill; grows to the largest set of missing measurements so far.
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
    /// Selects the masked measurements, given as protocol indices; unused ones are already excluded.
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

    /// Adds the contribution of the fill to `coefficients`, which are `diag(1 / (d + mu)) U' b` for
    /// data whose missing values are zero.
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

    /// Replaces the right-hand side in `fill` by `(I - T_S T_S')^-1` times itself.
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
