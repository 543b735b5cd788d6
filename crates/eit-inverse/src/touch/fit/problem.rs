//! Residuals and their derivatives.

use crate::InverseError;
use crate::check::check_length;
use crate::data::Channels;
use crate::touch::bell::{Bell, quadrature, value_and_slopes};
use crate::touch::skin::{Place, nearest};
use eit_fem::{ForwardModel, Workspace};
use eit_mesh::Surface;
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
use ndarray::Array2;

/// Least conductivity relative to the background; a trial below it is rejected.
const LEAST_CONDUCTIVITY: f64 = 1e-3;

/// Unknown parameters of each bell besides its position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Parameters {
    pub(crate) amplitude: bool,
    pub(crate) radius: bool,
}

impl Parameters {
    /// Number of unknowns per bell: two coordinates and these.
    pub(crate) fn count(self) -> usize {
        2 + usize::from(self.amplitude) + usize::from(self.radius)
    }
}

/// The forward model with everything that a fit needs.
#[derive(Debug, Clone)]
pub(crate) struct Problem<'a> {
    model: &'a ForwardModel,
    surface: &'a Surface,
    background_s: Vec<f64>,
    pub(crate) channels: Channels,
    noise_scale: f64,
    points: Vec<[[f64; 3]; 3]>,
    base_v: Vec<f64>,
    voltages_v: Vec<f64>,
    conductivity_s: Vec<f64>,
    workspace: Workspace,
    jacobian: Array2<f64>,
    pub(crate) solves: usize,
}

impl<'a> Problem<'a> {
    pub(crate) fn new(
        model: &'a ForwardModel,
        surface: &'a Surface,
        background_s: &[f64],
        channels: Channels,
    ) -> Result<Self, InverseError> {
        let Some(noise_scale) = channels.noise_scale else {
            let what = "a fit weights measurements by their noise, which is missing";
            return Err(InverseError::NoiseUnknown { what });
        };
        check_length("triangles of the surface", surface.triangles().len(), model.elements())?;
        let mut workspace = model.workspace()?;
        let mut base_v = vec![0.0; model.protocol().measurements()];
        model.solve(background_s, &mut workspace)?.measurements_into(&mut base_v)?;
        Ok(Self {
            jacobian: Array2::zeros((base_v.len(), model.elements())),
            points: quadrature(surface),
            background_s: background_s.to_vec(),
            conductivity_s: background_s.to_vec(),
            voltages_v: base_v.clone(),
            base_v,
            model,
            surface,
            channels,
            noise_scale,
            workspace,
            solves: 1,
        })
    }

    /// Computes the data in units of the noise, `[used]`.
    pub(crate) fn whitened(
        &self,
        frame: &[f64],
        reference_frame: &[f64],
    ) -> Result<Vec<f64>, InverseError> {
        let mut data = vec![0.0; self.channels.used.len()];
        self.channels.difference_into(0, frame, reference_frame, &[], &mut data)?;
        let weights = &self.channels.root_weights;
        data.iter_mut().zip(weights).for_each(|(dv, w)| *dv *= w / self.noise_scale);
        Ok(data)
    }

    /// Returns the nearest point of the skin.
    pub(crate) fn place(&self, position_m: [f64; 3]) -> Place {
        nearest(self.surface, position_m)
    }

    /// Sets the conductivity to the background with bells; returns false if they leave too little of it.
    fn set(&mut self, bells: &[Bell]) -> bool {
        for (e, sigma) in self.conductivity_s.iter_mut().enumerate() {
            let change =
                |b: &Bell| b.amplitude * value_and_slopes(&self.points[e], b, &[[0.0; 3]; 2]).0;
            let factor = 1.0 + bells.iter().map(change).sum::<f64>();
            // also false for NaN
            if !(factor >= LEAST_CONDUCTIVITY && factor.is_finite()) {
                return false;
            }
            *sigma = self.background_s[e] * factor;
        }
        true
    }

    /// Computes the residuals of bells in units of the noise, `[used]`; `None` if the forward model has no
    /// solution.
    pub(crate) fn residuals(&mut self, data: &[f64], bells: &[Bell]) -> Option<Vec<f64>> {
        if !self.set(bells) {
            return None;
        }
        self.solves += 1;
        let solution = self.model.solve(&self.conductivity_s, &mut self.workspace).ok()?;
        solution.measurements_into(&mut self.voltages_v).ok()?;
        let residual = |(k, (dv, &i)): (usize, (&f64, &usize))| {
            let factor = self.channels.row_factor(k) / self.noise_scale;
            dv - factor * (self.voltages_v[i] - self.base_v[i])
        };
        Some(data.iter().zip(&self.channels.used).enumerate().map(residual).collect())
    }

    /// Computes the derivative of the model's whitened differences, `[used, parameter]`, for bells on the
    /// skin: `J dsigma/dtheta`. `None` if the bells leave too little conductivity.
    pub(crate) fn derivative(
        &mut self,
        bells: &[Bell],
        parameters: Parameters,
    ) -> Result<Option<Mat<f64>>, InverseError> {
        if !self.set(bells) {
            return Ok(None);
        }
        self.solves += 1;
        let mut solution = self.model.solve(&self.conductivity_s, &mut self.workspace)?;
        solution.jacobian_into(self.jacobian.view_mut())?;
        let each = parameters.count();
        let elements = self.points.len();
        let mut slopes = Mat::zeros(elements, each * bells.len());
        for (k, bell) in bells.iter().enumerate() {
            let tangents = nearest(self.surface, bell.position_m).tangents;
            for (e, points) in self.points.iter().enumerate() {
                let (g, [first, second, radius]) = value_and_slopes(points, bell, &tangents);
                if g == 0.0 {
                    continue;
                }
                let sigma = self.background_s[e];
                let mut column = k * each;
                let mut put = |value: f64| {
                    slopes[(e, column)] = sigma * value;
                    column += 1;
                };
                put(bell.amplitude * first);
                put(bell.amplitude * second);
                if parameters.amplitude {
                    put(g);
                }
                if parameters.radius {
                    put(bell.amplitude * radius);
                }
            }
        }
        let mut all = Mat::zeros(self.base_v.len(), slopes.ncols());
        let values = self.jacobian.as_slice().unwrap_or(&[]);
        let jacobian = MatRef::from_row_major_slice(values, self.base_v.len(), elements);
        matmul(all.as_mut(), Accum::Replace, jacobian, slopes.as_ref(), 1.0, Par::Seq);
        let used = &self.channels.used;
        Ok(Some(Mat::from_fn(used.len(), slopes.ncols(), |k, p| {
            all[(used[k], p)] * self.channels.row_factor(k) / self.noise_scale
        })))
    }
}

/// Returns `A' A` scaled to a unit diagonal, and the scales (zero for a zero column).
pub(crate) fn scaled_gram(a: MatRef<'_, f64>) -> (Mat<f64>, Vec<f64>) {
    let gram = a.transpose() * a;
    let scales: Vec<f64> = (0..gram.nrows())
        .map(|i| if gram[(i, i)] > 0.0 { gram[(i, i)].sqrt().recip() } else { 0.0 })
        .collect();
    let scaled =
        Mat::from_fn(gram.nrows(), gram.ncols(), |i, j| gram[(i, j)] * scales[i] * scales[j]);
    (scaled, scales)
}

/// Inverts the Fisher information `A' A`; infinite on the diagonal if the columns of `A` are linearly
/// dependent to rounding.
pub(crate) fn inverse_information(a: MatRef<'_, f64>) -> Array2<f64> {
    use faer::Side;
    use faer::prelude::Solve;
    /// Added to a unit diagonal, this is lost in the rounding of sums of some hundred terms; a smaller
    /// pivot has no correct digit.
    const ROUNDING: f64 = 1e-13;
    let (gram, scales) = scaled_gram(a);
    let count = gram.nrows();
    let inverse = gram.llt(Side::Lower).ok().and_then(|factor| {
        let least = (0..count).map(|i| factor.L()[(i, i)]).fold(f64::INFINITY, f64::min);
        (least * least > ROUNDING).then(|| factor.solve(Mat::<f64>::identity(count, count)))
    });
    Array2::from_shape_fn((count, count), |(i, j)| match &inverse {
        Some(inverse) => inverse[(i, j)] * scales[i] * scales[j],
        None if i == j => f64::INFINITY,
        None => 0.0,
    })
}
