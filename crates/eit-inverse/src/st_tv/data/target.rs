//! A frame's data in the coordinates of its mode.

use super::{Compression, Mode};

/// Data of one frame in the coordinates of its mode.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Target {
    /// `[rank]`.
    pub(crate) values: Vec<f64>,
    /// Squared norm of what no image can explain.
    pub(crate) rest_squared: f64,
}

impl Target {
    pub(crate) fn zero(rank: usize) -> Self {
        Self { values: vec![0.0; rank], rest_squared: 0.0 }
    }

    /// Norm of what an image can explain.
    pub(crate) fn norm(&self) -> f64 {
        self.values.iter().map(|b| b * b).sum::<f64>().sqrt()
    }

    /// The target in a unit of this many of its own.
    pub(crate) fn divide(&mut self, unit: f64) {
        self.values.iter_mut().for_each(|b| *b /= unit);
        self.rest_squared /= unit * unit;
    }

    /// No data.
    pub(crate) fn clear(&mut self) {
        self.values.fill(0.0);
        self.rest_squared = 0.0;
    }

    /// Takes the good channels of a frame `dv`. `coefficients` and `whitened` are scratch, `[rank]`
    /// and `[measurement]`.
    pub(crate) fn set(
        &mut self,
        compression: &Compression,
        mode: &Mode,
        dv: impl Fn(usize) -> f64,
        coefficients: &mut [f64],
        whitened: &mut [f64],
    ) {
        for (i, value) in whitened.iter_mut().enumerate() {
            let weight = compression.root_weights[i];
            // masked values may be NaN
            *value = if mode.masked[i] || weight == 0.0 { 0.0 } else { weight * dv(i) };
        }
        for (k, c) in coefficients.iter_mut().enumerate() {
            let column = compression.left.col(k);
            *c = column.iter().zip(whitened.iter()).map(|(u, v)| u * v).sum();
        }
        if mode.rotation.is_empty() {
            self.values.copy_from_slice(coefficients);
        } else {
            // B = U_t S = P diag(s) Q', so the target is P' v = diag(1/s) Q' B' v
            coefficients.iter_mut().zip(&compression.singular).for_each(|(c, s)| *c *= s);
            mode.rotate(coefficients, &mut self.values);
            for (value, s) in self.values.iter_mut().zip(&mode.singular) {
                *value = if *s > 0.0 { *value / s } else { 0.0 };
            }
        }
        // what is left, value by value: a difference of squares would leave the root of rounding
        if mode.rotation.is_empty() {
            coefficients.copy_from_slice(&self.values);
        } else {
            for (value, s) in self.values.iter_mut().zip(&mode.singular) {
                *value = if *s > 0.0 { *value / s } else { 0.0 };
            }
            mode.rotate_back(&self.values, coefficients);
            coefficients.iter_mut().zip(&compression.singular).for_each(|(c, s)| *c *= s);
            self.values.iter_mut().zip(&mode.singular).for_each(|(v, s)| *v *= s);
        }
        for (k, c) in coefficients.iter().enumerate() {
            let column = compression.left.col(k);
            whitened.iter_mut().zip(column.iter()).for_each(|(w, u)| *w -= c * u);
        }
        let rest = whitened.iter().zip(&mode.masked).filter(|(_, masked)| !**masked);
        self.rest_squared = rest.map(|(w, _)| w * w).sum();
    }
}
