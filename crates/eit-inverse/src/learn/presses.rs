//! Data to learn from: frames of presses, and the physical model's responses at the same positions.

use crate::InverseError;
use crate::check::{check_length, check_positive, check_range};
use crate::touch::{Places, bell_at};
use eit_core::vector::nearest;
use eit_mesh::Surface;
use ndarray::{Array2, ArrayRef2, Axis};

/// Frames of presses at known positions.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Presses {
    /// Pressed minus untouched, `[press, channel]`, any unit.
    pub frames: Array2<f64>,
    /// Positions on the model's skin, metres.
    pub places_m: Vec<[f64; 3]>,
    /// Session in which each press was made, ascending in time; empty if all were made in one. Between sessions
    /// a skin drifts.
    pub sessions: Vec<u32>,
}

impl Presses {
    /// Returns the session of a press.
    pub(super) fn session(&self, press: usize) -> u32 {
        self.sessions.get(press).copied().unwrap_or(0)
    }

    /// Returns the latest session, in which frames to come are assumed to be.
    pub(super) fn latest(&self) -> u32 {
        self.sessions.iter().copied().max().unwrap_or(0)
    }

    /// Returns whether there are presses of several sessions.
    pub(super) fn has_sessions(&self) -> bool {
        self.sessions.iter().any(|session| *session != self.session(0))
    }

    /// Rejects non-finite frames and positions, frames of zeros, mismatched lengths, and fewer than `least`
    /// presses.
    ///
    /// # Errors
    /// [`InverseError`] with the press and the value.
    pub(super) fn validate(&self, least: usize) -> Result<(), InverseError> {
        check_length("positions of presses", self.places_m.len(), self.frames.nrows())?;
        if !self.sessions.is_empty() {
            check_length("sessions of presses", self.sessions.len(), self.frames.nrows())?;
        }
        if self.frames.nrows() < least {
            let found = self.frames.nrows();
            return Err(InverseError::TooFewPresses { found, needed: least });
        }
        for (press, frame) in self.frames.rows().into_iter().enumerate() {
            if let Some(measurement) = frame.iter().position(|v| !v.is_finite()) {
                let value = frame[measurement];
                return Err(InverseError::NonFiniteData { frame: press, measurement, value });
            }
            if frame.iter().all(|v| *v == 0.0) {
                return Err(InverseError::EmptyPress { press });
            }
            let place_m = self.places_m[press];
            if !place_m.iter().all(|x| x.is_finite()) {
                return Err(InverseError::NonFinitePlace { press, place_m });
            }
        }
        Ok(())
    }

    /// Returns the presses with the given indices.
    pub fn select(&self, which: &[usize]) -> Self {
        Self {
            frames: self.frames.select(Axis(0), which),
            places_m: which.iter().map(|&k| self.places_m[k]).collect(),
            sessions: match self.sessions.is_empty() {
                true => Vec::new(),
                false => which.iter().map(|&k| self.sessions[k]).collect(),
            },
        }
    }
}

/// Responses of the channels to a touch of 1 S m^2 according to the physical model.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ModelResponses {
    /// Candidate positions, metres.
    pub candidates_m: Vec<[f64; 3]>,
    /// Responses at the candidates, `[candidate, channel]`.
    pub at_candidates: Array2<f64>,
    /// Responses at the presses, `[press, channel]`.
    pub at_presses: Array2<f64>,
}

impl ModelResponses {
    /// Rejects lengths that do not match the presses, non-finite values, and fewer than two candidates.
    pub(super) fn validate(&self, presses: &Presses) -> Result<(), InverseError> {
        check_length("model responses", self.at_candidates.nrows(), self.candidates_m.len())?;
        check_length(
            "model responses at presses",
            self.at_presses.nrows(),
            presses.frames.nrows(),
        )?;
        for responses in [&self.at_candidates, &self.at_presses] {
            check_length("channels of the model", responses.ncols(), presses.frames.ncols())?;
            if let Some(((element, measurement), &value)) =
                responses.indexed_iter().find(|(_, v)| !v.is_finite())
            {
                return Err(InverseError::NonFiniteJacobian { measurement, element, value });
            }
        }
        let count = self.candidates_m.len();
        check_range("candidate positions", count as f64, count >= 2, "at least 2")
    }
}

/// Returns about `count` evenly spread positions on a skin.
pub fn candidates(surface: &Surface, count: usize) -> Vec<[f64; 3]> {
    let area_m2: f64 = surface.areas_m2().iter().sum();
    let spacing_m = (area_m2 / count.max(1) as f64).sqrt();
    Places::new(surface, spacing_m).at.iter().map(|place| place.position_m).collect()
}

/// Computes the response of a linearised model to a bell of 1 S m^2 at each position, volts,
/// `[place, measurement]`.
///
/// The bell is that of [`TouchDetector`](crate::touch::TouchDetector).
///
/// # Errors
/// A Jacobian of another surface, a radius that is not above zero, or a position without skin near it.
pub fn bell_responses(
    surface: &Surface,
    jacobian: &ArrayRef2<f64>,
    places_m: &[[f64; 3]],
    radius_m: f64,
) -> Result<Array2<f64>, InverseError> {
    check_positive("radius_m", radius_m)?;
    check_length("Jacobian columns", jacobian.ncols(), surface.triangles().len())?;
    let (centroids, areas) = (surface.centroids(), surface.areas_m2());
    let mut bells = Array2::zeros((places_m.len(), centroids.len()));
    for (place, (&centre, mut row)) in places_m.iter().zip(bells.rows_mut()).enumerate() {
        let mut whole = 0.0;
        for ((value, centroid), area) in row.iter_mut().zip(&centroids).zip(areas) {
            *value = bell_at(centroid, centre, radius_m);
            whole += area * *value;
        }
        // outside the skin by more than a bell: the tail alone is not a touch
        if whole < 1e-3 * radius_m * radius_m {
            return Err(InverseError::OutsideSkin {
                touch: place,
                position_m: centre,
                distance_m: nearest(centroids, centre).map_or(f64::INFINITY, |(_, m)| m),
                limit_m: radius_m,
            });
        }
        row /= whole;
    }
    Ok(bells.dot(&jacobian.t()))
}
