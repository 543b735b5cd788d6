//! Response of the channels to a press at each position: the model's response times a gain per channel,
//! plus a Gaussian process over the skin.
//!
//! ```text
//! t_i = x_i / |x_i|                       frames of presses, length 1
//! a_i t_i = g * m(p_i) + f(p_i) + e_i     m: model's response, length 1; *: by channel
//! cov f_c(p), f_c(q) = s_c (exp(-|p - q|^2 / 2 l^2) + session if both of the same one),  var e = s_c noise
//! ```
//!
//! The second term is there only if presses of several sessions are learnt: what drifts from one to the next is much
//! the same over the skin, so that a few presses of a new session tell it, and the old ones everything else.
//!
//! Gains `g` come from a ridge regression toward the common gain. The amplitudes `a_i` (a frame's length is
//! less reliable than its shape) and the variances `s_c` of the channels follow from the residual. All
//! channels share one kernel, so one factorisation of `[press, press]` serves all.
//!
//! Source: Rasmussen, Williams, *Gaussian Processes for Machine Learning* (2006), sections 2.2 and 2.7 (a
//! process with an explicit mean).
//!
//! Over 300 lines because geometry, gains and the process are fitted together.

use super::presses::{ModelResponses, Presses};
use crate::InverseError;
use crate::check::check_positive;
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use ndarray::{Array1, Array2, Axis};

/// Addition to the variance of a channel, as a fraction of the mean: a channel that seems exact is so by
/// chance.
const LEAST_VARIANCE: f64 = 1e-3;

/// Variance of a channel's drift between sessions relative to its variance. On two hydrogel skins, 0.05 to 0.25 gave
/// errors within 5 % of each other.
const SESSION: f64 = 0.1;

/// Number of refits of the amplitudes, and their range.
const AMPLITUDE_STEPS: usize = 2;
const AMPLITUDES: [f64; 2] = [0.3, 3.0];

/// Parameters of a [`ResponseMap`]; [`ResponseMap::learn`] chooses them.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ResponseMapSettings {
    /// Length scale of the model's error over the skin, metres.
    pub length_m: f64,
    /// Variance of a single press relative to the channel's variance.
    pub noise: f64,
    /// Strength of the pull of each channel's gain toward the common one, relative to the information in
    /// the presses; `None` ignores the model, so that everything is learnt.
    pub gain_pull: Option<f64>,
    /// Number of channels with independent errors, to which the log likelihood is scaled.
    pub independent_channels: f64,
}

impl ResponseMapSettings {
    /// Checks every number.
    ///
    /// # Errors
    /// [`InverseError::OutOfRange`].
    fn validate(&self) -> Result<(), InverseError> {
        check_positive("length_m", self.length_m)?;
        check_positive("noise", self.noise)?;
        check_positive("gain_pull", self.gain_pull.unwrap_or(1.0))?;
        check_positive("independent_channels", self.independent_channels)
    }
}

/// Learnt responses of the channels to a press at each candidate position.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct ResponseMap {
    /// Parameters.
    pub settings: ResponseMapSettings,
    /// Candidate positions, metres.
    pub candidates_m: Vec<[f64; 3]>,
    /// Responses, `[candidate, channel]`, of length about 1.
    pub responses: Array2<f64>,
    /// Variance of a frame of length 1 at each candidate, relative to the channel's variance.
    pub variance: Vec<f64>,
    /// Variance of each channel, as far as the map does not explain it.
    pub channel_variance: Vec<f64>,
    /// Strength of a touch whose response has length 1 at each candidate, S m^2.
    pub strength_s_m2: Vec<f64>,
    /// Factor of a position's covariance, from cross-validation.
    pub covariance_factor: f64,
    /// Fraction of a frame that may remain unexplained; above it the frame is unlike all learnt presses.
    pub rest_limit: f64,
}

/// Kernel between presses and candidates: everything that does not depend on frames.
pub(super) struct Geometry {
    /// `(K + noise I)^-1`, `[press, press]`.
    inverse: Array2<f64>,
    between_presses: Array2<f64>,
    /// Kernel, `[candidate, press]`.
    to_candidates: Array2<f64>,
    /// The same times the inverse: weight of each press's residual in a candidate's response.
    known: Array2<f64>,
    variance: Vec<f64>,
}

impl Geometry {
    /// Of these presses, for candidates of one of their sessions.
    pub(super) fn new(
        presses: &Presses,
        candidates_m: &[[f64; 3]],
        session: u32,
        length_m: f64,
        noise: f64,
    ) -> Result<Self, InverseError> {
        let places_m = &presses.places_m;
        let count = places_m.len();
        let drift = if presses.has_sessions() { SESSION } else { 0.0 };
        let of_session = |is_same: bool| if is_same { drift } else { 0.0 };
        let kernel = |p: &[f64; 3], q: &[f64; 3]| {
            let squared: f64 = p.iter().zip(q).map(|(a, b)| (a - b).powi(2)).sum();
            (-0.5 * squared / (length_m * length_m)).exp()
        };
        let between = Array2::from_shape_fn((count, count), |(i, j)| {
            let is_same = presses.session(i) == presses.session(j);
            kernel(&places_m[i], &places_m[j]) + of_session(is_same)
        });
        let noisy = |i, j| between[[i, j]] + if i == j { noise } else { 0.0 };
        let inverse = inverse(&Mat::from_fn(count, count, noisy))?;
        let to_candidates = Array2::from_shape_fn((candidates_m.len(), count), |(i, j)| {
            kernel(&candidates_m[i], &places_m[j]) + of_session(presses.session(j) == session)
        });
        let known = to_candidates.dot(&inverse);
        let variance = known.rows().into_iter().zip(to_candidates.rows());
        let prior = 1.0 + drift;
        let variance = variance.map(|(a, b)| noise + (prior - a.dot(&b)).max(0.0)).collect();
        Ok(Self { inverse, between_presses: between, to_candidates, known, variance })
    }
}

/// Inverts a covariance matrix.
pub(super) fn inverse(matrix: &Mat<f64>) -> Result<Array2<f64>, InverseError> {
    let size = matrix.nrows();
    let factor = matrix.llt(Side::Lower);
    let factor =
        factor.map_err(|_| InverseError::Factorisation { what: "kernel of presses", size })?;
    let inverse = factor.solve(Mat::<f64>::identity(size, size));
    Ok(Array2::from_shape_fn((size, size), |(i, j)| inverse[(i, j)]))
}

/// Scales rows to length 1, leaving rows of zeros unchanged, and returns their lengths.
pub(super) fn unit_rows(rows: &Array2<f64>) -> (Array2<f64>, Vec<f64>) {
    let lengths: Vec<f64> = rows.rows().into_iter().map(|row| row.dot(&row).sqrt()).collect();
    let mut unit = rows.clone();
    for (mut row, length) in unit.rows_mut().into_iter().zip(&lengths) {
        row /= length.max(f64::MIN_POSITIVE);
    }
    (unit, lengths)
}

/// Frames and model responses of length 1.
pub(super) struct UnitData {
    pub frames: Array2<f64>,
    pub model_at_presses: Array2<f64>,
    pub model_at_candidates: Array2<f64>,
    /// Lengths of the model's responses at the candidates.
    pub lengths: Vec<f64>,
}

impl UnitData {
    pub(super) fn new(presses: &Presses, model: &ModelResponses) -> Self {
        let (model_at_candidates, lengths) = unit_rows(&model.at_candidates);
        Self {
            frames: unit_rows(&presses.frames).0,
            model_at_presses: unit_rows(&model.at_presses).0,
            model_at_candidates,
            lengths,
        }
    }

    pub(super) fn select(&self, which: &[usize]) -> [Array2<f64>; 2] {
        [&self.frames, &self.model_at_presses].map(|rows| rows.select(Axis(0), which))
    }
}

/// Responses at the candidates and variances of the channels.
pub(super) struct Responses {
    pub at_candidates: Array2<f64>,
    pub channel_variance: Array1<f64>,
    /// Weights of the process, `[press, channel]`.
    weights: Array2<f64>,
}

/// Fits gains, process, amplitudes and variances to frames and model responses of length 1.
pub(super) fn fit(
    geometry: &Geometry,
    frames: &Array2<f64>,
    model: &Array2<f64>,
    model_at_candidates: &Array2<f64>,
    gain_pull: Option<f64>,
) -> Responses {
    let presses = frames.nrows();
    let mut amplitudes = Array1::<f64>::ones(presses);
    let mut step = 0;
    loop {
        let scaled = frames * &amplitudes.view().insert_axis(Axis(1));
        let gains = gains(&scaled, model, gain_pull);
        let residual = &scaled - &(model * &gains);
        let weights = geometry.inverse.dot(&residual);
        let mut variance = (&residual * &weights).sum_axis(Axis(0)) / presses as f64;
        let mean = variance.mean().unwrap_or(0.0).max(f64::MIN_POSITIVE);
        variance.mapv_inplace(|v| v.max(0.0) + LEAST_VARIANCE * mean);
        if step == AMPLITUDE_STEPS {
            let at_candidates = model_at_candidates * &gains + geometry.to_candidates.dot(&weights);
            return Responses { at_candidates, channel_variance: variance, weights };
        }
        step += 1;
        let explained = model * &gains + geometry.between_presses.dot(&weights);
        for (a, (frame, explained)) in
            amplitudes.iter_mut().zip(frames.rows().into_iter().zip(explained.rows()))
        {
            let weighted = &frame / &variance;
            *a = weighted.dot(&explained) / weighted.dot(&frame).max(f64::MIN_POSITIVE);
            *a = a.clamp(AMPLITUDES[0], AMPLITUDES[1]);
        }
        let common = amplitudes.mapv(f64::ln).mean().unwrap_or(0.0).exp();
        amplitudes /= common;
    }
}

/// Gain of each channel, pulled toward the common one; zeros without the model.
fn gains(frames: &Array2<f64>, model: &Array2<f64>, pull: Option<f64>) -> Array1<f64> {
    let Some(pull) = pull else { return Array1::zeros(frames.ncols()) };
    let products = (frames * model).sum_axis(Axis(0));
    let squares = (model * model).sum_axis(Axis(0));
    let common = products.sum() / squares.sum().max(f64::MIN_POSITIVE);
    let ridge = (pull * squares.mean().unwrap_or(0.0)).max(f64::MIN_POSITIVE);
    (products + ridge * common) / (squares + ridge)
}

impl ResponseMap {
    /// Learns with given parameters; the covariance is that of the likelihood, and no frame counts as unlike.
    ///
    /// # Errors
    /// Presses or responses that are too few, mismatched or not finite, or settings out of range.
    pub fn with_settings(
        presses: &Presses,
        model: &ModelResponses,
        settings: ResponseMapSettings,
    ) -> Result<Self, InverseError> {
        presses.validate(2)?;
        model.validate(presses)?;
        settings.validate()?;
        let ResponseMapSettings { length_m, noise, gain_pull, .. } = settings;
        let geometry =
            Geometry::new(presses, &model.candidates_m, presses.latest(), length_m, noise)?;
        let data = UnitData::new(presses, model);
        let Responses { at_candidates, channel_variance, .. } = fit(
            &geometry,
            &data.frames,
            &data.model_at_presses,
            &data.model_at_candidates,
            gain_pull,
        );
        let strength = |length: &f64| 1.0 / length.max(f64::MIN_POSITIVE);
        Ok(Self {
            settings,
            candidates_m: model.candidates_m.clone(),
            responses: at_candidates,
            variance: geometry.variance,
            channel_variance: channel_variance.to_vec(),
            strength_s_m2: data.lengths.iter().map(strength).collect(),
            covariance_factor: 1.0,
            rest_limit: 1.0,
        })
    }
}

/// How well the response at each candidate explains frames of length 1, all channels divided by their standard
/// deviations.
pub(super) struct Explained {
    /// Product of frame and response, not below zero, `[frame, candidate]`.
    products: Array2<f64>,
    /// Squared length of the response, `[frame, candidate]`.
    squares: Array2<f64>,
    /// Variance of the response, `[frame, candidate]`.
    variances: Array2<f64>,
    /// Squared lengths of the frames.
    wholes: Array1<f64>,
    channels: f64,
}

impl Explained {
    /// Of frames that were not learnt.
    pub(super) fn new(geometry: &Geometry, responses: &Responses, frames: &Array2<f64>) -> Self {
        let weights = responses.channel_variance.mapv(f64::recip);
        let weighted = frames * &weights;
        let products = weighted.dot(&responses.at_candidates.t());
        let squares = (&responses.at_candidates * &responses.at_candidates).dot(&weights);
        let shape = products.dim();
        Self {
            squares: Array2::from_shape_fn(shape, |(_, c)| squares[c]),
            variances: Array2::from_shape_fn(shape, |(_, c)| geometry.variance[c]),
            wholes: (&weighted * frames).sum_axis(Axis(1)),
            products: products.mapv_into(|product| product.max(0.0)),
            channels: frames.ncols() as f64,
        }
    }

    /// Of some of the learnt frames, each by a process from which it is left out; gains, amplitudes and variances of
    /// channels remain those of all presses. In closed form: without press `i`,
    ///
    /// ```text
    /// r_c - u_ci w_i / (K^-1)_ii,   variance + u_ci^2 / (K^-1)_ii,   u = k' K^-1,  w: weights of the process
    /// ```
    ///
    /// Source: Rasmussen, Williams (2006), section 5.4.2.
    pub(super) fn left_out(
        geometry: &Geometry,
        responses: &Responses,
        frames: &Array2<f64>,
        which: &[usize],
    ) -> Self {
        let frames = &frames.select(Axis(0), which);
        let of_process = &responses.weights.select(Axis(0), which);
        let mut made = Self::new(geometry, responses, frames);
        let weights = responses.channel_variance.mapv(f64::recip);
        let weighted = frames * &weights;
        let of_press = of_process * &weights;
        let across = of_press.dot(&responses.at_candidates.t());
        let raw = weighted.dot(&responses.at_candidates.t());
        for (i, &press) in which.iter().enumerate() {
            let own = geometry.inverse[[press, press]];
            let with_frame = weighted.row(i).dot(&of_process.row(i));
            let with_self = of_press.row(i).dot(&of_process.row(i));
            for c in 0..geometry.known.nrows() {
                let known = geometry.known[[c, press]];
                let part = known / own;
                made.products[[i, c]] = (raw[[i, c]] - part * with_frame).max(0.0);
                let square = made.squares[[i, c]] - 2.0 * part * across[[i, c]];
                made.squares[[i, c]] = (square + part * part * with_self).max(0.0);
                made.variances[[i, c]] += known * part;
            }
        }
        made
    }

    /// Misfit of each frame at each candidate, including the log-determinant term, `[frame, candidate]`.
    pub(super) fn misfits(&self) -> Array2<f64> {
        Array2::from_shape_fn(self.products.dim(), |(i, c)| {
            let (product, square) = (self.products[[i, c]], self.squares[[i, c]]);
            let rest =
                (self.wholes[i] - product * product / square.max(f64::MIN_POSITIVE)).max(0.0);
            let variance = self.variances[[i, c]];
            rest / variance + self.channels * variance.ln()
        })
    }

    /// Fraction of each frame that remains unexplained at the best candidate.
    pub(super) fn rests(&self) -> Vec<f64> {
        let best = |i: usize| {
            let explained = self.products.row(i).into_iter().zip(self.squares.row(i));
            explained.map(|(p, s)| p.powi(2) / s.max(f64::MIN_POSITIVE)).fold(0.0, f64::max)
        };
        let rest = |i: usize| 1.0 - (best(i) / self.wholes[i].max(f64::MIN_POSITIVE)).min(1.0);
        (0..self.wholes.len()).map(rest).collect()
    }
}
