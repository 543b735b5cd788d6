//! Linear skin: the conductivity depends linearly on the force of each finger, without memory. With
//! force `F`, centre `f` and radius `R` of a touch,
//!
//! ```text
//! sigma(x) = sigma_0(x) (1 + sum over touches of  change_per_newton F s(|x - f| / R))
//! round tip: s(q) = exp(-q^2 / 2), a bell of standard deviation R;   flat tip: s(q) = 1 up to q = 1, else 0
//! ```
//!
//! A round tip of radius R and a flat tip of radius `sqrt(2) R` have the same total change.

use super::contact::Tip;
use super::pixels::pixel_means_into;
use super::script::Touch;
use super::settings::LinearResponse;
use eit_mesh::Raster;
use std::f64::consts::{PI, TAU};

impl LinearResponse {
    /// Returns the relative change of the conductivity at a point.
    pub fn relative_change(&self, touches: &[Touch], place_m: [f64; 2]) -> f64 {
        let change = |touch: &Touch| self.change_per_newton * touch.force_n * shape(touch, place_m);
        touches.iter().map(change).sum()
    }

    /// Returns the sheet conductivity at points such as element centroids, siemens. Ignores z.
    pub fn conductivity_s(
        &self,
        untouched_s: f64,
        touches: &[Touch],
        places_m: &[[f64; 3]],
    ) -> Vec<f64> {
        let at = |p: &[f64; 3]| untouched_s * (1.0 + self.relative_change(touches, [p[0], p[1]]));
        places_m.iter().map(at).collect()
    }

    /// Computes the mean relative change of each masked pixel, from 4 x 4 points: a ground truth
    /// that does not depend on a mesh.
    pub fn pixel_changes_into(&self, touches: &[Touch], raster: &Raster, pixels: &mut [f64]) {
        pixel_means_into(raster, |place| self.relative_change(touches, place), pixels);
    }
}

/// Pressure of the touches at a point, pascal. It has the shape of the touches and integrates to
/// their force.
pub(super) fn pressure_pa(touches: &[Touch], place_m: [f64; 2]) -> f64 {
    let of_one = |touch: &Touch| {
        let area_m2 = touch.radius_m.powi(2)
            * match touch.tip {
                Tip::Round => TAU,
                Tip::Flat => PI,
            };
        touch.force_n * shape(touch, place_m) / area_m2
    };
    touches.iter().map(of_one).sum()
}

/// Shape of a touch: one at its centre.
fn shape(touch: &Touch, place_m: [f64; 2]) -> f64 {
    let [x, y] = [0, 1].map(|k| place_m[k] - touch.position_m[k]);
    let (square, radius_square) = (x.powi(2) + y.powi(2), touch.radius_m.powi(2));
    match touch.tip {
        Tip::Round => (-0.5 * square / radius_square).exp(),
        Tip::Flat if square <= radius_square => 1.0,
        Tip::Flat => 0.0,
    }
}
