//! Minimisation of a calibration.
//!
//! One file over 300 lines: model, objective and step share the state of one fit.

use super::{Calibration, CalibrationSettings, CalibrationStatus, Contacts};
use crate::check::check_length;
use crate::data::Channels;
use crate::{DifferenceData, InverseError};
use eit_core::event;
use eit_fem::{ForwardModel, Geometry, Workspace};
use faer::prelude::Solve;
use faer::{Mat, Side};
use ndarray::Array2;

/// Accuracy of the voltages relative to the largest: far below any noise, and within reach of nodal
/// assembly for all but stiff contacts. Residuals relative to the frame that are smaller count as this much.
const ACCURACY: f64 = 1e-8;

/// Convergence threshold: squared length of a step in units of the standard deviations.
const SMALLEST_STEP: f64 = 1e-6;

/// Largest change of a logarithm in one step: a factor of seven.
const LONGEST_STEP: f64 = 2.0;

/// First damping after an undamped step was rejected; it grows tenfold each time.
const FIRST_DAMPING: f64 = 1e-3;

/// Most attempts at one step; starting undamped, the last damping is 1e7 of the curvature.
const MAX_REFUSALS: usize = 12;

impl Calibration {
    /// Fits a frame, `[measurement]`, volts, starting from the contact impedances of the settings; those of
    /// `model` are ignored.
    ///
    /// # Errors
    /// Wrong lengths or values out of range, non-finite values of used measurements,
    /// [`InverseError::UnlikeModel`] for a frame of the opposite sign, or [`InverseError::Forward`].
    pub fn of_frame(
        model: &ForwardModel,
        frame_v: &[f64],
        settings: &CalibrationSettings,
    ) -> Result<Self, InverseError> {
        Fit::new(model, frame_v, settings)?.run()
    }
}

struct Fit<'a> {
    model: &'a ForwardModel,
    settings: &'a CalibrationSettings,
    channels: Channels,
    frame_v: &'a [f64],
    /// Whether the noise is given.
    known: bool,
    workspace: Workspace,
    geometry: Geometry,
    forward_solves: usize,
}

/// Parameters and the model's results for them.
struct Point {
    /// `ln sigma`, then `ln z / z_start`.
    x: Vec<f64>,
    voltages_v: Vec<f64>,
    /// `W^1/2 (v - V)`, `[used]`, relative to the largest noise.
    residual: Vec<f64>,
    /// `W^1/2 dV/dx`, `[used, parameter]`.
    jacobian: Mat<f64>,
    /// Variance of the residual's noise: given, or of maximum likelihood.
    variance: f64,
    objective: f64,
}

impl<'a> Fit<'a> {
    fn new(
        model: &'a ForwardModel,
        frame_v: &'a [f64],
        settings: &'a CalibrationSettings,
    ) -> Result<Self, InverseError> {
        settings.validate(model)?;
        let count = model.protocol().measurements();
        check_length("frame", frame_v.len(), count)?;
        let (noise_std, used) = (settings.noise_std_v.as_deref(), settings.used.as_deref());
        let channels = Channels::new(count, &DifferenceData::Plain, noise_std, used)?;
        if let Some(&measurement) = channels.used.iter().find(|&&i| !frame_v[i].is_finite()) {
            let value = frame_v[measurement];
            return Err(InverseError::NonFiniteData { frame: 0, measurement, value });
        }
        let known = settings.noise_std_v.is_some();
        let (workspace, geometry) = (model.workspace()?, model.geometry());
        let forward_solves = 0;
        Ok(Self { model, settings, channels, frame_v, known, workspace, geometry, forward_solves })
    }

    fn run(mut self) -> Result<Calibration, InverseError> {
        let start = vec![self.settings.conductivity_s.ln()];
        let contacts = match self.settings.contacts {
            Contacts::Each => self.settings.contact_impedance.len(),
            Contacts::Common => 1,
        };
        let start = self.point([start, vec![0.0; contacts]].concat())?;
        let residual_before = self.relative(&start);
        let mut point = self.scaled(start)?;
        let (mut damping, mut iterations) = (0.0, 0);
        let status = loop {
            let curvature = self.curvature(&point);
            let gradient = self.gradient(&point);
            let Some(step) = solve(&curvature, &gradient, 0.0) else {
                break CalibrationStatus::Stalled;
            };
            let size: f64 = step.iter().zip(&gradient).map(|(s, g)| s * g).sum();
            // below the least residual the objective cannot rank points
            if size <= SMALLEST_STEP || (!self.known && self.relative(&point) <= ACCURACY) {
                break CalibrationStatus::Converged;
            }
            if iterations == self.settings.max_iterations {
                break CalibrationStatus::IterationCap;
            }
            let Some(better) = self.improve(&point, &curvature, &gradient, &mut damping) else {
                break CalibrationStatus::Stalled;
            };
            point = better;
            iterations += 1;
        };
        self.finish(point, status, iterations, residual_before)
    }

    /// Solves the model for the given parameters.
    fn point(&mut self, x: Vec<f64>) -> Result<Point, InverseError> {
        self.forward_solves += 1;
        let impedance = self.impedance(&x);
        self.model.change_contacts(&impedance, &mut self.geometry)?;
        let sigma = vec![x[0].exp(); self.model.elements()];
        let (geometry, workspace) = (&self.geometry, &mut self.workspace);
        let mut solution = self.model.solve_deformed_to(geometry, &sigma, ACCURACY, workspace)?;
        let voltages_v = solution.measurements().to_vec();
        let slopes = solution.contact_jacobian()?;
        let used = &self.channels.used;
        let mut jacobian = Mat::zeros(used.len(), x.len());
        let mut residual = Vec::with_capacity(used.len());
        for (k, &i) in used.iter().enumerate() {
            let weight = self.channels.root_weights[k];
            residual.push(weight * (self.frame_v[i] - voltages_v[i]));
            jacobian[(k, 0)] = -weight * voltages_v[i];
            for (l, z) in impedance.iter().enumerate() {
                let slope = weight * z * slopes[[i, l]];
                jacobian[(k, 0)] += slope;
                jacobian[(k, (1 + l).min(x.len() - 1))] += slope;
            }
        }
        let sum: f64 = residual.iter().map(|r| r * r).sum();
        let (variance, misfit) = match self.channels.noise_scale {
            Some(scale) => (scale * scale, sum / (scale * scale)),
            None => {
                let count = used.len() as f64;
                let variance = sum.max(ACCURACY * ACCURACY * self.frame_square()) / count;
                (variance, count * variance.ln())
            }
        };
        let prior: f64 = x[1..].iter().map(|x| (x / self.settings.contact_spread).powi(2)).sum();
        Ok(Point { x, voltages_v, residual, jacobian, variance, objective: misfit + prior })
    }

    fn impedance(&self, x: &[f64]) -> Vec<f64> {
        let start = self.settings.contact_impedance.iter().enumerate();
        start.map(|(l, z)| z * x[(1 + l).min(x.len() - 1)].exp()).collect()
    }

    /// `|v|_W^2`, relative to the largest noise.
    fn frame_square(&self) -> f64 {
        let values = self.channels.used.iter().zip(&self.channels.root_weights);
        values.map(|(&i, weight)| (weight * self.frame_v[i]).powi(2)).sum()
    }

    fn relative(&self, point: &Point) -> f64 {
        let sum: f64 = point.residual.iter().map(|r| r * r).sum();
        (sum / self.frame_square()).sqrt()
    }

    /// Rescales the conductivity so that the model's voltages are as large as the frame's.
    fn scaled(&mut self, point: Point) -> Result<Point, InverseError> {
        let (mut product, mut square) = (0.0, 0.0);
        for (&i, weight) in self.channels.used.iter().zip(&self.channels.root_weights) {
            let (v, model) = (weight * self.frame_v[i], weight * point.voltages_v[i]);
            product += v * model;
            square += model * model;
        }
        let correlation = product / (square * self.frame_square()).sqrt();
        // a frame of zeros has no correlation
        if correlation.is_nan() || correlation <= 0.0 {
            return Err(InverseError::UnlikeModel { correlation });
        }
        let mut x = point.x;
        x[0] -= (product / square).ln();
        self.point(x)
    }

    /// `J' W J` and the prior's `1 / spread^2`.
    fn curvature(&self, point: &Point) -> Mat<f64> {
        let squares = point.jacobian.transpose() * &point.jacobian;
        let precision = self.settings.contact_spread.powi(-2);
        Mat::from_fn(squares.nrows(), squares.ncols(), |i, k| {
            let prior = if i == k && k > 0 { precision } else { 0.0 };
            squares[(i, k)] / point.variance + prior
        })
    }

    /// Half of the negative gradient of the objective.
    fn gradient(&self, point: &Point) -> Vec<f64> {
        let slope = |k: usize| -> f64 {
            let column = point.jacobian.col(k).iter();
            let data: f64 = column.zip(&point.residual).map(|(j, r)| j * r).sum();
            let prior =
                if k == 0 { 0.0 } else { point.x[k] / self.settings.contact_spread.powi(2) };
            data / point.variance - prior
        };
        (0..point.x.len()).map(slope).collect()
    }

    /// Returns a point with a lower objective, with as little damping as possible.
    fn improve(
        &mut self,
        point: &Point,
        curvature: &Mat<f64>,
        gradient: &[f64],
        damping: &mut f64,
    ) -> Option<Point> {
        for _ in 0..MAX_REFUSALS {
            if let Some(step) = solve(curvature, gradient, *damping) {
                let longest = step.iter().fold(0.0_f64, |m, s| m.max(s.abs()));
                let scale = (LONGEST_STEP / longest).min(1.0);
                let x = point.x.iter().zip(&step).map(|(x, s)| x + scale * s).collect();
                // a point that the forward model rejects is too far away
                if let Ok(found) = self.point(x)
                    && found.objective < point.objective
                {
                    *damping = if *damping > FIRST_DAMPING { 0.1 * *damping } else { 0.0 };
                    return Some(found);
                }
            }
            *damping = FIRST_DAMPING.max(10.0 * *damping);
        }
        None
    }

    fn finish(
        self,
        point: Point,
        status: CalibrationStatus,
        iterations: usize,
        residual_before: f64,
    ) -> Result<Calibration, InverseError> {
        let (parameters, used) = (point.x.len(), point.residual.len());
        let sum: f64 = point.residual.iter().map(|r| r * r).sum();
        let free = used.saturating_sub(parameters).max(1) as f64;
        // the maximum likelihood variance is too small by the degrees of freedom of the parameters
        let variance =
            if self.known { point.variance } else { point.variance * used as f64 / free };
        let estimated = Point { variance, ..point };
        let curvature = self.curvature(&estimated);
        let covariance = inverse(&curvature)
            .ok_or(InverseError::Factorisation { what: "calibration", size: parameters })?;
        let spread = self.settings.contact_spread.powi(2);
        let determined = (0..parameters)
            .map(|k| if k == 0 { 1.0 } else { (1.0 - covariance[[k, k]] / spread).max(0.0) })
            .collect();
        let noise_std_v = match &self.settings.noise_std_v {
            Some(given) => given.clone(),
            None => vec![variance.sqrt(); self.frame_v.len()],
        };
        let residual_after = self.relative(&estimated);
        if status == CalibrationStatus::Converged {
            event!(
                DEBUG,
                "calibration converged",
                iterations = iterations,
                residual = residual_after
            );
        } else {
            event!(
                WARN,
                "calibration stopped before it converged",
                stalled = status == CalibrationStatus::Stalled,
                iterations = iterations,
                max_iterations = self.settings.max_iterations,
                residual = residual_after,
            );
        }
        Ok(Calibration {
            status,
            iterations,
            forward_solves: self.forward_solves,
            conductivity_s: estimated.x[0].exp(),
            contact_impedance: self.impedance(&estimated.x),
            covariance,
            determined,
            residual_before,
            residual_after,
            noise_std_v,
            reduced_chi_square: if self.known { sum / variance / free } else { 1.0 },
            voltages_v: estimated.voltages_v,
        })
    }
}

/// Solves `(H + damping diag H)^-1 g`, with `H` scaled to a unit diagonal; `None` if rounding makes it
/// indefinite.
fn solve(curvature: &Mat<f64>, gradient: &[f64], damping: f64) -> Option<Vec<f64>> {
    let scales: Vec<f64> = (0..gradient.len()).map(|k| curvature[(k, k)].sqrt().recip()).collect();
    let matrix = scaled(curvature, &scales, damping);
    let factor = matrix.llt(Side::Lower).ok()?;
    let right = Mat::from_fn(gradient.len(), 1, |k, _| scales[k] * gradient[k]);
    let found = factor.solve(&right);
    let step: Vec<f64> = scales.iter().enumerate().map(|(k, s)| s * found[(k, 0)]).collect();
    step.iter().all(|s| s.is_finite()).then_some(step)
}

fn inverse(curvature: &Mat<f64>) -> Option<Array2<f64>> {
    let count = curvature.nrows();
    let scales: Vec<f64> = (0..count).map(|k| curvature[(k, k)].sqrt().recip()).collect();
    let factor = scaled(curvature, &scales, 0.0).llt(Side::Lower).ok()?;
    let found = factor.solve(&Mat::<f64>::identity(count, count));
    let entry = |(i, k): (usize, usize)| scales[i] * found[(i, k)] * scales[k];
    Some(Array2::from_shape_fn((count, count), entry))
}

fn scaled(curvature: &Mat<f64>, scales: &[f64], damping: f64) -> Mat<f64> {
    Mat::from_fn(scales.len(), scales.len(), |i, k| {
        let damped = if i == k { 1.0 + damping } else { 1.0 };
        damped * scales[i] * curvature[(i, k)] * scales[k]
    })
}
