//! Data of a frame in internal units, and whether they are noise.

use super::super::quiet::quiet_threshold;
use super::super::settings::Fidelity;
use super::super::units::radius;
use super::CausalStream;
use crate::InverseError;
use crate::check::check_range;

/// A frame larger than the unit of the data by this factor sets a new unit.
const OUTGROWN: f64 = 1e4;
/// Number of consecutive frames of pure noise after which the skin counts as at rest.
const REST_AFTER: usize = 8;

impl CausalStream {
    /// Transforms the data of a frame to internal units; may change the unit.
    pub(super) fn take(&mut self, dv: &[f64]) -> Result<(), InverseError> {
        let compression = &self.solver.compression;
        for (i, value) in self.whitened.iter_mut().enumerate() {
            // masked values may be NaN
            *value = if self.seen.good[i] { compression.root_weights[i] * dv[i] } else { 0.0 };
        }
        let one = self.one();
        self.seen.take(compression, &self.whitened, one, &mut self.target);
        let (along, settings) = (self.target.square().sqrt() * one, &self.solver.settings);
        let norms = [self.target.rest_squared.sqrt() * one, along];
        let place = (self.pushed, self.seen.count);
        let delta = radius(&self.solver, settings.fidelity, place, norms)?;
        self.delta = delta.map_or(0.0, |delta| delta / one);
        let noise = settings.noise_std.as_ref().map_or(0.0, |_| (self.seen.count as f64).sqrt());
        let nearest = settings.nearest_zero_s().abs();
        let size = along.max(noise).max(nearest * self.solver.unit);
        let must = "below 1e150 in units of the noise";
        check_range("norm of the data", size, size.is_finite(), must)?;
        if size > 0.0 && (self.scale == 0.0 || size > OUTGROWN * self.scale) {
            let grown = size / one;
            self.scale = size;
            self.delta /= grown;
            self.target.divide(grown);
            self.frames.grow(grown, self.solver.settings.fidelity == Fidelity::Penalised);
            self.set_anchor();
        }
        Ok(())
    }

    /// Returns the squared radius of the data constraint in the coordinates of the frame; `None` for
    /// penalised data.
    pub(super) fn ball(&self) -> Option<f64> {
        let is_constrained = self.solver.settings.fidelity != Fidelity::Penalised;
        is_constrained.then(|| (self.delta.powi(2) - self.target.rest_squared).max(0.0))
    }

    /// Returns whether the skin is at rest; counts quiet frames.
    pub(super) fn is_quiet(&mut self) -> bool {
        let settings = &self.solver.settings;
        let is_zero = self.image.iter().all(|x| *x == 0.0);
        let threshold = match settings.noise_std {
            Some(_) => quiet_threshold(self.seen.count as f64),
            None => 0.0,
        };
        let is_noise = self.square() <= threshold;
        self.quiet_frames = if is_noise { self.quiet_frames + 1 } else { 0 };
        let zero_allowed = settings.nearest_zero_s() == 0.0;
        let is_long = !self.is_linked() || self.quiet_frames >= REST_AFTER;
        is_noise && zero_allowed && (is_zero || is_long)
    }

    /// Returns the squared norm of the data.
    pub(super) fn square(&self) -> f64 {
        (self.target.square() + self.target.rest_squared) * self.one() * self.one()
    }
}
