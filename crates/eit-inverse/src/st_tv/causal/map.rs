//! Step map, the step size of each unknown, and the exact data step in that metric.
//!
//! ```text
//! g     = maximum of: the gradient of the current images, dilated by two; the linear image of the
//!         innovation; a fraction of their largest value
//! tau   = c (X / lambda_space) sqrt(g / X)
//! sigma = 1 / ((|D|^2 + 1) max tau over the group)      |Sigma^1/2 [D; I] T^1/2| <= 1
//! ```
//!
//! Steps are large where the image has gradients and small where it is flat; the lower limit and the
//! innovation allow new objects to appear.

mod kernels;

use super::differences::Basis;
use super::fields::{Fields, Setting};
use super::lanes::{LANES, Project};
use super::seen::Seen;
use crate::InverseError;
use crate::st_tv::dense::Eigen;
use kernels::{Congruent, Dilate, Gram, Invert, Sizes};
use pulp::Arch;

/// `c` above, for a largest singular value of 1; between 0.04 and 0.08 the number of iterations of a
/// steady frame varies by a tenth.
const STEP: f64 = 0.057;
/// Smallest scale of a cell relative to the scale of the image.
const FLOOR: f64 = 2e-3;
/// Largest `tau s^2` in the tail, whose steps are explicit.
const EXPLICIT: f64 = 0.04;

/// Step map with its matrices.
#[derive(Clone)]
pub(crate) struct StepMap<T> {
    /// Number of ranks with an exact step.
    pub(crate) head: usize,
    /// Scale of the expected change, over cells, and scratch memory over cells and groups.
    pub(crate) scale: Vec<T>,
    spread: Vec<T>,
    groups: Vec<T>,
    /// `V' T V`, `[padded rank][padded rank]`, upper triangle.
    gram: Vec<T>,
    /// `M = (I + F' V' T V F)^-1`, `[row of F'][row of F']`; of the head for frames without masked
    /// channels.
    pub(crate) inverse: Vec<f64>,
    pub(crate) head_inverse: Vec<T>,
    /// For dense steps: `F'` and `F M`, or `F'` and `F` transformed by the eigenvectors.
    pub(crate) transposed: Vec<f64>,
    pub(crate) back: Vec<f64>,
    pub(crate) values: Vec<f64>,
    /// Eigenvectors by rows.
    pub(crate) vectors: Vec<f64>,
    work: Vec<f64>,
    eigen: Option<Eigen>,
    /// Largest step.
    pub(crate) largest_tau: f64,
}

impl<T> std::fmt::Debug for StepMap<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("StepMap").field("head", &self.head).finish_non_exhaustive()
    }
}

/// Weights of a frame in internal units.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Weights {
    pub(crate) lambda_space: f64,
    pub(crate) lambda_time: f64,
    /// Scale of the image.
    pub(crate) image: f64,
    /// Smoothing of the duals.
    pub(crate) gamma: f64,
    /// Step relative to the best one without bounds. With bounds the duals need large changes, which
    /// requires smaller steps of the image.
    pub(crate) step: f64,
}

impl<T: Project> StepMap<T> {
    pub(crate) fn new(setting: &Setting<T>, constrained: bool) -> Self {
        let (rank, padded) = (setting.rank, setting.padded);
        let cells = vec![T::default(); setting.places.length];
        let eigen = constrained.then(|| Eigen::new(rank));
        let square = || vec![0.0; rank * rank];
        Self {
            head: padded,
            scale: cells.clone(),
            spread: cells,
            groups: vec![T::default(); setting.basis.group_length(&setting.places)],
            gram: vec![T::default(); padded * padded],
            inverse: vec![0.0; padded * padded],
            head_inverse: vec![T::default(); padded * padded],
            transposed: square(),
            back: square(),
            values: vec![0.0; rank],
            vectors: square(),
            work: square(),
            eigen,
            largest_tau: 0.0,
        }
    }

    /// Resets the scale.
    pub(crate) fn clear(&mut self) {
        self.scale.fill(T::default());
    }

    /// Raises the scale to at least `share` times the absolute values, over cells.
    pub(crate) fn raise(&mut self, values: &[T], share: f64) {
        let share = T::from_f64(share);
        for (scale, value) in self.scale.iter_mut().zip(values) {
            *scale = scale.max(share * value.abs());
        }
    }

    /// Raises the scale to at least the dilated gradient of an image.
    pub(crate) fn raise_to_gradient(&mut self, arch: Arch, setting: &Setting<T>, image: &[T]) {
        let Self { scale, spread, groups, .. } = self;
        match &setting.basis {
            Basis::Grid(differences) => {
                arch.dispatch(Dilate { setting, differences, image, scale, spread, groups });
            }
            Basis::Gathered(differences) => {
                arch.dispatch(Dilate {
                    setting,
                    differences: differences.as_ref(),
                    image,
                    scale,
                    spread,
                    groups,
                });
            }
        }
    }

    /// Sets steps and matrices from the scale.
    ///
    /// # Errors
    /// [`InverseError::Factorisation`] if the eigenvalue decomposition of a constrained frame fails.
    pub(crate) fn set(
        &mut self,
        arch: Arch,
        setting: &Setting<T>,
        fields: &mut Fields<T>,
        seen: &Seen,
        weights: Weights,
    ) -> Result<(), InverseError> {
        let scale = &self.scale;
        self.largest_tau = match &setting.basis {
            Basis::Grid(differences) => {
                arch.dispatch(Sizes { setting, differences, fields: &mut *fields, scale, weights })
            }
            Basis::Gathered(differences) => arch.dispatch(Sizes {
                setting,
                differences: differences.as_ref(),
                fields: &mut *fields,
                scale,
                weights,
            }),
        };
        let is_dense = self.eigen.is_some() || !seen.is_whole;
        self.head = if is_dense { setting.padded } else { self.ranks(setting, seen) };
        arch.dispatch(Gram { setting, tau: &fields.tau, ranks: self.head, out: &mut self.gram });
        if is_dense {
            self.set_dense(arch, setting, seen)
        } else {
            self.set_head(arch, setting, seen)
        }
    }

    /// Returns the number of ranks in the head for frames without masked channels.
    fn ranks(&self, setting: &Setting<T>, seen: &Seen) -> usize {
        let square = |k: &usize| seen.transposed[k * (setting.rank + 1)].powi(2);
        let strong = (0..setting.rank).take_while(|k| self.largest_tau * square(k) > EXPLICIT);
        strong.count().next_multiple_of(LANES).clamp(LANES, setting.padded)
    }

    fn set_head(
        &mut self,
        arch: Arch,
        setting: &Setting<T>,
        seen: &Seen,
    ) -> Result<(), InverseError> {
        let (head, padded, rank) = (self.head, setting.padded, setting.rank);
        let singular = |k: usize| if k < rank { seen.transposed[k * (rank + 1)] } else { 0.0 };
        for i in 0..head {
            for j in 0..=i {
                let own = self.gram[j * padded + i].to_f64() * singular(i) * singular(j);
                self.inverse[i * head + j] = own;
                self.inverse[j * head + i] = own;
            }
            self.inverse[i * head + i] += 1.0;
        }
        arch.dispatch(Invert { matrix: &mut self.inverse[..head * head], n: head });
        for (out, value) in self.head_inverse.iter_mut().zip(&self.inverse[..head * head]) {
            *out = T::from_f64(*value);
        }
        Ok(())
    }

    fn set_dense(
        &mut self,
        arch: Arch,
        setting: &Setting<T>,
        seen: &Seen,
    ) -> Result<(), InverseError> {
        let (rank, rows, padded) = (setting.rank, seen.rows, setting.padded);
        for i in 0..rank {
            for j in 0..=i {
                let own = self.gram[j * padded + i].to_f64();
                self.work[i * rank + j] = own;
                self.work[j * rank + i] = own;
            }
        }
        let Self { work, vectors, inverse, transposed, back, values, eigen, .. } = self;
        let inverse = &mut inverse[..rows * rows];
        arch.dispatch(Congruent {
            f: &seen.transposed,
            gram: work,
            half: vectors,
            rank,
            rows,
            out: inverse,
        });
        match eigen {
            None => {
                for i in 0..rows {
                    inverse[i * rows + i] += 1.0;
                }
                arch.dispatch(Invert { matrix: inverse, n: rows });
                transposed.copy_from_slice(&seen.transposed);
                // rows of F M, as sums of rows of M
                back[..rank * rows].fill(0.0);
                for (f, m) in seen.transposed.chunks_exact(rank).zip(inverse.chunks_exact(rows)) {
                    for (f, out) in f.iter().zip(back.chunks_exact_mut(rows)) {
                        out.iter_mut().zip(m).for_each(|(o, m)| *o += f * m);
                    }
                }
                Ok(())
            }
            Some(eigen) => {
                eigen.set(inverse, rows, values, vectors)?;
                for (i, vector) in vectors.chunks_exact(rows).enumerate().take(rows) {
                    let out = &mut transposed[i * rank..][..rank];
                    out.fill(0.0);
                    for (e, f) in vector.iter().zip(seen.transposed.chunks_exact(rank)) {
                        out.iter_mut().zip(f).for_each(|(o, f)| *o += e * f);
                    }
                    for (k, value) in out.iter().enumerate() {
                        back[k * rows + i] = *value;
                    }
                }
                Ok(())
            }
        }
    }
}
