//! How the error falls as presses are added, and when it no longer does.

use crate::learn::{LearnedSkin, PlaceErrors, PlacesBy};

/// Fewest presses after which collecting may end by itself.
const LEAST_PRESSES: usize = 25;
/// The error no longer falls if this many further presses ...
const WITHOUT_GAIN: usize = 15;
/// ... have not brought it below this fraction of the least error before them.
const GAIN: f64 = 0.95;

/// Error after a number of presses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorPoint {
    /// Number of presses learnt.
    pub presses: usize,
    /// How touches are located.
    pub places_by: PlacesBy,
    /// Position errors of held-out presses.
    pub place: PlaceErrors,
    /// Leave-one-out root mean square error of the logarithm of the force, if forces were learnt.
    pub force_ln: Option<f64>,
}

/// Errors of held-out presses while presses are added.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FallingError {
    points: Vec<ErrorPoint>,
}

impl FallingError {
    /// Adds what was learnt from all presses so far.
    pub fn push(&mut self, learned: &LearnedSkin) -> ErrorPoint {
        let point = ErrorPoint {
            presses: learned.presses.places_m.len(),
            places_by: learned.places_by,
            place: learned.errors(),
            force_ln: learned.force.as_ref().map(|force| force.error_ln),
        };
        self.points.push(point);
        point
    }

    /// Returns the points so far.
    pub fn points(&self) -> &[ErrorPoint] {
        &self.points
    }

    /// Returns whether the error no longer falls: of at least 25 presses, the last 15 have reduced neither the mean
    /// position error nor, if forces are learnt, that of the force by 5 %.
    pub fn has_settled(&self) -> bool {
        let Some(last) = self.points.last().filter(|last| last.presses >= LEAST_PRESSES) else {
            return false;
        };
        let is_early = |point: &&ErrorPoint| point.presses + WITHOUT_GAIN <= last.presses;
        let least = |is_of: bool, error: &dyn Fn(&ErrorPoint) -> f64| {
            let points = self.points.iter().filter(|point| is_early(point) == is_of);
            points.map(error).fold(f64::INFINITY, f64::min)
        };
        let falls = |error: &dyn Fn(&ErrorPoint) -> f64| {
            let (early, late) = (least(true, error), least(false, error));
            // nothing known before: it falls
            early.is_infinite() || late < GAIN * early
        };
        let of_force = |point: &ErrorPoint| point.force_ln.unwrap_or(f64::INFINITY);
        !(falls(&|point| point.place.mean_m) || last.force_ln.is_some() && falls(&of_force))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(errors_mm: &[f64], forces: Option<&[f64]>) -> bool {
        let mut falling = FallingError::default();
        for (k, mm) in errors_mm.iter().enumerate() {
            let place = PlaceErrors { median_m: 1e-3 * mm, mean_m: 1e-3 * mm };
            falling.points.push(ErrorPoint {
                presses: 5 * (k + 1),
                places_by: PlacesBy::Presses,
                place,
                force_ln: forces.map(|forces| forces[k]),
            });
        }
        falling.has_settled()
    }

    #[test]
    fn ends_when_neither_place_nor_force_improves() {
        // 5, 10, ... presses
        assert!(!after(&[5.0, 4.0, 4.0, 4.0], None), "only 20 presses");
        assert!(after(&[5.0, 4.0, 4.0, 3.9, 3.9], None));
        assert!(!after(&[5.0, 4.0, 4.0, 3.9, 3.7], None), "still falls");
        assert!(after(&[5.0, 4.0, 4.0, 3.9, 4.7], None), "chance made it worse");
        let force = [0.2, 0.1, 0.09, 0.08, 0.08];
        assert!(!after(&[5.0, 4.0, 4.0, 3.9, 3.9], Some(&force)), "force still falls");
        assert!(after(&[5.0, 4.0, 4.0, 3.9, 3.9], Some(&[0.1; 5])));
    }
}
