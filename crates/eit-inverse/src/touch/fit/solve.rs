//! The Levenberg-Marquardt iteration.
//!
//! Source: Marquardt, *J. SIAM* 11 (1963), 431-441; damping by Nielsen (Madsen, Nielsen, Tingleff,
//! *Methods for Non-Linear Least Squares Problems* (2004), algorithm 3.16).
//!
//! `fit_whitened` is longer than other functions: the iteration is one piece of state.

use super::problem::{inverse_information, scaled_gram};
use super::{FitResult, FitSettings, FitStatus, FittedTouch, Parameters, TouchFit};
use crate::InverseError;
use crate::touch::bell::Bell;
use faer::prelude::Solve;
use faer::{ColRef, Mat, Side};
use ndarray::Array2;
use std::time::Instant;

/// Damping of the first step, relative to the diagonal.
const FIRST_DAMPING: f64 = 1e-3;

/// Damping beyond which no step is tried: the step would be lost in rounding.
const LAST_DAMPING: f64 = 1e12;

/// Longest step of a centre in radii of its bell, and of the logarithm of a radius: beyond it the
/// linearisation does not hold.
const LONGEST: f64 = 1.0;

/// Least strength of a valid touch in its standard deviations.
const SIGNIFICANT: f64 = 3.0;

impl TouchFit<'_> {
    /// Unknown parameters of each bell.
    pub(super) fn parameters(&self) -> Parameters {
        Parameters { amplitude: true, radius: self.settings.fit_radius }
    }

    /// Fits data given in units of the noise.
    pub(super) fn fit_whitened(
        &mut self,
        data: &[f64],
        starts: &[Bell],
    ) -> Result<FitResult, InverseError> {
        let begin = Instant::now();
        let solves = self.problem.solves;
        let parameters = self.parameters();
        let unknowns = parameters.count() * starts.len();
        if unknowns > data.len() {
            let (quantity, must) =
                ("number of touch parameters", "at most the number of used measurements");
            return Err(InverseError::OutOfRange { quantity, value: unknowns as f64, must });
        }
        let mut bells = self.check_starts(starts)?;
        let without: f64 = data.iter().map(|x| x * x).sum();
        let Some(mut residual) = self.problem.residuals(data, &bells) else {
            let (quantity, must) =
                ("amplitude", "large enough that all touches together leave conductivity");
            let value = bells.iter().map(|b| b.amplitude).fold(f64::INFINITY, f64::min);
            return Err(InverseError::OutOfRange { quantity, value, must });
        };
        let mut chi_square = squares(&residual);
        let mut information = Array2::zeros((0, 0));
        let (mut damping, mut growth, mut iterations) = (FIRST_DAMPING, 2.0, 0);
        let mut status = FitStatus::IterationLimit;
        let mut derivative = None;
        if bells.is_empty() {
            status = FitStatus::Converged;
        }
        while !bells.is_empty() {
            let slopes = match derivative.take() {
                Some(slopes) => slopes,
                None => match self.problem.derivative(&bells, parameters)? {
                    Some(slopes) => slopes,
                    // residuals exist here, so derivatives do too
                    None => break,
                },
            };
            let promised = step(&slopes, &residual, 0.0).map(|(_, promised)| promised);
            if promised.is_some_and(|promised| promised <= self.settings.tolerance) {
                status = FitStatus::Converged;
            } else if damping > LAST_DAMPING {
                status = FitStatus::Stalled;
            }
            let over = status != FitStatus::IterationLimit;
            if over || iterations == self.settings.max_iterations {
                information = inverse_information(slopes.as_ref());
                break;
            }
            iterations += 1;
            let trial = step(&slopes, &residual, damping).and_then(|(step, promised)| {
                let trial = self.moved(&bells, &step, parameters);
                let residual = self.problem.residuals(data, &trial)?;
                (squares(&residual) < chi_square).then_some((trial, residual, promised))
            });
            match trial {
                Some((trial, lower, promised)) => {
                    let gain = (chi_square - squares(&lower)) / promised;
                    (bells, residual) = (trial, lower);
                    chi_square = squares(&residual);
                    damping *= (1.0 - (2.0 * gain - 1.0).powi(3)).clamp(1.0 / 3.0, 2.0);
                    growth = 2.0;
                }
                None => {
                    damping *= growth;
                    growth *= 2.0;
                    derivative = Some(slopes);
                }
            }
        }
        let degrees = data.len() - unknowns;
        let scale = (chi_square / degrees.max(1) as f64).max(1.0);
        information.iter_mut().for_each(|x| *x *= scale);
        Ok(FitResult {
            touches: self.touches(&bells, &information, parameters),
            covariance: information,
            status,
            iterations,
            forward_solves: self.problem.solves - solves,
            chi_square,
            degrees_of_freedom: degrees,
            chi_square_without: without,
            seconds: begin.elapsed().as_secs_f64(),
        })
    }

    /// Checks the starts and projects them onto the skin.
    pub(in crate::touch) fn check_starts(
        &self,
        starts: &[Bell],
    ) -> Result<Vec<Bell>, InverseError> {
        let [least, largest] = self.settings.radius_range_m;
        let check = |(touch, start): (usize, &Bell)| {
            let out = |quantity, value, must| InverseError::OutOfRange { quantity, value, must };
            if !(least..=largest).contains(&start.radius_m) {
                return Err(out("radius_m", start.radius_m, "within radius_range_m"));
            }
            if !(start.amplitude > -1.0 && start.amplitude.is_finite() && start.amplitude != 0.0) {
                return Err(out("amplitude", start.amplitude, "finite, above -1 and not zero"));
            }
            if let Some(&x) = start.position_m.iter().find(|x| !x.is_finite()) {
                return Err(out("position_m", x, "finite"));
            }
            let place = self.problem.place(start.position_m);
            let (distance_m, limit_m) = (place.distance_m, start.radius_m);
            if distance_m > limit_m {
                let position_m = start.position_m;
                return Err(InverseError::OutsideSkin { touch, position_m, distance_m, limit_m });
            }
            Ok(Bell { position_m: place.position_m, ..*start })
        };
        starts.iter().enumerate().map(check).collect()
    }

    /// Returns the bells after a step, projected onto the skin and within the range of radii.
    fn moved(&self, bells: &[Bell], step: &[f64], parameters: Parameters) -> Vec<Bell> {
        let each = parameters.count();
        let move_one = |(bell, step): (&Bell, &[f64])| {
            let way = step[0].hypot(step[1]);
            let shorten = (LONGEST * bell.radius_m / way).min(1.0);
            let tangents = self.problem.place(bell.position_m).tangents;
            let to = std::array::from_fn(|i| {
                let along = step[0] * tangents[0][i] + step[1] * tangents[1][i];
                bell.position_m[i] + shorten * along
            });
            let [least, largest] = self.settings.radius_range_m;
            let grow = step.get(3).map_or(1.0, |x| x.clamp(-LONGEST, LONGEST).exp());
            Bell {
                position_m: self.problem.place(to).position_m,
                amplitude: bell.amplitude + step[2],
                radius_m: (bell.radius_m * grow).clamp(least, largest),
            }
        };
        bells.iter().zip(step.chunks_exact(each)).map(move_one).collect()
    }

    /// Combines the bells with their covariance.
    fn touches(
        &self,
        bells: &[Bell],
        covariance: &Array2<f64>,
        parameters: Parameters,
    ) -> Vec<FittedTouch> {
        let FitSettings { radius_range_m: [least, largest], max_position_std_m, .. } =
            self.settings;
        let of = |(k, bell): (usize, &Bell)| {
            let at = k * parameters.count();
            let plane = [0, 1].map(|i| [0, 1].map(|j| covariance[(at + i, at + j)]));
            let tangents = self.problem.place(bell.position_m).tangents;
            let amplitude_std = covariance[(at + 2, at + 2)].sqrt();
            let radius_std_m = match parameters.radius {
                true => bell.radius_m * covariance[(at + 3, at + 3)].sqrt(),
                false => 0.0,
            };
            // for the strength a r^2, since amplitude and radius of a small touch are nearly one parameter
            let slopes = [1.0 / bell.amplitude, 2.0];
            let unknowns = parameters.count() - 2;
            let mut variance = 0.0;
            for (i, a) in slopes.iter().take(unknowns).enumerate() {
                for (j, b) in slopes.iter().take(unknowns).enumerate() {
                    variance += a * b * covariance[(at + 2 + i, at + 2 + j)];
                }
            }
            let significance = variance.sqrt().recip();
            let spread = largest_eigenvalue(plane).sqrt();
            let free = !parameters.radius || (bell.radius_m > least && bell.radius_m < largest);
            FittedTouch {
                bell: *bell,
                position_covariance_m2: in_space(plane, tangents),
                amplitude_std,
                radius_std_m,
                confidence: libm::erf(significance / std::f64::consts::SQRT_2),
                valid: significance > SIGNIFICANT && spread <= max_position_std_m && free,
            }
        };
        bells.iter().enumerate().map(of).collect()
    }
}

/// Converts a covariance along two tangents into one in space.
pub(crate) fn in_space(plane: [[f64; 2]; 2], tangents: [[f64; 3]; 2]) -> [[f64; 3]; 3] {
    let mut space = [[0.0; 3]; 3];
    for (i, row) in space.iter_mut().enumerate() {
        for (j, value) in row.iter_mut().enumerate() {
            for a in 0..2 {
                for b in 0..2 {
                    let weight = tangents[a][i] * tangents[b][j];
                    // an infinite variance has no component across its direction
                    if weight != 0.0 && plane[a][b] != 0.0 {
                        *value += weight * plane[a][b];
                    }
                }
            }
        }
    }
    space
}

/// Returns the larger eigenvalue of a symmetric matrix.
pub(crate) fn largest_eigenvalue([[a, b], [_, d]]: [[f64; 2]; 2]) -> f64 {
    if a.is_infinite() || d.is_infinite() {
        return f64::INFINITY;
    }
    0.5 * (a + d) + (0.5 * (a - d)).hypot(b)
}

/// Computes the damped step and its predicted decrease of chi^2; `None` if rounding prevents a step.
fn step(slopes: &Mat<f64>, residual: &[f64], damping: f64) -> Option<(Vec<f64>, f64)> {
    let (mut gram, scales) = scaled_gram(slopes.as_ref());
    (0..gram.nrows()).for_each(|i| gram[(i, i)] += damping);
    let pull = slopes.transpose() * ColRef::from_slice(residual);
    let scaled = Mat::from_fn(scales.len(), 1, |i, _| scales[i] * pull[i]);
    let solution = gram.llt(Side::Lower).ok()?.solve(&scaled);
    // |r|^2 - |r - A s|^2 = s' (pull + damping s) in scaled unknowns
    let promised = (0..scales.len())
        .map(|i| solution[(i, 0)] * (scaled[(i, 0)] + damping * solution[(i, 0)]))
        .sum::<f64>();
    let step: Vec<f64> = (0..scales.len()).map(|i| scales[i] * solution[(i, 0)]).collect();
    (promised.is_finite() && step.iter().all(|x| x.is_finite())).then_some((step, promised))
}

fn squares(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum()
}
