//! Kalman filter and Rauch-Tung-Striebel smoother for amplitudes that follow a stationary first-order
//! Gauss-Markov process.
//!
//! ```text
//! a_1 ~ N(0, I),   a_t+1 = phi a_t + N(0, q I),   b_t = H_t a_t + N(0, mu I),   H = U D^1/2
//! filter:   M_t = phi^2 C_t-1 + q I,   C_t = (M_t^-1 + H_t' H_t / mu)^-1
//!           c_t = phi c_t-1 + C_t H_t' (b_t - phi H_t c_t-1) / mu
//! smoother: a_t = c_t + phi C_t M_t+1^-1 (a_t+1 - phi c_t)
//! ```
//!
//! with `H_t` the rows of `H` that are not masked in frame `t`. While nothing is masked, `H' H = D`
//! and all covariances are diagonal: `r` scalar filters. From the first masked frame on they are
//! full, and the update is a least-squares problem solved by QR, which does not square the condition
//! number:
//!
//! ```text
//! M = L L',   C = L (R' R)^-1 L',   Q R = [I; H L / mu^1/2]
//! ```
//!
//! Source: Rauch, Tung, Striebel, *AIAA J.* 3 (1965), 1445-1450; for EIT: Vauhkonen, Karjalainen,
//! Kaipio, *IEEE Trans. Biomed. Eng.* 45 (1998), 486-493. The array form of the update: Kailath,
//! Sayed, Hassibi, *Linear Estimation* (2000), chapter 12.

use super::modes::Modes;
use crate::{DifferenceFrames, ImageSequence, InverseError, SequenceReport};
use faer::linalg::solvers::{Llt, SolveLstsq};
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::prelude::Solve;
use faer::{ColMut, ColRef, Mat, Par, Side};
use std::time::Instant;

/// Parameters of the Gauss-Markov process.
#[derive(Debug, Clone, Copy)]
pub(super) struct Markov {
    /// `phi`.
    pub(super) decay: f64,
    /// `q = 1 - phi^2`, relative to the prior covariance, which is then that of every frame.
    pub(super) process_noise: f64,
}

/// Normal distribution of the amplitudes of one frame.
#[derive(Debug, Clone)]
struct Belief {
    /// `[rank]`.
    mean: Vec<f64>,
    covariance: Covariance,
}

#[derive(Debug, Clone)]
enum Covariance {
    Diagonal(Vec<f64>),
    Full(Mat<f64>),
}

impl Belief {
    /// Returns the distribution before the first frame.
    fn initial(rank: usize) -> Self {
        Self { mean: vec![0.0; rank], covariance: Covariance::Diagonal(vec![1.0; rank]) }
    }

    /// Predicts the next frame: `c -> phi c`, `C -> phi^2 C + q I`.
    fn predict(&mut self, process: &Markov) {
        let Markov { decay, process_noise } = *process;
        self.mean.iter_mut().for_each(|c| *c *= decay);
        match &mut self.covariance {
            Covariance::Diagonal(variance) => {
                variance.iter_mut().for_each(|v| *v = decay * decay * *v + process_noise);
            }
            Covariance::Full(matrix) => *matrix = predicted(matrix, process),
        }
    }

    /// Updates the distribution with a frame. `whitened` is zero at the indices `masked`;
    /// `coefficients` `[rank]` is scratch memory.
    fn update(
        &mut self,
        modes: &Modes,
        whitened: &[f64],
        masked: &[usize],
        coefficients: &mut [f64],
    ) -> Result<(), InverseError> {
        match &mut self.covariance {
            Covariance::Diagonal(variance) if masked.is_empty() => {
                modes.project(whitened, coefficients);
                let mu = modes.noise_variance;
                let parts = coefficients.iter().zip(&modes.gains);
                for ((c, v), (b, gain)) in self.mean.iter_mut().zip(variance).zip(parts) {
                    let innovation = mu + gain * gain * *v;
                    *c += *v * gain / innovation * (b - gain * *c);
                    *v *= mu / innovation;
                }
            }
            Covariance::Diagonal(variance) => {
                let rank = variance.len();
                let full = Mat::from_fn(rank, rank, |i, j| if i == j { variance[i] } else { 0.0 });
                let matrix = update_full(&mut self.mean, &full, modes, whitened, masked)?;
                self.covariance = Covariance::Full(matrix);
            }
            Covariance::Full(matrix) => {
                *matrix = update_full(&mut self.mean, matrix, modes, whitened, masked)?;
            }
        }
        if self.mean.iter().all(|c| c.is_finite()) {
            Ok(())
        } else {
            Err(InverseError::Factorisation { what: "Kalman update", size: self.mean.len() })
        }
    }

    /// Applies the smoother gain: `difference -> phi C M^-1 difference`, with `M` the predicted
    /// covariance of the next frame.
    fn smoother_gain(&self, process: &Markov, difference: &mut [f64]) -> Result<(), InverseError> {
        let decay = process.decay;
        match &self.covariance {
            Covariance::Diagonal(variance) => {
                for (x, v) in difference.iter_mut().zip(variance) {
                    *x *= decay * v / (decay * decay * v + process.process_noise);
                }
            }
            Covariance::Full(matrix) => {
                let factor = cholesky(&predicted(matrix, process))?;
                factor.solve_in_place(ColMut::from_slice_mut(difference).as_mat_mut());
                let product = matrix * ColRef::from_slice(difference);
                difference.iter_mut().zip(product.iter()).for_each(|(x, y)| *x = decay * y);
            }
        }
        Ok(())
    }
}

fn predicted(matrix: &Mat<f64>, process: &Markov) -> Mat<f64> {
    let square = process.decay * process.decay;
    Mat::from_fn(matrix.nrows(), matrix.ncols(), |i, j| {
        square * matrix[(i, j)] + if i == j { process.process_noise } else { 0.0 }
    })
}

fn cholesky(matrix: &Mat<f64>) -> Result<Llt<f64>, InverseError> {
    matrix.llt(Side::Lower).map_err(|_| InverseError::Factorisation {
        what: "Cholesky of a predicted covariance",
        size: matrix.nrows(),
    })
}

/// Updates `mean` with a full covariance and returns the new covariance `C`.
fn update_full(
    mean: &mut [f64],
    predicted: &Mat<f64>,
    modes: &Modes,
    whitened: &[f64],
    masked: &[usize],
) -> Result<Mat<f64>, InverseError> {
    let (used, rank) = (whitened.len(), mean.len());
    let factor = cholesky(predicted)?;
    let mut rows = Mat::from_fn(used, rank, |i, k| modes.vectors[(i, k)] * modes.gains[k]);
    masked.iter().for_each(|&i| rows.row_mut(i).fill(0.0));
    let explained = &rows * ColRef::from_slice(mean);
    let root = modes.noise_variance.sqrt();
    let sensed = &rows * factor.L();
    let stacked = Mat::from_fn(rank + used, rank, |i, k| match i.checked_sub(rank) {
        None => f64::from(u8::from(i == k)),
        Some(i) => sensed[(i, k)] / root,
    });
    let mut step = Mat::from_fn(rank + used, 1, |i, _| match i.checked_sub(rank) {
        None => 0.0,
        // both are zero where masked
        Some(i) => (whitened[i] - explained[i]) / root,
    });
    let qr = stacked.qr();
    qr.solve_lstsq_in_place(step.as_mut());
    let step = factor.L() * step.subrows(0, rank);
    mean.iter_mut().zip(step.col(0).iter()).for_each(|(c, s)| *c += s);
    let mut turned = factor.L().transpose().to_owned();
    solve_lower_triangular_in_place(qr.thin_R().transpose(), turned.as_mut(), Par::Seq);
    Ok(turned.transpose() * &turned)
}

/// Computes the smoothed images of a sequence.
///
/// If all frames have the same masked channels (usually none), a frame costs `O(r)` in addition to
/// the `2 r (m + n)` of every linear method; otherwise `4 m r^2 + 5 r^3` flops and `8 r^2` bytes.
pub(super) fn smooth(
    method: &'static str,
    modes: &Modes,
    process: &Markov,
    frames: &DifferenceFrames<'_>,
) -> Result<ImageSequence, InverseError> {
    let start = Instant::now();
    let (whitened, masked) = modes.whiten_all(frames)?;
    let restricted = match masked.first() {
        Some(first) if common_and_partial(&masked, modes.channels.used.len()) => {
            // An error means that the remaining channels have no sensitivity; the general path then
            // gives the zero image.
            modes.without(first).ok()
        }
        _ => None,
    };
    let (images, residual) = match restricted {
        Some((modes, kept)) => {
            let whitened =
                Mat::from_fn(kept.len(), whitened.ncols(), |i, t| whitened[(kept[i], t)]);
            let masked = vec![Vec::new(); masked.len()];
            let amplitudes = smoothed(&modes, process, &whitened, &masked)?;
            (modes.images(&amplitudes), modes.residuals(&amplitudes, &whitened, &masked))
        }
        None => {
            let amplitudes = smoothed(modes, process, &whitened, &masked)?;
            (modes.images(&amplitudes), modes.residuals(&amplitudes, &whitened, &masked))
        }
    };
    Ok(ImageSequence { images, report: SequenceReport::direct(method, start, residual) })
}

/// Returns whether all frames have the same masked channels, at least one but not all.
fn common_and_partial(masked: &[Vec<usize>], used: usize) -> bool {
    let lacking = masked.first().map_or(0, Vec::len);
    lacking > 0 && lacking < used && masked.windows(2).all(|pair| pair[0] == pair[1])
}

/// Computes the smoothed amplitudes, `[rank, frame]`.
fn smoothed(
    modes: &Modes,
    process: &Markov,
    whitened: &Mat<f64>,
    masked: &[Vec<usize>],
) -> Result<Mat<f64>, InverseError> {
    let mut belief = Belief::initial(modes.rank());
    let mut scratch = vec![0.0; modes.rank()];
    let mut beliefs = Vec::with_capacity(masked.len());
    for (t, masked) in masked.iter().enumerate() {
        if t > 0 {
            belief.predict(process);
        }
        belief.update(modes, whitened.col_as_slice(t), masked, &mut scratch)?;
        beliefs.push(belief.clone());
    }
    let mut amplitudes = Mat::zeros(modes.rank(), masked.len());
    let mut later: Option<Vec<f64>> = None;
    for (t, belief) in beliefs.into_iter().enumerate().rev() {
        let mut mean = belief.mean.clone();
        if let Some(later) = later {
            scratch.iter_mut().zip(&later).zip(&mean).for_each(|((x, a), c)| {
                *x = a - process.decay * c;
            });
            belief.smoother_gain(process, &mut scratch)?;
            mean.iter_mut().zip(&scratch).for_each(|(a, x)| *a += x);
        }
        amplitudes.col_as_slice_mut(t).copy_from_slice(&mean);
        later = Some(mean);
    }
    Ok(amplitudes)
}
