//! Noise of difference data: stated in the scene, measured on quiet frames, or unknown.

use crate::frames::Frames;
use ndarray::Array2;

/// Error of the linear model as a part of the differences: two fingers of half the conductivity
/// again cost that much. Weights that are chosen see at least this noise; without it, simulated
/// fingers at 70 dB (three or four of them) come out with twice the error that they have at 60 dB,
/// fitted to what the model cannot say. Half of it does not cure all of those, twice as much blurs
/// at 60 dB.
const MODEL_ERROR: f64 = 0.015;

/// Standard deviation of difference data.
#[derive(Debug, Clone)]
pub struct DataNoise {
    /// `[measurement]`, in the unit of the differences, with the reference frame's share.
    pub std: Vec<f64>,
    /// Frames that the reference is the mean of.
    reference_frames: usize,
    /// Where it came from, in words.
    pub source: String,
    /// Factor by which the model's error has raised it; infinite where no noise is known.
    pub model_error: f64,
}

impl DataNoise {
    /// That of single frames, with the share of a reference that is a mean.
    pub(crate) fn of_single_frames(of_frames: Vec<f64>, frames: &Frames, source: String) -> Self {
        let reference_frames = frames.reference_frames.max(1);
        let noise = Self { std: of_frames, reference_frames, source, model_error: 1.0 };
        let share = noise.share(1);
        noise.times(share)
    }

    /// White: of standard deviation 1, reference included.
    pub(crate) fn white(frames: &Frames) -> Self {
        Self {
            std: vec![1.0; frames.used.len()],
            reference_frames: frames.reference_frames.max(1),
            source: "that of the frames, with the movement of electrodes".to_owned(),
            model_error: 1.0,
        }
    }

    /// What the model's error alone is, equal in all measurements: where no noise is known. `good`
    /// says which values count.
    pub fn unknown(values: &Array2<f64>, good: &Array2<bool>) -> Self {
        let rms = root_mean_square(values, good, |_| 1.0);
        let std = if rms > 0.0 { MODEL_ERROR * rms } else { 1.0 };
        let source = format!("unknown; {MODEL_ERROR} of the differences");
        let model_error = f64::INFINITY;
        Self { std: vec![std; values.ncols()], reference_frames: 1, source, model_error }
    }

    /// Root mean square of the good values in units of the noise.
    pub fn of_signal(&self, values: &Array2<f64>, good: &Array2<bool>) -> f64 {
        root_mean_square(values, good, |i| self.std[i])
    }

    /// Raises the noise by the model's error: independent, and spread as the noise is.
    pub fn with_model_error(self, values: &Array2<f64>, good: &Array2<bool>) -> Self {
        let factor = (MODEL_ERROR * self.of_signal(values, good)).hypot(1.0);
        Self { model_error: factor, ..self.times(factor) }
    }

    /// Factor between this noise and the unit that numbers of the scene are in: the noise that is
    /// known, or 1 in the unit of the differences where none is.
    pub fn per_known(&self) -> f64 {
        match self.model_error.is_finite() {
            true => self.model_error,
            // equal in all measurements
            false => self.std.first().copied().unwrap_or(1.0),
        }
    }

    /// As large in all measurements that are used, with the same root mean square.
    pub fn alike(mut self, used: &[bool]) -> Self {
        let of_used = || self.std.iter().zip(used).filter(|(_, used)| **used).map(|(std, _)| std);
        let mean = of_used().map(|std| std * std).sum::<f64>() / of_used().count().max(1) as f64;
        self.std.fill(mean.sqrt());
        self
    }

    /// The noise of the mean of some frames' differences: the reference's share stays.
    pub fn of_mean(self, frames: usize) -> Self {
        let factor = self.share(frames) / self.share(1);
        self.times(factor)
    }

    /// The noise of the frames alone, without the reference's.
    pub fn of_frames(&self) -> Vec<f64> {
        self.std.iter().map(|e| e / self.share(1)).collect()
    }

    /// Standard deviation of the mean of some frames less the reference, in those of one frame.
    fn share(&self, frames: usize) -> f64 {
        (1.0 / frames as f64 + 1.0 / self.reference_frames as f64).sqrt()
    }

    fn times(mut self, factor: f64) -> Self {
        self.std.iter_mut().for_each(|e| *e *= factor);
        self
    }
}

/// Root mean square of the good values, each over the unit of its measurement; 0 where there are
/// none.
fn root_mean_square(values: &Array2<f64>, good: &Array2<bool>, unit: impl Fn(usize) -> f64) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for ((_, i), value) in values.indexed_iter().filter(|(at, _)| good[*at]) {
        sum += (value / unit(i)).powi(2);
        count += 1.0;
    }
    if count > 0.0 { (sum / count).sqrt() } else { 0.0 }
}
