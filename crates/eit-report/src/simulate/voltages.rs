//! Voltages of a sequence, and noise onto them.

use crate::error::ReportError;
use eit_fem::fabric::Random;
use eit_skin::frames::Frames;
use ndarray::{Array1, Array2};

/// Voltages of a sequence without noise.
pub(crate) struct SequenceVoltages {
    /// Volt, [frame, measurement].
    pub frames: Array2<f64>,
    /// The untouched skin, volt.
    pub reference: Array1<f64>,
    /// Frames a second.
    pub rate_hz: f64,
    /// What rounding may have cost, where that is worth saying.
    pub notes: Vec<String>,
}

impl SequenceVoltages {
    /// Standard deviation of noise that lies so many decibel below the reference voltages, volt.
    pub fn noise_std_v(&self, noise_db: f64) -> f64 {
        let rms = (self.reference.dot(&self.reference) / self.reference.len() as f64).sqrt();
        10_f64.powf(-noise_db / 20.0) * rms
    }

    /// The frames with white Gaussian noise of a standard deviation in volt, and the reference with
    /// noise of its own.
    ///
    /// Noise of one seed is the same numbers at every level, only larger or smaller, so that
    /// results over levels differ by the level alone.
    pub fn with_noise(&self, std: f64, seed: u64) -> Result<Frames, ReportError> {
        if !(std.is_finite() && std >= 0.0) {
            let message = format!("noise of {std} V: it must be finite and not below zero");
            return Err(ReportError::input(message));
        }
        let mut random = Random::named(seed, "noise", 0);
        let (mut values, mut reference) = (self.frames.clone(), self.reference.clone());
        values.iter_mut().chain(&mut reference).for_each(|v| *v += std * random.normal());
        Ok(Frames {
            good: Array2::from_elem(values.raw_dim(), true),
            used: vec![true; reference.len()],
            values,
            reference: reference.to_vec(),
            reference_source: "the untouched skin".to_owned(),
            reference_frames: 1,
            quiet: None,
            faults: Vec::new(),
            rate_hz: Some(self.rate_hz),
            reciprocity_error: None,
            notes: self.notes.clone(),
        })
    }
}
