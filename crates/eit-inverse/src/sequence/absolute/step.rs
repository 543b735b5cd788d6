//! Minimisation of one frame's objective by Gauss-Newton steps in measurement space with a line
//! search, see [`AbsoluteGaussNewton`].

use super::{AbsoluteFrameReport, AbsoluteGaussNewton, dot};
use crate::one_step::{covariance_times, gram, weighted_rows};
use crate::{InverseError, SequenceStatus};
use faer::prelude::Solve;
use faer::{Col, ColRef, MatRef, Side};

/// Sufficient decrease as a fraction of the decrease predicted by the slope (Armijo 1966; Nocedal,
/// Wright, *Numerical Optimization* (2006), section 3.1, suggest 1e-4).
const ARMIJO: f64 = 1e-4;

/// Maximum number of halvings of a step; shorter steps do not change the forward solution.
const MAX_HALVINGS: i32 = 30;

/// An image with its residual and objective.
#[derive(Debug, Clone)]
pub(super) struct Point {
    /// Unknowns, siemens, `[element]`.
    pub(super) x: Vec<f64>,
    /// `R x`.
    precision_x: Vec<f64>,
    /// `W^1/2 (F(sigma_ref) + dv - F(sigma))`, `[used]`, zero where masked.
    pub(super) residual: Vec<f64>,
    objective: f64,
}

/// A Gauss-Newton step.
struct Step {
    x: Vec<f64>,
    precision_x: Vec<f64>,
    /// Decrease of the linearised objective; its slope is minus twice this value.
    predicted: f64,
}

/// A frame's data.
pub(super) struct FrameData<'a> {
    /// `W^1/2 dv`, `[used]`, zero where masked.
    pub(super) whitened: &'a [f64],
    /// Masked indices into the used measurements.
    pub(super) masked: &'a [usize],
}

impl AbsoluteGaussNewton<'_> {
    /// Returns the conductivities for unknowns `x`, siemens.
    pub(super) fn conductivity(&self, x: &[f64]) -> Vec<f64> {
        self.map.iter().zip(x).map(|(map, &x)| map.at(x)[0]).collect()
    }

    /// Evaluates the objective.
    fn point(
        &mut self,
        x: Vec<f64>,
        precision_x: Vec<f64>,
        data: &FrameData<'_>,
    ) -> Result<Point, InverseError> {
        let conductivity = self.conductivity(&x);
        let solution = self.model.solve(&conductivity, &mut self.workspace)?;
        solution.measurements_into(&mut self.voltages_v)?;
        let mut residual = data.whitened.to_vec();
        for (k, (r, &i)) in residual.iter_mut().zip(&self.channels.used).enumerate() {
            *r -= self.channels.row_factor(k) * (self.voltages_v[i] - self.reference_v[i]);
        }
        data.masked.iter().for_each(|&k| residual[k] = 0.0);
        // |x|_R^2 is a sum of squares; a negative value is rounding error
        let objective =
            dot(&residual, &residual) + self.noise_variance * dot(&x, &precision_x).max(0.0);
        Ok(Point { x, precision_x, residual, objective })
    }

    /// Computes the Gauss-Newton step from a point; returns `None` if the factorisation fails or the
    /// step is not finite.
    fn step(&mut self, from: &Point, masked: &[usize]) -> Result<Option<Step>, InverseError> {
        let (conductivity, slopes): (Vec<f64>, Vec<f64>) =
            self.map.iter().zip(&from.x).map(|(map, &x)| map.at(x).into()).unzip();
        let mut solution = self.model.solve(&conductivity, &mut self.workspace)?;
        solution.jacobian_into(self.jacobian.view_mut())?;
        let elements = from.x.len();
        let mut weighted = weighted_rows(&self.jacobian, &self.channels)?;
        for (k, row) in weighted.chunks_exact_mut(elements).enumerate() {
            let good = if masked.binary_search(&k).is_ok() { 0.0 } else { 1.0 };
            row.iter_mut().zip(&slopes).for_each(|(j, slope)| *j *= good * slope);
        }
        let covariance = covariance_times(self.prior, &weighted, elements)?;
        let used = self.channels.used.len();
        let jacobian = MatRef::from_row_major_slice(&weighted, used, elements);
        let covariance = MatRef::from_row_major_slice(&covariance, used, elements);
        // J P J' + mu I
        let mut gram = gram(covariance, jacobian);
        (0..gram.nrows()).for_each(|i| gram[(i, i)] += self.noise_variance);
        let Ok(factor) = gram.llt(Side::Lower) else {
            return Ok(None);
        };
        let z = factor.solve(jacobian * ColRef::from_slice(&from.x) + column(&from.residual));
        let minus = |to: Col<f64>, from: &[f64]| -> Vec<f64> {
            to.iter().zip(from).map(|(to, from)| to - from).collect()
        };
        let x = minus(covariance.transpose() * &z, &from.x);
        let precision_x = minus(jacobian.transpose() * &z, &from.precision_x);
        let sensed = jacobian * ColRef::from_slice(&x);
        let predicted =
            sensed.squared_norm_l2() + self.noise_variance * dot(&x, &precision_x).max(0.0);
        Ok(predicted.is_finite().then_some(Step { x, precision_x, predicted }))
    }

    /// Returns the first point along a step with a sufficient decrease of the objective, and the
    /// number of forward solutions.
    fn search(
        &mut self,
        from: &Point,
        step: &Step,
        data: &FrameData<'_>,
    ) -> (Option<Point>, usize) {
        let along =
            |a: &[f64], b: &[f64], t: f64| a.iter().zip(b).map(|(a, b)| a + t * b).collect();
        for halvings in 0..=MAX_HALVINGS {
            let t = 0.5_f64.powi(halvings);
            let x = along(&from.x, &step.x, t);
            let precision_x = along(&from.precision_x, &step.precision_x, t);
            let wanted = from.objective - 2.0 * ARMIJO * t * step.predicted;
            // an error of the forward model counts as a step that is too long
            match self.point(x, precision_x, data) {
                Ok(point) if point.objective <= wanted => {
                    return (Some(point), halvings as usize + 1);
                }
                _ => {}
            }
        }
        (None, MAX_HALVINGS as usize + 1)
    }

    /// Returns the better start of the reference and the previous image, and the number of forward
    /// solutions.
    fn start(
        &mut self,
        before: Option<&Point>,
        data: &FrameData<'_>,
    ) -> Result<(Point, usize), InverseError> {
        let zero = vec![0.0; self.map.len()];
        // at the reference the residual is the data, so no forward solution is needed
        let point = Point {
            x: zero.clone(),
            precision_x: zero,
            residual: data.whitened.to_vec(),
            objective: dot(data.whitened, data.whitened),
        };
        let Some(before) = before else { return Ok((point, 0)) };
        let warm = self.point(before.x.clone(), before.precision_x.clone(), data)?;
        Ok((if warm.objective < point.objective { warm } else { point }, 1))
    }

    /// Minimises one frame's objective.
    pub(super) fn frame(
        &mut self,
        before: Option<&Point>,
        data: &FrameData<'_>,
    ) -> Result<(Point, AbsoluteFrameReport), InverseError> {
        let (mut point, mut forward_solves) = self.start(before, data)?;
        let (tolerance, cap) = (self.settings.relative_decrease, self.settings.max_iterations);
        let mut objective = vec![point.objective];
        let mut predicted_decrease = 0.0;
        let mut status = SequenceStatus::IterationCap;
        while objective.len() <= cap {
            forward_solves += 1;
            let Some(step) = self.step(&point, data.masked)? else {
                status = SequenceStatus::Stalled;
                break;
            };
            let last = point.objective;
            predicted_decrease = if last > 0.0 { step.predicted / last } else { 0.0 };
            if predicted_decrease <= tolerance {
                status = SequenceStatus::Converged;
                break;
            }
            let (found, solves) = self.search(&point, &step, data);
            forward_solves += solves;
            let Some(found) = found else {
                status = SequenceStatus::Stalled;
                break;
            };
            point = found;
            objective.push(point.objective);
            if last - point.objective <= tolerance * last {
                status = SequenceStatus::Converged;
                break;
            }
        }
        let iterations = objective.len() - 1;
        let report = AbsoluteFrameReport {
            status,
            iterations,
            forward_solves,
            objective,
            predicted_decrease,
        };
        Ok((point, report))
    }
}

fn column(values: &[f64]) -> ColRef<'_, f64> {
    ColRef::from_slice(values)
}
