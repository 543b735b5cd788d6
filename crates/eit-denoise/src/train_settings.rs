//! Training settings, devices and the learning curve: plain values that do not need burn.

use crate::DenoiseError;
use std::fmt;
use std::str::FromStr;

/// Training settings.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainSettings {
    /// Seed of the order of the examples.
    pub seed: u64,
    /// Largest number of epochs, at least 1.
    pub epochs: usize,
    /// Examples per step, at least 1.
    pub batch: usize,
    /// Learning rate of Adam in the first epoch, above zero. It falls along half a cosine to one
    /// hundredth in the last epoch (Loshchilov and Hutter, ICLR 2017) and rises from zero over the first
    /// 200 steps, or the first epoch if that is shorter.
    pub rate: f64,
    /// Stop after this many epochs without a smaller held-out error; 0: never.
    pub patience: usize,
}

impl Default for TrainSettings {
    fn default() -> Self {
        Self { seed: 1, epochs: 12, batch: 16, rate: 2e-3, patience: 8 }
    }
}

impl TrainSettings {
    /// Rejects settings outside the documented ranges.
    ///
    /// # Errors
    /// [`DenoiseError::OutOfRange`].
    pub fn validate(&self) -> Result<(), DenoiseError> {
        DenoiseError::check_range(self.epochs > 0, "epochs", 0.0, "at least 1")?;
        DenoiseError::check_range(self.batch > 0, "batch", 0.0, "at least 1")?;
        let is_positive = self.rate.is_finite() && self.rate > 0.0;
        DenoiseError::check_range(is_positive, "rate", self.rate, "finite and above zero")
    }
}

/// One epoch of the learning curve. Errors are weighted mean squared errors, relative to the
/// reference errors of [`crate::Examples::new`].
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct Epoch {
    /// Index of the epoch, from 0.
    pub epoch: usize,
    /// Mean over the steps of the epoch, each before its update.
    pub train_error: f64,
    /// Error on the held-out examples after the epoch.
    pub held_out_error: f64,
    /// Learning rate of Adam.
    pub rate: f64,
}

/// State of a training run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum TrainStatus {
    /// Another epoch follows.
    Running,
    /// All epochs are done.
    Done,
    /// The held-out error has not fallen for [`TrainSettings::patience`] epochs.
    Stopped,
}

/// Backend of burn that training runs on. A checkpoint made on one device can be resumed on another, and
/// the results agree to rounding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum TrainDevice {
    /// The processor, by burn-flex.
    #[default]
    Flex,
    /// The first CUDA device (feature `cuda`).
    Cuda,
    /// The first graphics device of Vulkan, Metal or DirectX (feature `wgpu`).
    Wgpu,
}

impl TrainDevice {
    /// All devices, including those that are not compiled in.
    pub const ALL: [Self; 3] = [Self::Flex, Self::Cuda, Self::Wgpu];

    /// Returns the name used on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Flex => "flex",
            Self::Cuda => "cuda",
            Self::Wgpu => "wgpu",
        }
    }
}

impl fmt::Display for TrainDevice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for TrainDevice {
    type Err = DenoiseError;

    fn from_str(text: &str) -> Result<Self, DenoiseError> {
        let found = Self::ALL.into_iter().find(|device| device.name() == text);
        found.ok_or_else(|| DenoiseError::UnknownDevice { found: text.to_owned() })
    }
}
