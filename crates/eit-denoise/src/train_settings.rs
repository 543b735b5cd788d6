//! How to train, on what, and what comes of it epoch by epoch: plain values without burn.

use crate::DenoiseError;
use std::fmt;
use std::str::FromStr;

/// How to train.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainSettings {
    /// The order of the examples comes from it.
    pub seed: u64,
    /// Epochs at most, from 1.
    pub epochs: usize,
    /// Examples of a step, from 1.
    pub batch: usize,
    /// Rate of Adam in the first epoch, above zero; it falls along half a cosine to a hundredth in
    /// the last (Loshchilov and Hutter, ICLR 2017). Over the first 200 steps, or the
    /// first epoch where that is shorter, it rises from zero.
    pub rate: f64,
    /// Stop after so many epochs without a smaller error on the examples held out; 0: never.
    pub patience: usize,
}

impl Default for TrainSettings {
    fn default() -> Self {
        Self { seed: 1, epochs: 12, batch: 16, rate: 2e-3, patience: 8 }
    }
}

impl TrainSettings {
    /// Refuses settings outside what is documented.
    ///
    /// # Errors
    /// [`DenoiseError::OutOfRange`].
    pub fn validate(&self) -> Result<(), DenoiseError> {
        for (quantity, value) in [("epochs", self.epochs), ("batch", self.batch)] {
            if value == 0 {
                return Err(DenoiseError::OutOfRange { quantity, value: 0.0, must: "at least 1" });
            }
        }
        if !(self.rate.is_finite() && self.rate > 0.0) {
            let (quantity, must) = ("rate", "finite and above zero");
            return Err(DenoiseError::OutOfRange { quantity, value: self.rate, must });
        }
        Ok(())
    }
}

/// One line of the learning curve. Errors are weighted mean squares: parts of the raw images' own,
/// as [`crate::Examples::new`] tells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Epoch {
    /// From 0.
    pub epoch: usize,
    /// Mean over the epoch's steps, each before its own update.
    pub train_error: f64,
    /// On the examples held out, after the epoch.
    pub held_out_error: f64,
    /// Rate of Adam.
    pub rate: f64,
}

/// Whether another epoch follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrainStatus {
    /// It does.
    Running,
    /// All epochs are done.
    Done,
    /// The held-out error has not fallen for [`TrainSettings::patience`] epochs.
    Stopped,
}

/// The backend of burn that a training runs on, by name. The choice is no part of a training:
/// weights and checkpoints of one go on with another, to rounding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum TrainDevice {
    /// The processor.
    #[default]
    Flex,
    /// The first CUDA device (feature `cuda`).
    Cuda,
    /// The first graphics device of Vulkan, Metal or DirectX (feature `wgpu`).
    Wgpu,
}

impl TrainDevice {
    /// All of them, those that are not compiled in too.
    pub const ALL: [Self; 3] = [Self::Flex, Self::Cuda, Self::Wgpu];

    /// Its name.
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
