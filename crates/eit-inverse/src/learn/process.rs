//! A Gaussian process over places of which all channels share the kernel, with a mean per channel: a gain times the
//! model's response.
//!
//! ```text
//! u_i = g * m(p_i) + f(p_i) + e_i       *: by channel;  u, m of length about 1
//! cov f(p), f(q) = 0.3 + exp(-|p - q|^2 / 2 l^2) + 0.1 [same session],   var e_i = eta (1 + kappa r_i) / (1 + kappa)
//! ```
//!
//! `r_i` is the squared ratio of a typical press to this one: a weak press is relatively noisier. With `A` the inverse of
//! the covariance of the presses and `k(x)` those to a place, a set `b` of presses is left out in closed form:
//!
//! ```text
//! f(x) = k' A r,     f without b (x) = f(x) - (k' A)_b A_bb^-1 (A r)_b,     v without b = v + (k' A)_b A_bb^-1 (A k)_b
//! r_b - f without b (p_b) = A_bb^-1 (A r)_b,                                  of covariance A_bb^-1
//! ```
//!
//! Source: Rasmussen, Williams, *Gaussian Processes for Machine Learning* (2006), sections 2.2, 2.7 and 5.4.2.

use super::linear::{inverse, product};
use super::presses::Presses;
use crate::InverseError;
use ndarray::{Array1, Array2, ArrayRef2, Axis};

/// Variance of what all places of a channel have in common, relative to that of the process. A first guess, not varied.
const COMMON: f64 = 0.3;
/// Variance of a channel's drift between sessions, likewise: on two hydrogel skins, 0.05 to 0.25 gave errors within 5 %
/// of each other.
const SESSION: f64 = 0.1;

/// Kernel of a process: its length, metres, and the noise of presses, see above.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Kernel {
    pub(super) length_m: f64,
    pub(super) noise: f64,
    pub(super) weak: f64,
}

/// Inverse covariance of presses.
#[derive(Debug, Clone)]
pub(super) struct Process {
    kernel: Kernel,
    pub(super) inverse: Array2<f64>,
    drift: f64,
}

impl Kernel {
    /// Variance of the noise of a press whose typical one is `relative2` times as strong, squared.
    fn noise_of(&self, relative2: f64) -> f64 {
        self.noise * (1.0 + self.weak * relative2) / (1.0 + self.weak)
    }

    fn between(&self, p: &[f64; 3], q: &[f64; 3]) -> f64 {
        let squared: f64 = p.iter().zip(q).map(|(a, b)| (a - b).powi(2)).sum();
        COMMON + (-0.5 * squared / (self.length_m * self.length_m)).exp()
    }
}

impl Process {
    pub(super) fn new(
        presses: &Presses,
        relative2: &[f64],
        kernel: Kernel,
    ) -> Result<Self, InverseError> {
        let places_m = &presses.places_m;
        let drift = if presses.has_sessions() { SESSION } else { 0.0 };
        let covariance = Array2::from_shape_fn((places_m.len(), places_m.len()), |(i, j)| {
            let is_same = presses.session(i) == presses.session(j);
            let own = if i == j { kernel.noise_of(relative2[i]) } else { 0.0 };
            kernel.between(&places_m[i], &places_m[j]) + own + if is_same { drift } else { 0.0 }
        });
        Ok(Self { kernel, drift, inverse: inverse(&covariance, "kernel of presses")? })
    }

    /// Weight of each press at places of the latest session, `k' A`, `[place, press]`, and the variance there of a
    /// typical press.
    pub(super) fn at(
        &self,
        presses: &Presses,
        places_m: &[[f64; 3]],
    ) -> (Array2<f64>, Array1<f64>) {
        let latest = presses.latest();
        let to_places =
            Array2::from_shape_fn((places_m.len(), presses.places_m.len()), |(at, press)| {
                let is_same = presses.session(press) == latest;
                self.kernel.between(&places_m[at], &presses.places_m[press])
                    + if is_same { self.drift } else { 0.0 }
            });
        let known = product(&to_places, &self.inverse);
        let prior = 1.0 + COMMON + self.drift;
        let explained = known.rows().into_iter().zip(to_places.rows());
        let variance = explained
            .map(|(known, kernel)| {
                self.kernel.noise_of(1.0) + (prior - known.dot(&kernel)).max(0.0)
            })
            .collect();
        (known, variance)
    }

    /// `A_bb^-1` of some presses.
    ///
    /// # Errors
    /// [`InverseError::Factorisation`].
    pub(super) fn left_out(&self, which: &[usize]) -> Result<Array2<f64>, InverseError> {
        let own = self.inverse.select(Axis(0), which).select(Axis(1), which);
        if let [only] = which {
            return Ok(Array2::from_elem((1, 1), self.inverse[[*only, *only]].recip()));
        }
        inverse(&own, "presses left out")
    }
}

/// Gain of each channel: a ridge regression toward the common gain. `products` and `squares` are sums over presses of
/// response times model and of model times model; `pull` is in units of the mean of the latter.
pub(super) fn gain(
    products: &Array1<f64>,
    squares: &Array1<f64>,
    pull: f64,
    is_common_positive: bool,
) -> Array1<f64> {
    let common = products.sum() / squares.sum().max(f64::MIN_POSITIVE);
    let common = if is_common_positive { common.max(0.0) } else { common };
    let ridge = (pull * squares.mean().unwrap_or(0.0)).max(f64::MIN_POSITIVE);
    (products + ridge * common) / (squares + ridge)
}

/// Sums over presses that gains need, and the same of one fold.
pub(super) struct GainSums {
    products: Array1<f64>,
    squares: Array1<f64>,
}

impl GainSums {
    pub(super) fn new(shapes: &ArrayRef2<f64>, model: &ArrayRef2<f64>) -> Self {
        let of = |a: &ArrayRef2<f64>, b: &ArrayRef2<f64>| (a * b).sum_axis(Axis(0));
        Self { products: of(shapes, model), squares: of(model, model) }
    }

    /// Gains without the presses of a fold; zeros without a pull, which leaves out the model.
    pub(super) fn without(
        &self,
        shapes: &Array2<f64>,
        model: &Array2<f64>,
        fold: &[usize],
        pull: Option<f64>,
    ) -> Array1<f64> {
        let Some(pull) = pull else { return Array1::zeros(self.products.len()) };
        let [shapes, model] = [shapes, model].map(|rows| rows.select(Axis(0), fold));
        let of_fold = Self::new(&shapes, &model);
        let (products, squares) =
            (&self.products - &of_fold.products, &self.squares - &of_fold.squares);
        gain(&products, &squares, pull, false)
    }
}
