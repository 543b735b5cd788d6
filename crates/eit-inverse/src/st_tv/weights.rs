//! Choice of the weights from the noise level.
//!
//! Over 300 lines because start, search and refinement share the path of trial solves.

use super::laplacian::SIDES;
use super::run::Run;
use super::settings::Weights;
use super::state::{SPAN, State};
use super::task::Task;
use super::{Fidelity, StTv, Stop};
use crate::check::{check_positive, check_range};
use crate::{DifferenceFrames, InverseError, SequenceStatus};
use ndarray::Axis;
use std::time::Instant;

/// Number of frames used for the choice, as many as share their steps.
const SAMPLE: usize = SPAN;
/// Target gap of the first trial, far from the weight sought, and of the later ones. The residual converges
/// long before the objective, but near the noise level it changes by only a tenth for a factor of e in the
/// weight: a gap of 0.1 in all trials gave weights up to 1.4 times too small, and 0.015 up to 1.2 times. A gap of 0.03
/// was enough when bounds were worse than images.
const FIRST_GAP: f64 = 1e-1;
const TRIAL_GAP: f64 = 1e-2;
/// Model of the residual at weights that explain the data, `residual^2 = floor + (scale lambda)^power`. The
/// power is that of the reference problems (1.29 over a factor of 60), the floor is a first guess: the share of
/// the noise that images do not fit.
const POWER: f64 = 1.3;
const NOISE_FLOOR: f64 = 0.85;
/// Largest floor that follows the model. Above it, the data is not explained, and the search goes on in
/// steps, because the corner of the L-curve may be needed.
const LARGEST_FLOOR: f64 = 0.97;
/// Largest factor of a step by the model.
const LARGEST_STEP: f64 = 256.0;
/// Factor between trial weights until the crossing is bracketed, and maximum number of trials.
const STRIDE: f64 = 4.0;
const TRIALS: usize = 8;
/// Slope of log residual over log weight below which the residual counts as flat: a tenth for a factor
/// of 4 in the weight.
const FLAT: f64 = 0.075;
/// Least factor between two weights whose residuals show that it is flat.
const FLAT_OVER: f64 = 8.0;
/// Accuracy of the logarithm of the weight, a tenth, and maximum number of trials that refine a bracket.
const ACCURACY: f64 = 0.09;
const REFINEMENTS: usize = 6;
/// Maximum number of iterations of a trial.
const TRIAL_ITERATIONS: usize = 2000;

/// Outcome of a choice of weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum WeightStatus {
    /// The residual equals the noise level.
    Reached,
    /// The residual becomes flat before it reaches the noise level. The remainder is a model error (for
    /// example moved electrodes), which smaller weights would fit with artefacts. The weight is the
    /// corner of the L-curve, where the flat part begins.
    Flattened,
    /// Even the smallest trial weights leave a residual above the noise level: the model does not explain
    /// the data, or the noise is larger than specified.
    AtLowerEdge,
    /// Even the largest trial weights explain the data: it contains only noise, or the noise is smaller
    /// than specified.
    AtUpperEdge,
}

/// One trial of the choice of weights.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct WeightPoint {
    /// Trial weight.
    pub lambda_space: f64,
    /// Root mean square residual over channels and frames, in units of the noise.
    pub residual_norm: f64,
    /// `sum_t |grad x_t|_{2,1} + (lambda_time / lambda_space) sum_t |x_{t+1} - x_t|_1`, S m.
    pub variation: f64,
}

/// Weights chosen by the discrepancy principle.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct ChosenWeights {
    /// Spatial weight.
    pub lambda_space: f64,
    /// Temporal weight.
    pub lambda_time: f64,
    /// Root mean square residual at these weights, in units of the noise; the target is 1.
    pub residual: f64,
    /// Outcome of the choice.
    pub status: WeightStatus,
    /// All trials, in order of ascending weight.
    pub curve: Vec<WeightPoint>,
    /// `lambda_space` at the corner of the L-curve of the trials, as a check; `None` if the curve has
    /// no convex corner.
    pub corner: Option<f64>,
    /// Number of iterations of all trials.
    pub iterations: usize,
    /// Run time, seconds.
    pub seconds: f64,
}

impl StTv {
    /// Chooses and sets the weights of the penalised form by the discrepancy principle.
    ///
    /// These are the largest weights whose images explain the data to within the noise:
    /// `sum |W^1/2 (J x - dv)|^2` = number of good channels. `lambda_time = lambda_space / length_m`,
    /// so that for a pixel of edge length `length_m` a temporal change costs as much as an equal jump
    /// across one of its edges (if `lambda_time` is currently 0, it stays 0).
    ///
    /// If, between the corner of the L-curve and the noise level, the residual falls by less than a
    /// tenth per factor of 4 in the weight, the model does not explain the data, and the weight of the
    /// corner is used instead ([`WeightStatus::Flattened`]).
    ///
    /// Uses the 8 consecutive frames with the strongest signal and about four solves of low accuracy,
    /// each of which starts from the images and duals of the one before. The search starts at the weight
    /// at which the dual of the gradient can just balance the noise, and continues where a model of the
    /// residual predicts the noise level; if the residual does not follow that model, by factors of 4.
    ///
    /// # Errors
    /// The errors of [`StTv::solve`]; [`InverseError::OutOfRange`] without `noise_std` or for a length
    /// that is not positive.
    pub fn choose_weights(
        &mut self,
        frames: &DifferenceFrames<'_>,
        length_m: f64,
    ) -> Result<ChosenWeights, InverseError> {
        let start = Instant::now();
        check_positive("length_m", length_m)?;
        frames.check(self.measurements())?;
        check_range("noise_std", f64::NAN, self.settings.noise_std.is_some(), "given")?;
        let sample = self.sample(frames);
        let values = frames.values.slice_axis(Axis(0), sample.clone().into());
        let good = frames.good.as_ref().map(|good| good.slice_axis(Axis(0), sample.into()));
        let sample = DifferenceFrames { values, good };
        let linked = self.settings.lambda_time > 0.0;
        let ratio = if linked { 1.0 / length_m } else { 0.0 };
        let curve = Vec::new();
        let mut trial = Trial { solver: self, sample, ratio, curve, iterations: 0, last: None };
        let (found, status) = trial.search()?;
        let Trial { mut curve, iterations, .. } = trial;
        curve.sort_by(|a, b| a.lambda_space.total_cmp(&b.lambda_space));
        let corner = corner(&curve);
        let (found, status) = match (status, flattened(&curve, corner, found.lambda_space)) {
            (WeightStatus::Reached, Some(corner)) => (corner, WeightStatus::Flattened),
            (status, _) => (found, status),
        };
        let WeightPoint { lambda_space, residual_norm: residual, .. } = found;
        let lambda_time = ratio * lambda_space;
        self.set_weights(lambda_space, lambda_time, Fidelity::Penalised)?;
        let seconds = start.elapsed().as_secs_f64();
        Ok(ChosenWeights {
            lambda_space,
            lambda_time,
            residual,
            status,
            curve,
            corner,
            iterations,
            seconds,
        })
    }

    /// Returns the consecutive frames with the strongest signal.
    fn sample(&self, frames: &DifferenceFrames<'_>) -> std::ops::Range<usize> {
        let count = frames.values.nrows();
        let power = |frame: usize| self.whitened(frames, frame).map(|v| v.powi(2)).sum();
        let powers: Vec<f64> = (0..count).map(power).collect();
        let length = SAMPLE.min(count);
        let sum = |first: usize| powers[first..first + length].iter().sum::<f64>();
        let best = (0..=count - length).max_by(|&a, &b| sum(a).total_cmp(&sum(b)));
        let first = best.unwrap_or(0);
        first..first + length
    }

    /// Returns the root mean square over the groups of the smallest flow that balances unit noise:
    /// `sqrt(sum_k s_k^2 v_k' L^+ v_k / groups)`, in the caller's units.
    fn weight_of_noise(&self) -> f64 {
        let (basis, parts) = (&self.compression.basis, &self.skin.parts);
        let (ops, zeros) = (&self.skin.operators, vec![[0.0; SIDES]; self.unknowns()]);
        let (mut solution, mut work) = (zeros.clone(), zeros);
        // without the mean on each part, which no flow can balance
        let varying = |p: usize, k: usize| {
            let part = parts.label[p] as usize;
            basis[(p, k)] - parts.sensitivity[part][k] / parts.sizes[part]
        };
        let mut sum = 0.0;
        for first in (0..ops.rank).step_by(SIDES) {
            let known = SIDES.min(ops.rank - first);
            for (p, row) in solution.iter_mut().enumerate() {
                *row = std::array::from_fn(|l| if l < known { varying(p, first + l) } else { 0.0 });
            }
            self.skin.laplacian.solve(&mut solution, &mut work);
            for l in 0..known {
                // the constant of the solution on a part has no effect, as the right-hand side has mean 0
                let rows = solution.iter().enumerate();
                let energy: f64 = rows.map(|(p, row)| row[l] * varying(p, first + l)).sum();
                sum += self.compression.singular[first + l].powi(2) * energy.max(0.0);
            }
        }
        let groups = self.gradient.groups().max(1) as f64;
        self.unit * (sum / groups).sqrt() / ops.mean_radius
    }
}

/// Search for the weight.
struct Trial<'a> {
    solver: &'a StTv,
    sample: DifferenceFrames<'a>,
    ratio: f64,
    curve: Vec<WeightPoint>,
    iterations: usize,
    /// Images and duals of the last trial, and its weight.
    last: Option<(State<f32>, f64)>,
}

impl Trial<'_> {
    fn search(&mut self) -> Result<(WeightPoint, WeightStatus), InverseError> {
        let guess = self.solver.weight_of_noise();
        let guess = if guess > 0.0 && guess.is_finite() { guess } else { self.solver.unit };
        let first = self.solve(guess)?;
        let up = first.residual_norm < 1.0;
        if !up && let Some(found) = self.follow_model(first)? {
            return Ok((found, WeightStatus::Reached));
        }
        let mut other = first;
        for _ in 0..TRIALS {
            let last = other.lambda_space;
            let found = other;
            other = self.solve(if up { last * STRIDE } else { last / STRIDE })?;
            if (other.residual_norm < 1.0) != up {
                let (low, high) = if up { (found, other) } else { (other, found) };
                return self.refine(low, high);
            }
        }
        let status = if up { WeightStatus::AtUpperEdge } else { WeightStatus::AtLowerEdge };
        Ok((other, status))
    }

    /// Steps to the crossing that the model of the residual predicts, with a floor that follows the trials;
    /// `None` if the residual does not follow the model.
    fn follow_model(&mut self, first: WeightPoint) -> Result<Option<WeightPoint>, InverseError> {
        let square = |point: WeightPoint| point.residual_norm.powi(2);
        let (mut last, mut floor) = (first, NOISE_FLOOR);
        let (mut low, mut high) = (None, first.lambda_space);
        for _ in 0..REFINEMENTS {
            let drop = (1.0 - floor) / (square(last) - floor);
            let step = drop.powf(1.0 / POWER).clamp(1.0 / LARGEST_STEP, LARGEST_STEP);
            let crossing = last.lambda_space * step;
            let mut aim = crossing * (-0.5 * ACCURACY).exp();
            if let Some(WeightPoint { lambda_space: least, .. }) = low {
                if crossing.min(high) <= least * ACCURACY.exp() {
                    break;
                }
                if !(least < aim && aim < high) {
                    aim = (least * high).sqrt();
                }
            }
            last = self.solve(aim)?;
            if last.residual_norm < 1.0 {
                low = Some(last);
            } else {
                high = last.lambda_space;
            }
            let rise = (first.lambda_space / last.lambda_space).powf(POWER) - 1.0;
            floor = square(last) - (square(first) - square(last)) / rise;
            if !floor.is_finite() || floor > LARGEST_FLOOR {
                return Ok(None);
            }
        }
        Ok(low)
    }

    /// Narrows the interval between a weight that explains the data and one that does not, by the secant
    /// of the logarithms: trials aim at half the accuracy below the crossing.
    fn refine(
        &mut self,
        mut low: WeightPoint,
        mut high: WeightPoint,
    ) -> Result<(WeightPoint, WeightStatus), InverseError> {
        for trial in 0..REFINEMENTS {
            let width = (high.lambda_space / low.lambda_space).ln();
            let rise = (high.residual_norm / low.residual_norm).ln();
            let crossing = -low.residual_norm.ln() / rise * width;
            if width <= ACCURACY || crossing <= ACCURACY {
                break;
            }
            let aim = crossing - 0.5 * ACCURACY;
            // a secant that keeps one end for ever would narrow the interval from one side only; a residual of
            // zero has no logarithm
            let is_lopsided = trial % 2 == 1 && !(0.25..=0.75).contains(&(aim / width));
            let aim = if is_lopsided || !aim.is_finite() { 0.5 * width } else { aim };
            let middle = self.solve(low.lambda_space * aim.exp())?;
            if middle.residual_norm < 1.0 {
                low = middle;
            } else {
                high = middle;
            }
        }
        Ok((low, WeightStatus::Reached))
    }

    /// Solves with a trial weight at low accuracy, in `f32`.
    fn solve(&mut self, lambda_space: f64) -> Result<WeightPoint, InverseError> {
        let lambda_time = self.ratio * lambda_space;
        let weights = Weights { lambda_space, lambda_time, fidelity: Fidelity::Penalised };
        let task = Task::new(self.solver, weights, &self.sample)?;
        let start = Instant::now();
        let sequence = if task.is_zero {
            task.nothing(start)
        } else {
            let target_gap = if self.last.is_some() { TRIAL_GAP } else { FIRST_GAP };
            let mut run = Run::new(&task, &self.solver.single, target_gap, start)?;
            if let Some((state, weight)) = &self.last {
                run.start_from(state, lambda_space / weight)?;
            }
            let stop = Stop { target_gap, ..Default::default() };
            let status = run.advance(&stop, TRIAL_ITERATIONS)?;
            self.last = Some((run.state().clone(), lambda_space));
            run.finish(status.unwrap_or(SequenceStatus::IterationCap))
        };
        let good = (0..self.sample.values.nrows())
            .map(|f| self.solver.whitened(&self.sample, f).count())
            .sum::<usize>();
        let square: f64 = sequence.report.residual.iter().map(|r| r * r).sum();
        let residual_norm = (square / good.max(1) as f64).sqrt();
        let primal = sequence.report.certificate.map_or(f64::NAN, |c| c.primal);
        let variation = ((primal - 0.5 * square) / lambda_space).max(0.0);
        let point = WeightPoint { lambda_space, residual_norm, variation };
        self.iterations += sequence.report.iterations;
        self.curve.push(point);
        Ok(point)
    }
}

/// Returns the corner if it lies far above the weight found and the residual is flat between the two.
fn flattened(curve: &[WeightPoint], corner: Option<f64>, found: f64) -> Option<WeightPoint> {
    let at = |lambda: f64| curve.iter().find(|point| point.lambda_space == lambda);
    let (corner, found) = (at(corner?)?, at(found)?);
    let ratio = corner.lambda_space / found.lambda_space;
    let slope = (corner.residual_norm / found.residual_norm).ln() / ratio.ln();
    (ratio >= FLAT_OVER && slope < FLAT).then_some(*corner)
}

/// Returns the weight at which the curve `(log residual, log variation)` turns most, if it has a convex
/// corner.
fn corner(curve: &[WeightPoint]) -> Option<f64> {
    let points: Vec<[f64; 3]> = curve
        .iter()
        .filter(|p| p.residual_norm > 0.0 && p.variation > 0.0)
        .map(|p| [p.residual_norm.ln(), p.variation.ln(), p.lambda_space])
        .collect();
    let turn = |w: &[[f64; 3]]| {
        let (a, b) =
            ([w[1][0] - w[0][0], w[1][1] - w[0][1]], [w[2][0] - w[1][0], w[2][1] - w[1][1]]);
        let cross = a[0] * b[1] - a[1] * b[0];
        (cross.atan2(a[0] * b[0] + a[1] * b[1]), w[1][2])
    };
    let turns = points.windows(3).map(turn).filter(|t| t.0 > 0.0);
    turns.max_by(|a, b| a.0.total_cmp(&b.0)).map(|t| t.1)
}
