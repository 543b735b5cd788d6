//! What finds the touches of a frame: the model, or what presses have taught.

use crate::error::SkinError;
#[cfg(feature = "learn")]
use crate::learn::LearnedTouches;
use crate::learn::ModelForces;
use eit_inverse::touch::{DetectedTouch, DetectorStep, TouchDetector};

#[derive(Debug, Clone)]
pub(super) enum Source {
    /// The model, and the forces learnt for its touches.
    Model { detector: Box<TouchDetector>, forces: Option<Box<ModelForces>> },
    #[cfg(feature = "learn")]
    Presses(Box<LearnedTouches>),
}

impl Source {
    /// Takes a frame `[measurement]`, volts. Measurements of faulty electrodes are missing for longer than single bad
    /// values.
    pub(super) fn push(
        &mut self,
        values: &[f64],
        is_faulty: impl Fn(usize) -> bool,
        is_missing: impl Fn(usize) -> bool,
        dt_s: f64,
    ) -> Result<DetectorStep, SkinError> {
        match self {
            Self::Model { detector, .. } => {
                Ok(detector.push(values, |i| is_faulty(i) || is_missing(i), dt_s)?)
            }
            #[cfg(feature = "learn")]
            Self::Presses(touches) => touches.push(values, is_faulty, is_missing),
        }
    }

    /// Touches of the last frame.
    pub(super) fn found(&mut self) -> &[DetectedTouch] {
        match self {
            Self::Model { detector, forces } => match forces {
                Some(forces) => forces.add_to(detector.touches()),
                None => detector.touches(),
            },
            #[cfg(feature = "learn")]
            Self::Presses(touches) => touches.found(),
        }
    }

    /// Whether the last frame shows no touch.
    pub(super) fn is_empty(&self) -> bool {
        match self {
            Self::Model { detector, .. } => detector.touches().is_empty(),
            #[cfg(feature = "learn")]
            Self::Presses(touches) => touches.found().is_empty(),
        }
    }

    pub(super) fn reference_v(&self) -> &[f64] {
        match self {
            Self::Model { detector, .. } => detector.reference_v(),
            #[cfg(feature = "learn")]
            Self::Presses(touches) => touches.reference_v(),
        }
    }

    pub(super) fn set_reference(&mut self, measurement: usize, value: f64) {
        match self {
            Self::Model { detector, .. } => detector.set_reference(measurement, value),
            #[cfg(feature = "learn")]
            Self::Presses(touches) => touches.set_reference(measurement, value),
        }
    }

    /// Takes back what the reference has learnt from the last frames: an electrode was faulty.
    pub(super) fn take_back_reference(&mut self) {
        match self {
            Self::Model { detector, .. } => detector.take_back_reference(),
            #[cfg(feature = "learn")]
            Self::Presses(touches) => touches.forget_waiting(),
        }
    }

    /// Whether the source judges every frame by what presses do, whatever the model says of the reference.
    pub(super) fn is_learnt(&self) -> bool {
        !matches!(self, Self::Model { .. })
    }

    pub(super) fn nearest_on_skin(&self, point_m: [f64; 3]) -> [f64; 3] {
        match self {
            Self::Model { detector, .. } => detector.nearest_on_skin(point_m),
            #[cfg(feature = "learn")]
            Self::Presses(touches) => touches.nearest_on_skin(point_m),
        }
    }
}
