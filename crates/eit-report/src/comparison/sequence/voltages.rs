//! Voltages of a sequence, and noise added to them.

use crate::error::ReportError;
use eit_fem::fabric::Random;
use eit_skin::frames::Frames;
use ndarray::{Array1, Array2};

/// Noise-free voltages of a sequence.
pub struct SequenceVoltages {
    /// Volts, [frame, measurement].
    pub frames: Array2<f64>,
    /// The untouched skin, volts.
    pub reference: Array1<f64>,
    /// Frames per second.
    pub rate_hz: f64,
    /// Notes on accuracy lost to rounding, if significant.
    pub notes: Vec<String>,
}

impl SequenceVoltages {
    /// Standard deviation of noise the given number of decibels below the reference voltages,
    /// volts.
    pub fn noise_std_v(&self, noise_db: f64) -> f64 {
        let rms = (self.reference.dot(&self.reference) / self.reference.len() as f64).sqrt();
        10_f64.powf(-noise_db / 20.0) * rms
    }

    /// Adds white Gaussian noise of a standard deviation in volts to the frames, and separate noise
    /// to the reference.
    ///
    /// Noise from one seed has the same values at every level, only scaled, so that results for
    /// different levels differ by the level alone.
    ///
    /// # Errors
    /// Noise that is negative or not finite.
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
