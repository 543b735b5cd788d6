//! Noise of difference data: stated in the scene, measured on quiet frames, or unknown.

use crate::frames::Frames;
use ndarray::Array2;

/// Error of the linear model as a fraction of the differences: that of two fingers that raise the
/// conductivity by half. Weights are chosen for at least this noise. Without it, simulated fingers
/// at 70 dB (three or four of them) have twice the error that they have at 60 dB, because the
/// images fit what the model cannot represent. Half of this value does not suffice in all of those
/// cases; twice this value blurs at 60 dB.
const MODEL_ERROR: f64 = 0.015;

/// Standard deviation of difference data.
#[derive(Debug, Clone)]
pub struct DataNoise {
    /// `[measurement]`, in the unit of the differences, including the reference frame's noise.
    pub std: Vec<f64>,
    /// Number of frames averaged into the reference.
    reference_frames: usize,
    /// Source of the noise, in words.
    pub source: String,
    /// Factor by which the model error raised the noise; infinite if the noise is unknown.
    pub model_error: f64,
}

impl DataNoise {
    /// Noise of single frames, plus that of the averaged reference.
    pub(crate) fn of_single_frames(of_frames: Vec<f64>, frames: &Frames, source: String) -> Self {
        let reference_frames = frames.reference_frames.max(1);
        let noise = Self { std: of_frames, reference_frames, source, model_error: 1.0 };
        let share = noise.share(1);
        noise.times(share)
    }

    /// White noise: standard deviation 1, reference included.
    pub(crate) fn white(frames: &Frames) -> Self {
        Self {
            std: vec![1.0; frames.used.len()],
            reference_frames: frames.reference_frames.max(1),
            source: "that of the frames, including electrode movement".to_owned(),
            model_error: 1.0,
        }
    }

    /// Noise for unknown instruments: the model error alone, equal in all measurements. `good` tells which
    /// values count.
    pub(crate) fn unknown(values: &Array2<f64>, good: &Array2<bool>) -> Self {
        let rms = root_mean_square(values, good, |_| 1.0);
        let std = if rms > 0.0 { MODEL_ERROR * rms } else { 1.0 };
        let source = format!("unknown; {MODEL_ERROR} of the differences");
        let model_error = f64::INFINITY;
        Self { std: vec![std; values.ncols()], reference_frames: 1, source, model_error }
    }

    /// Returns the root mean square of the good values in units of the noise.
    pub(crate) fn of_signal(&self, values: &Array2<f64>, good: &Array2<bool>) -> f64 {
        root_mean_square(values, good, |i| self.std[i])
    }

    /// Adds the model error to the noise, as independent noise of the same distribution over measurements.
    pub fn with_model_error(self, values: &Array2<f64>, good: &Array2<bool>) -> Self {
        let factor = (MODEL_ERROR * self.of_signal(values, good)).hypot(1.0);
        Self { model_error: factor, ..self.times(factor) }
    }

    /// Returns the ratio of this noise to the unit of numbers in the scene: the known noise, or 1 in the unit
    /// of the differences if it is unknown.
    pub fn per_known(&self) -> f64 {
        match self.model_error.is_finite() {
            true => self.model_error,
            // equal in all measurements
            false => self.std.first().copied().unwrap_or(1.0),
        }
    }

    /// Makes the noise equal in all measurements, with the same root mean square over the used
    /// ones.
    pub(crate) fn alike(mut self, used: &[bool]) -> Self {
        let of_used = || self.std.iter().zip(used).filter(|(_, used)| **used).map(|(std, _)| std);
        let mean = of_used().map(|std| std * std).sum::<f64>() / of_used().count().max(1) as f64;
        self.std.fill(mean.sqrt());
        self
    }

    /// Returns the noise for the mean of several frames; the reference's noise stays.
    pub(crate) fn of_mean(self, frames: usize) -> Self {
        let factor = self.share(frames) / self.share(1);
        self.times(factor)
    }

    /// Returns the noise of single frames without the reference's.
    pub(crate) fn of_frames(&self) -> Vec<f64> {
        self.std.iter().map(|e| e / self.share(1)).collect()
    }

    /// Standard deviation of the mean of some frames minus the reference, relative to that of one frame.
    fn share(&self, frames: usize) -> f64 {
        (1.0 / frames as f64 + 1.0 / self.reference_frames as f64).sqrt()
    }

    fn times(mut self, factor: f64) -> Self {
        self.std.iter_mut().for_each(|e| *e *= factor);
        self
    }
}

/// Root mean square of the good values, each divided by the unit of its measurement; 0 if there are none.
fn root_mean_square(values: &Array2<f64>, good: &Array2<bool>, unit: impl Fn(usize) -> f64) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for ((_, i), value) in values.indexed_iter().filter(|(at, _)| good[*at]) {
        sum += (value / unit(i)).powi(2);
        count += 1.0;
    }
    if count > 0.0 { (sum / count).sqrt() } else { 0.0 }
}
